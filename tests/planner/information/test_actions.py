import numpy as np
import pytest

from estimator.filter import Area
from planner.information.actions import ActionSet, Scales, action_set, evenly, looks_along, part
from planner.vehicles.quadrotor import Quadrotor
from planner.vehicles.unicycle import Unicycle

AREA = Area(np.zeros(2), np.array([20.0, 14.0]))
SCALES = Scales(first=3.0, growth=1.2, most=30, steps=3, spread=0.75)
POSE = np.array([10.0, 7.0, 0.0, 0.5])


def sets(pose: np.ndarray = POSE, area: Area = AREA) -> list[ActionSet]:
    """Those of each length scale."""
    found = action_set(pose, area, SCALES, turns=True)
    return [
        ActionSet(found.lengths[rows], found.poses[rows], tuple(found.corners[i] for i in rows))
        for _, rows in found.scales
    ]


def test_scales_grow_from_the_first_until_the_area_has_no_place_left() -> None:
    lengths = [s.lengths[0] for s in sets()]
    np.testing.assert_allclose(lengths, 3.0 * 1.2 ** np.arange(len(lengths)))
    assert lengths[-1] <= np.hypot(10, 7) < lengths[-1] * 1.2**2


def test_goals_lie_at_their_length_in_the_area_and_apart() -> None:
    for actions in sets():
        goals = np.array([way[:, -1] for way in actions.corners])
        np.testing.assert_allclose(np.linalg.norm(goals - POSE[:2], axis=1), actions.lengths[0])
        assert AREA.is_free(goals.T).all()
        gaps = np.linalg.norm(goals[:, None] - goals, axis=2) + 1e9 * np.eye(len(goals))
        assert gaps.min() >= SCALES.spread * actions.lengths[0] - 1e-9


def test_every_place_of_a_scale_is_near_a_goal() -> None:
    """Algorithm 1 goes on until all places are dropped."""
    for actions in sets():
        goals = np.array([way[:, -1] for way in actions.corners])
        angles = POSE[3] + 2 * np.pi * np.arange(48) / 48
        ring = POSE[:2] + actions.lengths[0] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        ring = ring[((ring >= AREA.low) & (ring <= AREA.high)).all(axis=1)]
        assert (
            np.linalg.norm(ring[:, None] - goals, axis=2).min(axis=1) < SCALES.spread * actions.lengths[0]
        ).all()


def test_an_action_is_evenly_spaced_along_a_way_with_corners() -> None:
    corners = np.array([[0.0, 3.0, 3.0], [0.0, 0.0, 6.0]])
    poses = evenly(corners, 3, np.zeros(4), True)
    np.testing.assert_allclose(poses[:, :2], [[3, 0], [3, 3], [3, 6]])
    np.testing.assert_allclose(poses[:, 3], [0, np.pi / 2, np.pi / 2])
    assert (evenly(corners, 3, np.full(4, 0.3), False)[:, 3] == 0.3).all()


def test_a_part_of_a_way_ends_at_its_share_of_the_length() -> None:
    corners = np.array([[0.0, 3.0, 3.0], [0.0, 0.0, 6.0]])
    np.testing.assert_allclose(part(corners, 2 / 3), [[0, 3, 3], [0, 0, 3]])
    np.testing.assert_allclose(part(corners, 1.0), corners)


def test_in_three_dimensions_goals_lie_on_a_sphere() -> None:
    area = Area(np.zeros(3), np.full(3, 20.0))
    first = sets(np.array([10.0, 10.0, 10.0, 0.0]), area)[0]
    goals = np.array([way[:, -1] for way in first.corners])
    np.testing.assert_allclose(np.linalg.norm(goals - 10.0, axis=1), 3.0)
    assert np.ptp(goals[:, 2]) > 3.0


@pytest.mark.parametrize("place", [[1e6, 0, 0, 0], [-50, -50, 0, 0]])
def test_from_far_outside_there_is_no_action(place: list[float]) -> None:
    assert all(s.lengths[0] > 50 for s in sets(np.array(place, dtype=float)))


def test_an_area_smaller_than_a_step_has_no_action() -> None:
    assert sets(np.full(4, 0.005), Area(np.zeros(2), np.full(2, 0.01))) == []


def test_ground_robots_look_along_their_way_and_drones_do_not() -> None:
    assert looks_along(Unicycle(Unicycle.Config()))
    assert not looks_along(Quadrotor(Quadrotor.Config()))
