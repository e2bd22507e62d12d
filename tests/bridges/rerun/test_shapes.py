"""Shapes for the view, against what they stand for."""

import numpy as np
import pytest

from bridges.rerun import shapes


def rotation(quaternion: np.ndarray) -> np.ndarray:
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.mark.parametrize("seed", range(20))
def test_ellipsoid_has_the_covariance_it_was_made_of(seed: int) -> None:
    root = np.random.default_rng(seed).standard_normal((3, 3))
    covariance = root @ root.T

    half, quaternion = shapes.ellipsoid(covariance, sigmas=1.0)
    turn = rotation(quaternion)

    np.testing.assert_allclose(turn @ np.diag(half**2) @ turn.T, covariance, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_ellipse_lies_where_the_mahalanobis_distance_is_the_sigmas(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root, mean = rng.standard_normal((2, 2)), rng.standard_normal(2)
    covariance = root @ root.T

    gap = shapes.ellipse(mean, covariance, height=0.5, sigmas=2.0)[:, :2] - mean

    distance = np.einsum("ki,ij,kj->k", gap, np.linalg.inv(covariance), gap)
    np.testing.assert_allclose(distance, 4.0, rtol=1e-6)


def test_exploration_image_has_square_pixels_and_north_up() -> None:
    values = np.zeros((3, 5), np.uint8)
    values[0, 4] = 255  # west, north

    image = shapes.exploration_image(values, np.array([100.0, 50.0]), longest=40)

    assert image.shape == (20, 40, 3)
    blue = image[..., 2].astype(int)
    assert np.unravel_index(blue.argmax(), blue.shape) == (0, 0)
    assert blue[-1, -1] == shapes.BACKGROUND[2]


def test_unexplored_points_stay_few_and_inside() -> None:
    low, high = np.zeros(3), np.array([10.0, 20.0, 30.0])

    points = shapes.unexplored_points(np.full((27, 27, 27), 255, np.uint8), low, high, 3000)

    assert 1000 < len(points) <= 3000
    assert (points >= low).all()
    assert (points <= high).all()


def test_trail_stays_bounded_and_keeps_its_beginning() -> None:
    trail = shapes.Trail(spacing=0.5, longest=50)
    for step in range(5000):
        trail.add(np.array([0.6 * step, 0.0, 0.0]))

    assert len(trail.points) <= 50
    assert trail.points[0][0] == 0.0


def test_local_mass_of_one_cell_is_what_lies_in_it() -> None:
    points = np.array([[0.1, 0.2, 99.0], [0.1, 0.2, 99.0]])

    mass = shapes.local_mass(points, np.array([0.25, 0.5, 1.0]), np.zeros(2), np.full(2, 100.0))

    np.testing.assert_allclose(mass, [0.75, 0.75, 1.0])


def test_first_hundred_robots_have_colours_of_their_own() -> None:
    assert len({shapes.robot_colour(index) for index in range(100)}) >= 95


@pytest.mark.parametrize(("about", "step"), [(50.0, 50.0), (49.0, 20.0), (1.7, 1.0), (0.3, 0.2)])
def test_grid_distance_is_a_round_number(about: float, step: float) -> None:
    assert shapes.round_step(about) == pytest.approx(step)
