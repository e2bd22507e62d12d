import dataclasses

import numpy as np
import pytest

from planner.baselines.as_steps import AsSteps
from tests.planner.problems import committed, interpolated, problem, slow_looks, team


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_it_steps_to_the_neighbour_with_the_best_single_look(seed: int, dimension: int) -> None:
    setup = team(dimension)
    vehicle, sensor = setup.vehicles["a"], setup.sensors["a"]
    there = vehicle.trajectory(
        vehicle.initial_state(np.array([30.0, 30.0, 30.0, 0.0])), np.array([10.0, 10.0, 10.0]), 2.0, 1.0
    )
    given = problem(setup, seed, others=[committed(there)], start=[20.0, 18.0, 22.0])
    planner = AsSteps(AsSteps.Config(alpha=0.3, beta=0.8, step_m=5.0), setup)
    here = given.state[:3]
    e = given.exploration
    axes = [np.linspace(e.low[i], e.high[i], n) for i, n in enumerate(e.values.shape)]
    grid = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")])
    best = []
    for axis in range(dimension):
        for sign in (1, -1):
            goal = here + sign * 5.0 * np.eye(3)[axis]
            way = vehicle.trajectory(given.state, goal, given.start_time, 1.0)
            pose = vehicle.pose(way.end_state)
            values = e.values.ravel().copy()
            for when, where in slow_looks(committed(there), given.start_time, 60.0):
                if when <= way.end_time + 1e-6:
                    values *= 1 - sensor.detection(grid, where[None])[0]
            unexplored = interpolated(values.reshape(e.values.shape), e.low, e.high, pose[:dimension])
            gain = 0.3 * sensor.detection(given.clusters, pose[None]).sum() + 0.8 * unexplored
            best.append((gain, goal))
    gain, goal = max(best, key=lambda pair: pair[0])
    plan = planner.plan(given)
    np.testing.assert_allclose(plan.trajectory.waypoint, goal)
    assert plan.objective == pytest.approx(gain, rel=1e-9)
    assert len(plan.trajectory.measure_times) == 1


def test_it_stays_in_the_area_and_comes_back_into_it() -> None:
    setup = team(2)
    planner = AsSteps(AsSteps.Config(step_m=10.0), setup)
    corner = planner.plan(problem(setup, 0, start=[1.0, 1.0, 5.0]))
    assert (corner.trajectory.waypoint[:2] >= 0).all()
    outside = planner.plan(problem(setup, 0, start=[-30.0, 20.0, 5.0]))
    np.testing.assert_allclose(outside.trajectory.waypoint, [0.0, 20.0, 5.0])


def test_equal_neighbours_are_drawn_from() -> None:
    setup = team(2)
    given = problem(setup, 0, clusters=0, start=[20.0, 20.0, 5.0])
    flat = dataclasses.replace(given.exploration, values=np.zeros_like(given.exploration.values))
    planner = AsSteps(AsSteps.Config(), setup)
    goals = {
        tuple(planner.plan(dataclasses.replace(given, exploration=flat, seed=s)).trajectory.waypoint)
        for s in range(40)
    }
    assert len(goals) == 4
