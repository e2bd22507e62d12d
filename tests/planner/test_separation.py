import dataclasses

import numpy as np
import pytest

from planner.plan import Commitment
from planner.separation import SOON_S, Courses, clearances, keeps_apart, meets_soon
from tests.planner import contract


def other(times, poses):
    poses = np.array(poses, dtype=float)
    return Commitment("b", 1, np.zeros(0), np.zeros((0, 4)), np.array(times, dtype=float), poses, 1.0)


def way(points, step=0.25):
    """One candidate with samples every `step` seconds; the last point is its end."""
    points = np.array(points, dtype=float)
    count = len(points) - 1
    poses = np.column_stack([points[:-1], np.zeros(count)])
    return (
        np.array([0, count]),
        np.arange(count) * step,
        poses,
        np.array([count * step]),
        points[-1:],
    )


def test_crossing_between_samples_is_seen():
    samples = way([[0, 0, 0], [2, 0, 0], [4, 0, 0]])
    crossing = other([5.0, 5.5], [[4, 0.3, 0, 0], [0, 0.3, 0, 0]])
    assert clearances(5.0, *samples, crossing)[0] == pytest.approx(0.3)


def test_other_counts_where_it_stands_in_the_end():
    samples = way([[i, 0, 0] for i in range(11)])
    standing = other([0.0, 1.0], [[10, 50, 0, 0], [10, 2, 0, 0]])
    assert clearances(5.0, *samples, standing)[0] == pytest.approx(2.0)


def test_same_place_at_another_time_is_no_meeting():
    samples = way([[i, 0, 0] for i in range(11)])  # at 5 after 1.25 s
    passing = other([0.0, 1.25, 2.5], [[0, 40, 0, 0], [0, 20, 0, 0], [0, 0, 0, 0]])
    assert clearances(0.0, *samples, passing)[0] > 9


def test_robot_of_unknown_whereabouts_is_infinitely_far():
    assert clearances(0.0, *way([[0, 0, 0], [1, 0, 0]]), other([], np.zeros((0, 4))))[0] == np.inf


@pytest.mark.parametrize("seed", range(5))
def test_agrees_with_dense_sampling(seed):
    rng = np.random.default_rng(seed)
    samples = way(rng.uniform(0, 10, (8, 3)))
    times = np.sort(rng.uniform(0, 2, 5))
    poses = rng.uniform(0, 10, (5, 4))
    dense = np.linspace(0, samples[3][0], 20001)
    own_times = np.append(samples[1], samples[3])
    own = np.vstack([samples[2][:, :3], samples[4]])
    gap = [
        np.interp(dense, own_times, own[:, axis]) - np.interp(dense, times, poses[:, axis])
        for axis in range(3)
    ]
    dense_least = np.linalg.norm(gap, axis=0).min()
    # between own samples the other is taken straight: refine them so that its corners are among them
    refined_times = np.unique(np.concatenate([own_times, times[times < own_times[-1]]]))
    refined = np.column_stack([np.interp(refined_times, own_times, own[:, axis]) for axis in range(3)])
    count = len(refined_times) - 1
    least = clearances(
        0.0,
        np.array([0, count]),
        refined_times[:-1],
        np.column_stack([refined[:-1], np.zeros(count)]),
        refined_times[-1:],
        refined[-1:],
        other(times, poses),
    )[0]
    assert least == pytest.approx(dense_least, abs=2e-3)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("kind", ["drones_2d", "ground_2d", "drones_3d"])
def test_what_meets_soon_does_not_keep_apart_and_nothing_else_does_so_within_those_seconds(
    kind: str, seed: int
) -> None:
    setup = contract.team(kind)
    problem = contract.ordinary(setup, seed)
    rng = np.random.default_rng(seed)
    vehicle, height = setup.vehicles["a"], float(kind == "drones_3d") * 8.0
    here = vehicle.pose(problem.state)[:3]
    found = []
    for _ in range(12):
        place = here + np.append(rng.uniform(-12, 12, 2), 0.0)
        near = contract.standing("x", *(here[:2] + rng.uniform(-8, 8, 2)), height)
        asked = dataclasses.replace(problem, others=(near,), separation=3.0)
        courses = Courses.of(asked.others)
        soon = meets_soon(asked, vehicle, place, courses)
        whole = vehicle.trajectory(problem.state, place, problem.start_time, problem.measure_period)
        late = keeps_apart(asked, vehicle, whole, courses)
        assert not (soon and late), (kind, seed, place, near.poses)
        if len(whole.times) > 2 and whole.end_time - whole.start_time < SOON_S - 0.5 and not soon:
            # all but the last piece of such a way was looked at
            cut = dataclasses.replace(
                whole, times=whole.times[:-1], poses=whole.poses[:-1], end_time=float(whole.times[-2])
            )
            assert keeps_apart(asked, vehicle, cut, courses)
        found.append(soon)
    assert any(found) or seed  # the first seed has some of them
