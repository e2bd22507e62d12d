import dataclasses

import numpy as np
import pytest

from planner.baselines.thompson import Thompson
from planner.plan import Intensity
from tests.planner import contract


def spread(points, weights):
    d = len(points)
    none = Intensity.empty(d)
    return dataclasses.replace(none, points=np.array(points, float), weights=np.array(weights, float))


def test_draws_are_a_poisson_process_of_the_intensity() -> None:
    setup = contract.team("drones_2d")
    problem = dataclasses.replace(
        contract.ordinary(setup), intensity=spread([[10, 50], [10, 50]], [1.0, 3.0])
    )
    planner, rng = Thompson(Thompson.Config(), setup), np.random.default_rng(0)
    draws = [planner.drawn(problem, rng) for _ in range(4000)]
    counts = np.array([draw.shape[1] for draw in draws])
    none = np.exp(-4.0)  # then one is drawn all the same
    assert counts.mean() == pytest.approx(4.0 + none, abs=0.12)
    assert (counts == 2).mean() == pytest.approx(8.0 * none, abs=0.03)
    far = np.concatenate([draw[0] > 30 for draw in draws]).mean()
    assert far == pytest.approx(0.75, abs=0.02)


def test_the_way_detects_most_of_the_draw_per_second() -> None:
    setup = contract.team("drones_2d", "a")
    problem = dataclasses.replace(contract.ordinary(setup), others=())
    planner = Thompson(Thompson.Config(), setup)
    targets = planner.drawn(problem, np.random.default_rng(problem.seed))
    vehicle, sensor = setup.vehicles["a"], setup.sensors["a"]
    own = np.zeros((min(8, targets.shape[1]), 3))
    own[:, :2] = targets[:, : len(own)].T
    values = []
    for place in np.vstack([np.clip(own, 0, 60), planner.candidates.waypoints(0.0)]):
        way = vehicle.trajectory(problem.state, place, problem.start_time, 1.0)
        looks = np.vstack([way.measure_poses[1:], vehicle.pose(way.end_state)])
        missed = np.prod(1 - sensor.detection(targets, looks), axis=0)
        values.append((1 - missed).sum() / (way.end_time - way.start_time))
    plan = planner.plan(problem)
    assert plan.objective == pytest.approx(max(values), rel=1e-9)


def test_robots_of_one_belief_part() -> None:
    setup = contract.team("drones_2d")
    problem = dataclasses.replace(contract.AWKWARD["no clusters"](contract.ordinary(setup)), others=())
    planner = Thompson(Thompson.Config(), setup)
    goals = {tuple(planner.plan(dataclasses.replace(problem, seed=s)).trajectory.waypoint) for s in range(9)}
    assert len(goals) > 2


def test_without_an_intensity_it_draws_from_what_is_unexplored() -> None:
    setup = contract.team("drones_2d")
    problem = dataclasses.replace(contract.ordinary(setup), intensity=None)
    only = np.zeros_like(problem.exploration.values)
    only[-1, -1] = 1.0
    given = dataclasses.replace(
        problem, exploration=dataclasses.replace(problem.exploration, values=only), others=()
    )
    drawn = Thompson(Thompson.Config(), setup).drawn(given, np.random.default_rng(0))
    np.testing.assert_array_equal(drawn, [[60.0], [60.0]])
