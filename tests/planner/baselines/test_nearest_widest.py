import dataclasses

import numpy as np

from estimator.exploration import Exploration
from planner.baselines.nearest_widest import NearestWidest
from planner.plan import Intensity
from tests.planner import contract


def given(clusters, widths, explored=True):
    setup = contract.team("drones_2d")
    problem = dataclasses.replace(contract.ordinary(setup), others=())
    means = np.array(clusters, float).T
    covariances = np.stack([w**2 * np.eye(2) for w in widths])
    known = Intensity(means, np.ones(len(widths)), means, covariances, np.ones(len(widths)))
    e = problem.exploration
    values = np.zeros_like(e.values) if explored else np.ones_like(e.values)
    unexplored = Exploration(values, e.low, e.high)
    return setup, dataclasses.replace(problem, clusters=means, intensity=known, exploration=unexplored)


def visits(setup, problem, count):
    planner, places = NearestWidest(NearestWidest.Config(), setup), []
    for _ in range(count):
        way = planner.plan(problem).trajectory
        places.append(tuple(way.waypoint[:2]))
        problem = dataclasses.replace(problem, state=way.end_state, start_time=way.end_time)
    return places


def test_nearest_and_widest_take_turns() -> None:
    a, b, c = (15.0, 20.0), (30.0, 25.0), (50.0, 50.0)  # from (12, 18)
    setup, problem = given([a, b, c], [1.0, 2.0, 5.0])
    # Nearest a, widest c, nearest to c is b, widest c again.
    assert visits(setup, problem, 4) == [a, c, b, c]


def test_one_that_it_stands_on_is_passed_over() -> None:
    a, b = (12.0, 18.0), (30.0, 25.0)
    setup, problem = given([a, b], [1.0, 1.0])
    assert visits(setup, problem, 1) == [b]


def test_the_unexplored_is_wide_and_is_searched_even_without_a_cluster() -> None:
    a = (15.0, 20.0)
    setup, problem = given([a], [1.0], explored=False)
    first, second = visits(setup, problem, 2)
    assert first == a
    assert second != a
    none = dataclasses.replace(problem, clusters=np.zeros((2, 0)), intensity=Intensity.empty(2))
    assert "unexplored region" in NearestWidest(NearestWidest.Config(), setup).plan(none).reason


def test_each_robot_has_its_own_turn() -> None:
    a, b = (15.0, 20.0), (50.0, 50.0)
    setup, problem = given([a, b], [1.0, 5.0])
    planner = NearestWidest(NearestWidest.Config(), setup)
    assert "nearest" in planner.plan(problem).reason
    assert "nearest" in planner.plan(dataclasses.replace(problem, robot="b")).reason
    assert "widest" in planner.plan(problem).reason


def test_with_nothing_left_it_holds() -> None:
    setup, problem = given([(15.0, 20.0)], [1.0])
    none = dataclasses.replace(problem, clusters=np.zeros((2, 0)), intensity=Intensity.empty(2))
    plan = NearestWidest(NearestWidest.Config(), setup).plan(none)
    assert plan.trajectory is None
    assert "nothing is unexplored" in plan.reason
