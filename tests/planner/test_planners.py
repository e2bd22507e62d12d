"""The contract of every planner that is installed under searchparty.planners; see `contract`."""

import dataclasses
import math

import numpy as np
import pytest

from agents.plugins import kinds, load
from planner.plan import Budget, Plan, TeamPlanner
from tests.planner import contract

KINDS = kinds("planners")
JOINT = [kind for kind in KINDS if hasattr(load("planners", kind), "plan_jointly")]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("setup_name", contract.SETUPS)
def test_an_ordinary_problem_is_given_a_way(kind: str, setup_name: str) -> None:
    setup = contract.team(setup_name)
    problem = contract.ordinary(setup)
    plan = contract.planner(kind, setup).plan(problem)
    contract.check(plan, problem, setup)
    assert (plan.trajectory is not None) == (setup_name not in contract.ELSEWHERE.get(kind, set())), plan


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("awkward", contract.AWKWARD)
def test_an_awkward_problem_has_a_plan_or_a_reason(kind: str, awkward: str) -> None:
    for setup_name in contract.SETUPS:
        setup = contract.team(setup_name)
        problem = contract.AWKWARD[awkward](contract.ordinary(setup))
        plan = contract.planner(kind, setup).plan(problem)
        contract.check(plan, problem, setup)
        if "finite" in awkward or "zero" in awkward or awkward in ("budget spent", "unknown robot"):
            assert plan.trajectory is None


@pytest.mark.parametrize("kind", KINDS)
def test_an_area_smaller_than_a_step_has_a_plan_or_a_reason(kind: str) -> None:
    for setup_name in contract.SETUPS:
        setup = contract.team(setup_name, side=0.01)
        problem = dataclasses.replace(contract.ordinary(setup), others=())
        contract.check(contract.planner(kind, setup).plan(problem), problem, setup)


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_problem_has_the_same_plan(kind: str) -> None:
    setup = contract.team("drones_2d")
    problem = contract.ordinary(setup)
    contract.same(contract.planner(kind, setup).plan(problem), contract.planner(kind, setup).plan(problem))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("setup_name", ["drones_2d", "ground_2d"])
@pytest.mark.parametrize(
    "budget",
    [
        Budget(distance=30.0, home=np.array([12.0, 18.0, 0.0])),
        Budget(time=12.0, home=np.array([5.0, 5.0, 0.0])),
        Budget(distance=12.0, time=9.0),
    ],
    ids=["distance", "time", "both, without a home"],
)
def test_no_plan_exceeds_its_budget(kind: str, seed: int, budget: Budget, setup_name: str) -> None:
    setup = contract.team(setup_name)
    problem = dataclasses.replace(contract.ordinary(setup, seed), budget=budget)
    plan = contract.planner(kind, setup).plan(problem)
    contract.check(plan, problem, setup)
    way = plan.trajectory
    if way is None:
        return
    metres, seconds = contract.travelled(way), way.end_time - way.start_time
    if budget.home is not None:
        vehicle = setup.vehicles[problem.robot]
        if not vehicle.reached(way.end_state, budget.home):
            back = vehicle.trajectory(way.end_state, budget.home, way.end_time, 1.0)
            metres += contract.travelled(back)
            seconds += back.end_time - back.start_time
    assert metres <= budget.distance + contract.SLACK
    assert seconds <= budget.time + 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_a_robot_alone_in_a_team_of_two_hundred_is_planned_for(kind: str) -> None:
    setup = contract.team("drones_2d")
    many = {f"x{i}": setup.vehicles["a"] for i in range(200)}
    eyes = {f"x{i}": setup.sensors["a"] for i in range(200)}
    setup = dataclasses.replace(setup, vehicles=setup.vehicles | many, sensors=setup.sensors | eyes)
    problem = contract.AWKWARD["two hundred others"](contract.ordinary(setup))
    contract.check(contract.planner(kind, setup).plan(problem), problem, setup)


@pytest.mark.parametrize("kind", JOINT)
def test_a_team_planner_has_one_plan_for_each_robot(kind: str) -> None:
    setup = contract.team("drones_2d", "ab")
    planner = contract.planner(kind, setup)
    assert isinstance(planner, TeamPlanner)
    first = contract.ordinary(setup)
    side = contract.SIDE
    second = dataclasses.replace(
        first, robot="b", state=contract.state(setup, "b", 0.8 * side, 0.8 * side, 0.0), others=()
    )
    problems = (dataclasses.replace(first, others=()), second)
    plans = planner.plan_jointly(problems)
    assert len(plans) == 2
    for plan, problem in zip(plans, problems, strict=True):
        contract.check(plan, problem, setup)
    assert planner.plan_jointly(()) == ()


@pytest.mark.parametrize("kind", JOINT)
def test_a_team_planner_has_a_plan_for_each_of_two_hundred(kind: str) -> None:
    names = [f"r{i:03d}" for i in range(200)]
    base = contract.team("drones_2d", "a")
    setup = dataclasses.replace(
        base,
        vehicles=dict.fromkeys(names, base.vehicles["a"]),
        sensors=dict.fromkeys(names, base.sensors["a"]),
    )
    planner = contract.planner(kind, setup)
    assert isinstance(planner, TeamPlanner)
    first = contract.ordinary(base)
    rng = np.random.default_rng(0)
    problems = tuple(
        dataclasses.replace(
            first,
            robot=name,
            state=contract.state(setup, name, *rng.uniform(0.0, contract.SIDE, 2), 0.0),
            others=(),
            deadline_s=0.3,
        )
        for name in names
    )
    plans = planner.plan_jointly(problems)
    assert len(plans) == 200
    for plan, problem in zip(plans, problems, strict=True):
        contract.check(plan, problem, setup)


def test_the_checks_can_fail() -> None:
    setup = contract.team("drones_2d")
    problem = contract.ordinary(setup)
    way = setup.vehicles["a"].trajectory(problem.state, np.array([50.0, 50.0, 0.0]), 5.0, 1.0)
    contract.check(Plan(way, "goes"), dataclasses.replace(problem, others=()), setup)
    with pytest.raises(AssertionError):
        contract.check(Plan(None, ""), problem, setup)
    with pytest.raises(AssertionError):
        contract.check(Plan(way, "late"), dataclasses.replace(problem, start_time=6.0), setup)
    in_the_way = contract.standing("b", 50.0, 50.0, 0.0)
    with pytest.raises(AssertionError):
        contract.check(Plan(way, "meets"), dataclasses.replace(problem, others=(in_the_way,)), setup)
    with pytest.raises(AssertionError):
        contract.check(Plan(way, "no number", math.nan), problem, setup)
