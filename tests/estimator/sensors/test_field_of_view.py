"""Detection probabilities of the fields of view."""

import numpy as np
import pytest

from estimator.sensors.field_of_view import FieldOfView

RNG = np.random.default_rng(0)
POSES = np.array([[1.0, 2.0, 3.0, 0.4], [-4.0, 0.0, 1.0, -2.5]])


@pytest.mark.parametrize("d", [2, 3])
def test_exponential_field_is_equation_3(d: int) -> None:
    reach = np.array([5.0, 7.0, 9.0])[:d]
    points = RNG.uniform(-20, 20, (d, 300))
    zeta = (points[None] - POSES[:, :d, None]) / reach[:, None]
    expected = 0.9 * np.exp(-np.linalg.norm(zeta, axis=1) / 2)
    assert np.allclose(
        FieldOfView(d, "exponential", 0.9, reach).detection(points, POSES), expected, rtol=1e-11
    )


@pytest.mark.parametrize("turns", [False, True])
def test_box_field_is_equations_25_and_34(turns: bool) -> None:
    field = FieldOfView(2, "box", 1.0, np.array([-0.1, 0.2, -0.1, 0.2]), turns)
    points = RNG.uniform(-1, 1, (2, 500)) * 0.4 + POSES[1, :2, None]
    yaw = POSES[1, 3] if turns else 0.0
    back = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    local = back @ (points - POSES[1, :2, None])
    expected = ((local >= -0.1) & (local <= 0.2)).all(axis=0)
    assert np.array_equal(field.detection(points, POSES)[1], expected.astype(float))


def test_the_edge_of_a_box_belongs_to_it() -> None:
    field = FieldOfView(2, "box", 1.0, np.array([-1.0, 1.0, -1.0, 1.0]))
    assert field.detection(np.array([[1.0], [-1.0]]), np.zeros((1, 4)))[0, 0] == 1.0


def test_sector_looks_along_yaw_and_across_the_seam_of_angles() -> None:
    field = FieldOfView(2, "sector", 0.8, np.array([1.0, 5.0, np.radians(60.0)]))
    pose = np.array([[0.0, 0.0, 0.0, np.pi - 0.1]])
    bearings = np.pi - 0.1 + np.radians([0.0, 29.0, -29.0, 31.0, -31.0])
    seen = field.detection(3.0 * np.stack([np.cos(bearings), np.sin(bearings)]), pose)[0]
    assert seen.tolist() == [0.8, 0.8, 0.8, 0.0, 0.0]
    near_and_far = field.detection(np.array([[-0.5, -6.0], [0.0, 0.0]]), pose)[0]
    assert near_and_far.tolist() == [0.0, 0.0]


def test_a_table_over_range_is_linear_between_its_breaks() -> None:
    breaks, gains = np.array([1.0, 3.0, 4.0]), np.array([0.5, 1.0, 0.2])
    field = FieldOfView(2, "sector", 0.8, np.array([0.0, 9.0, 2 * np.pi]), False, breaks, gains)
    ranges = np.array([0.0, 0.5, 1.0, 2.0, 3.5, 4.0, 8.0])
    seen = field.detection(np.stack([ranges, 0 * ranges]), np.zeros(4))[0]
    assert np.allclose(seen, 0.8 * np.interp(ranges, breaks, gains))


def test_heights_do_not_matter_in_two_dimensions() -> None:
    field = FieldOfView(2, "exponential", 0.9, np.array([5.0, 5.0]))
    points = RNG.uniform(-5, 5, (2, 10))
    high = POSES + np.array([0.0, 0.0, 100.0, 0.0])
    assert np.array_equal(field.detection(points, POSES), field.detection(points, high))


@pytest.mark.parametrize(
    ("ahead", "left", "drone", "turtlebot"),
    [(0.15, 0.15, 1.0, 1.0), (-0.15, 0.15, 1.0, 0.0), (-0.05, -0.05, 1.0, 1.0), (0.21, 0.0, 0.0, 0.0)],
)
def test_the_papers_drone_looks_all_around_and_its_ground_robot_ahead(
    ahead: float, left: float, drone: float, turtlebot: float
) -> None:
    point, pose = np.array([[1.0 + ahead], [2.0 + left]]), np.array([1.0, 2.0, 1.0, 0.0])
    around = FieldOfView(2, "box", 1.0, np.array([-0.2, 0.2, -0.2, 0.2]))  # (25)
    off_centre = FieldOfView(2, "box", 1.0, np.array([-0.1, 0.2, -0.1, 0.2]))  # (34)
    assert around.detection(point, pose)[0, 0] == drone
    assert off_centre.detection(point, pose)[0, 0] == turtlebot


SMOOTH = np.array([1.0, 10.0, 2 * np.pi / 3])  # alpha_1, alpha_2, opening of Liu & Hedrick fig. 3


@pytest.mark.parametrize("d", [2, 3])
def test_smooth_sector_is_equation_7(d: int) -> None:
    points = RNG.uniform(-6, 6, (d, 200))
    seen = FieldOfView(d, "smooth_sector", 1.0, SMOOTH).detection(points, POSES)
    for pose, values in zip(POSES, seen, strict=True):
        offset = points - pose[:d, None]
        turn = np.arctan2(offset[1], offset[0]) - pose[3]
        expected = 1 / (1 + (offset**2).sum(axis=0)) / (1 + np.exp(-10 * (np.cos(turn) - np.cos(np.pi / 3))))
        assert np.allclose(values, expected, rtol=1e-10)


def test_smooth_sector_halves_at_its_range_and_at_its_edge() -> None:
    field = FieldOfView(2, "smooth_sector", 1.0, np.array([1 / 16.0, 200.0, np.pi / 2]))
    pose, edge = np.array([0.0, 0.0, 0.0, 0.3]), 0.3 + np.pi / 4
    ahead, aside = np.array([np.cos(0.3), np.sin(0.3)]), np.array([np.cos(edge), np.sin(edge)])
    seen = field.detection(np.stack([4.0 * ahead, 1e-9 * aside], axis=1), pose)[0]
    assert seen == pytest.approx([0.5, 0.5], abs=1e-6)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("shape", ["exponential", "smooth_sector"])
def test_slopes_are_the_differences_of_the_detection_probability(d: int, shape: str) -> None:
    size = SMOOTH if shape == "smooth_sector" else np.array([5.0, 7.0, 9.0])[:d]
    field = FieldOfView(d, shape, 0.9, size)  # type: ignore[arg-type]
    points = RNG.uniform(-6, 6, (d, 100))
    slopes = field.slopes(points, POSES)
    for a in range(4):
        step = 1e-6 * np.eye(4)[a]
        rise = field.detection(points, POSES + step) - field.detection(points, POSES - step)
        assert np.allclose(slopes[..., a], rise / 2e-6, atol=1e-7)
    for a in range(d):
        step = 1e-6 * np.eye(d)[:, [a]]
        rise = field.detection(points + step, POSES) - field.detection(points - step, POSES)
        assert np.allclose(-slopes[..., a], rise / 2e-6, atol=1e-7)


@pytest.mark.parametrize("shape", ["exponential", "smooth_sector"])
def test_slopes_on_the_sensor_and_above_it_are_finite(shape: str) -> None:
    field = FieldOfView(3, shape, 0.9, SMOOTH)  # type: ignore[arg-type]
    above = POSES[0, :3, None] + np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 2.0]])
    assert np.isfinite(field.slopes(above, POSES[0])).all()
    assert np.isfinite(field.detection(above, POSES[0])).all()


def test_a_field_with_edges_or_factors_has_no_slopes() -> None:
    ones = np.ones(2)
    for field in (
        FieldOfView(2, "box", 1.0, np.array([-1.0, 1.0, -1.0, 1.0])),
        FieldOfView(2, "exponential", 1.0, ones, False, ones, ones),
        FieldOfView(2, "exponential", 1.0, ones, beam=3.0),
    ):
        with pytest.raises(ValueError, match="field_of_view"):
            field.slopes(np.zeros((2, 1)), np.zeros(4))


def test_beams_leave_gaps_from_the_range_on_at_which_a_target_fits_between() -> None:
    field = FieldOfView(3, "sector", 0.8, np.array([0.0, 9.0, 2 * np.pi]), beam=3.0)
    ranges = np.array([0.0, 2.0, 3.0, 4.0, 6.0, 10.0])
    seen = field.detection(np.stack([0 * ranges, 0 * ranges, ranges]), np.zeros(4))[0]
    assert np.allclose(seen, [0.8, 0.8, 0.8, 0.6, 0.4, 0.0])


@pytest.mark.parametrize("shape", ["exponential", "box", "sector", "smooth_sector"])
def test_outlines_are_closed_and_inside_the_field(shape: str) -> None:
    size = {
        "exponential": [3.0, 3.0],
        "box": [-1.0, 2.0, -1.0, 1.0],
        "sector": [0.5, 3.0, 1.0],
        "smooth_sector": [0.1, 100.0, 1.0],
    }[shape]
    field = FieldOfView(2, shape, 1.0, np.array(size), True)  # type: ignore[arg-type]
    outline = field.outline(POSES[0])
    assert np.allclose(outline[0], outline[-1])
    inward = POSES[0, :3] + np.array([np.cos(0.4), np.sin(0.4), 0.0])  # one metre ahead, inside each
    inside = inward + (outline - inward) * (1 - 1e-9)
    assert (field.detection(inside[:, :2].T, POSES[0])[0] > 0.3).mean() > 0.5


@pytest.mark.parametrize(
    ("points", "poses", "name"),
    [
        (np.zeros((3, 4)), np.zeros(4), "points"),
        (np.zeros((2, 4)), np.zeros(3), "pose"),
        (np.zeros((2, 4)), np.array([0.0, np.nan, 0.0, 0.0]), "pose"),
    ],
)
def test_bad_input_is_refused_by_name(points: np.ndarray, poses: np.ndarray, name: str) -> None:
    with pytest.raises(ValueError, match=name):
        FieldOfView(2, "exponential", 1.0, np.ones(2)).detection(points, poses)
