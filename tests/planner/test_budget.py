import dataclasses
import math

import numpy as np
import pytest

from planner.budget import affordable, homeward, metres, returning, truncated
from planner.plan import Budget
from planner.vehicles.route import routed
from tests.planner import contract


def given(budget: Budget, name: str = "drones_2d"):
    setup = contract.team(name)
    problem = dataclasses.replace(contract.ordinary(setup), others=(), budget=budget)
    return setup, problem


def long_way(setup, problem):
    route = np.array([[50.0, 18.0, 0.0], [50.0, 50.0, 0.0], [10.0, 50.0, 0.0]])
    vehicle = setup.vehicles["a"]
    return routed(vehicle, problem.state, route, problem.start_time, 1.0, near=1.0)


@pytest.mark.parametrize("name", ["drones_2d", "ground_2d"])
def test_energy_is_that_of_the_way_and_of_the_way_home(name: str) -> None:
    home = np.array([12.0, 40.0, 0.0])
    setup, problem = given(Budget(energy=1e9, home=home), name)
    way, power = long_way(setup, problem), setup.vehicles["a"].config.power
    back = homeward(problem, setup, way.end_state, way.end_time)
    whole = power.rest_w * (way.end_time - way.start_time + back.seconds)
    whole += power.metre_j * (metres(way) + back.metres)  # on level ground
    for budget, fits in ((whole + 1e-3, True), (whole - 1e-3, False)):
        limited = dataclasses.replace(problem, budget=Budget(energy=budget, home=home))
        assert affordable(limited, setup, way) == fits
    for share in (0.3, 0.7):
        limited = dataclasses.replace(problem, budget=Budget(energy=share * whole, home=home))
        part = truncated(limited, setup, way)
        assert part is not None
        assert affordable(limited, setup, part)


@pytest.mark.parametrize("name", ["drones_2d", "ground_2d"])
def test_a_way_costs_its_length_and_time_and_those_of_the_way_home(name: str) -> None:
    home = np.array([12.0, 40.0, 0.0])
    setup, problem = given(Budget(distance=1e4, home=home), name)
    way = long_way(setup, problem)
    # Straight legs of 38 + 32 + 40 m; corners are cut by at most the metre within which they are passed.
    assert metres(way) == pytest.approx(110.0, abs=3.0)
    back = homeward(problem, setup, way.end_state, way.end_time)
    length, seconds = back.metres, back.seconds
    assert length == pytest.approx(math.hypot(2.0, 10.0), rel=0.15)
    assert seconds > length / 5.0
    whole = metres(way) + length
    for budget, fits in ((whole + 0.01, True), (whole - 0.01, False)):
        limited = dataclasses.replace(problem, budget=Budget(distance=budget, home=home))
        assert affordable(limited, setup, way) == fits
    time = way.end_time - way.start_time + seconds
    for budget, fits in ((time + 1e-6, True), (time - 1e-3, False)):
        limited = dataclasses.replace(problem, budget=Budget(time=budget, home=home))
        assert affordable(limited, setup, way) == fits


@pytest.mark.parametrize("budget", [20.0, 60.0, 95.0, 120.0, 1000.0])
@pytest.mark.parametrize("home", [None, (12.0, 18.0, 0.0)])
@pytest.mark.parametrize("name", ["drones_2d", "ground_2d"])
def test_a_way_is_cut_where_its_budget_ends(budget: float, home, name: str) -> None:
    setup, problem = given(Budget(distance=budget, home=None if home is None else np.array(home)), name)
    way = long_way(setup, problem)
    part = truncated(problem, setup, way)
    assert part is not None
    assert affordable(problem, setup, part)
    contract.check(contract.Plan(part, "cut"), problem, setup)
    back = homeward(problem, setup, part.end_state, part.end_time).metres
    whole = homeward(problem, setup, way.end_state, way.end_time).metres
    assert metres(part) + back > 0.6 * min(budget, metres(way) + whole)  # not much is given away
    near = np.linalg.norm(way.poses[:, None, :2] - part.poses[None, :, :2], axis=2).min(axis=0)
    assert near.max() < 2.0  # it is a part of the same way


def test_an_affordable_way_is_left_as_it_is_and_of_nothing_nothing_is_left() -> None:
    setup, problem = given(Budget())
    way = long_way(setup, problem)
    assert truncated(problem, setup, way) is way
    spent = dataclasses.replace(problem, budget=Budget(distance=0.0))
    assert truncated(spent, setup, way) is None


def test_with_nothing_better_to_do_it_returns_home_and_holds_there() -> None:
    home = np.array([30.0, 18.0, 0.0])
    setup, problem = given(Budget(distance=50.0, home=home))
    plan = returning(problem, setup, "there is nothing")
    assert plan.trajectory is not None
    assert setup.vehicles["a"].reached(plan.trajectory.end_state, home)
    assert "there is nothing" in plan.reason
    there = dataclasses.replace(problem, state=plan.trajectory.end_state)
    assert returning(there, setup, "there is nothing").trajectory is None
    poor = dataclasses.replace(problem, budget=Budget(distance=10.0, home=home))
    assert "beyond its budget" in returning(poor, setup, "there is nothing").reason
    guarded = dataclasses.replace(problem, others=(contract.standing("b", *home),), separation=5.0)
    assert "in the way" in returning(guarded, setup, "there is nothing").reason
