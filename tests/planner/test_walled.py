"""The contract of every planner on a ground with walls, a keep-out zone and a fence; see `walled`."""

import dataclasses

import numpy as np
import pytest

from agents.plugins import kinds
from planner.budget import metres, way_to
from planner.ground.frame import OPEN, SOLID
from planner.ground.grid_ground import GridGround
from planner.plan import Budget, Plan, PlannerSetup, PlanProblem
from tests.planner import contract, walled

KINDS = kinds("planners")


def planned(kind: str, name: str, setup: PlannerSetup, problem: PlanProblem, leaving: float = 0.0) -> Plan:
    """A plan that has been checked."""
    plan = contract.planner(kind, setup).plan(problem)
    contract.check(plan, problem, setup)
    if plan.trajectory is not None:
        walled.check_clear(plan.trajectory, name.endswith("3d"), leaving)
    return plan


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", walled.SETUPS)
@pytest.mark.parametrize("seed", range(3))
def test_no_way_touches_anything(kind: str, name: str, seed: int) -> None:
    setup = walled.team(name)
    problem = contract.ordinary(setup, seed)
    place = [(12.0, 18.0), (35.0, 30.0), (56.0, 6.0)][seed]
    given = walled.standing_at(problem, setup, place)
    assert planned(kind, name, setup, given).trajectory is not None
    planned(kind, name, setup, dataclasses.replace(given, others=problem.others))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("awkward", contract.AWKWARD)
def test_an_awkward_problem_among_walls_has_a_plan_or_a_reason(kind: str, awkward: str) -> None:
    setup = walled.team("ground_2d")
    planned(kind, "ground_2d", setup, contract.AWKWARD[awkward](contract.ordinary(setup)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", walled.SETUPS)
@pytest.mark.parametrize("place", [walled.IN_THE_HOUSE, walled.IN_THE_POND, (60.0, 60.0), (200.0, 9.0)])
def test_a_robot_in_an_obstacle_or_a_zone_or_beyond_the_fence_holds(
    kind: str, name: str, place: tuple[float, float]
) -> None:
    setup = walled.team(name)
    problem = walled.standing_at(contract.ordinary(setup), setup, place)
    plan = contract.planner(kind, setup).plan(problem)
    assert plan.trajectory is None
    assert plan.reason == "holds: it stands in an obstacle, in a keep-out zone or beyond the fence"


@pytest.mark.parametrize("kind", KINDS)
def test_a_robot_too_near_to_a_wall_gets_away_from_it_or_says_why_not(kind: str) -> None:
    setup = walled.team("ground_2d")
    problem = walled.standing_at(contract.ordinary(setup), setup, walled.BY_THE_HOUSE)
    planned(kind, "ground_2d", setup, problem, leaving=2.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", walled.SETUPS)
@pytest.mark.parametrize("place", [walled.IN_THE_YARD, walled.IN_THE_HOUSE, (59.0, 59.0)])
def test_what_cannot_be_reached_is_not_gone_to(kind: str, name: str, place: tuple[float, float]) -> None:
    """A target in a closed yard, in a house or beyond the fence: a way to somewhere else, or a reason."""
    setup = walled.team(name)
    planned(kind, name, setup, walled.believing(contract.ordinary(setup), place))


@pytest.mark.parametrize("kind", KINDS)
def test_a_robot_in_a_closed_yard_stays_there(kind: str) -> None:
    setup = walled.team("ground_2d")
    problem = walled.standing_at(contract.ordinary(setup), setup, walled.IN_THE_YARD)
    planned(kind, "ground_2d", setup, problem)


@pytest.mark.parametrize("kind", KINDS)
def test_a_robot_without_a_single_candidate_holds_and_says_so(kind: str) -> None:
    """All around the cell in which it stands is blocked."""
    setup = contract.team("ground_2d")
    cells = np.full((1, 120, 120), SOLID, dtype=np.uint8)
    cells[0, 36, 24] = OPEN
    setup = dataclasses.replace(setup, ground=GridGround(cells, 0.5, np.zeros(3)))
    problem = walled.standing_at(contract.ordinary(setup), setup, (12.25, 18.25))
    plan = contract.planner(kind, setup).plan(problem)
    contract.check(plan, problem, setup)
    assert plan.trajectory is None, plan.reason


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "budget", [Budget(distance=45.0, home=np.array([12.0, 18.0, 0.0])), Budget(time=9.0)]
)
def test_no_way_among_walls_exceeds_its_budget(kind: str, budget: Budget) -> None:
    setup = walled.team("ground_2d")
    given = walled.standing_at(contract.ordinary(setup), setup, (16.0, 33.0))
    problem = dataclasses.replace(given, budget=budget)
    plan = planned(kind, "ground_2d", setup, problem)
    way = plan.trajectory
    if way is None:
        return
    length, seconds = metres(way), way.end_time - way.start_time
    if budget.home is not None and not setup.vehicles["a"].reached(way.end_state, budget.home):
        back = way_to(problem, setup, way.end_state, way.end_time, budget.home)
        assert back is not None
        walled.check_clear(back, flies=False)
        length += metres(back)
    assert length <= budget.distance + contract.SLACK
    assert seconds <= budget.time + 1e-9


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("deadline", [0.0005, 0.004, 0.02])
def test_ways_that_were_found_in_a_hurry_touch_nothing_either(kind: str, deadline: float) -> None:
    setup = walled.team("ground_2d")
    planner = contract.planner(kind, setup)
    problem = walled.standing_at(contract.ordinary(setup), setup, (12.0, 18.0))
    planner.plan(dataclasses.replace(problem, start_time=4.0))
    for k in range(3):
        hurried = dataclasses.replace(problem, start_time=5.0 + k, deadline_s=deadline)
        plan = planner.plan(hurried)
        contract.check(plan, hurried, setup)
        if plan.trajectory is not None:
            walled.check_clear(plan.trajectory, flies=False)


def test_the_checks_can_fail() -> None:
    setup = walled.team("ground_2d")
    vehicle, problem = setup.vehicles["a"], contract.ordinary(setup)
    through = vehicle.trajectory(problem.state, np.array([35.0, 18.0, 0.0]), 5.0, 1.0)
    with pytest.raises(AssertionError):
        walled.check_clear(through, flies=False)
    out = vehicle.trajectory(
        contract.state(setup, "a", 50.0, 50.0, 0.0), np.array([60.0, 60.0, 0.0]), 5.0, 1.0
    )
    with pytest.raises(AssertionError):
        walled.check_clear(out, flies=False)
