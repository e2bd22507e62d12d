"""Deadlines by a clock that only goes on while a sensor is asked: overrun is counted, not timed."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from agents.plugins import kinds, load
from planner.deadline import Deadline
from tests.planner import contract

REHEARSED = (
    "irrt",  # how long its tree takes for a step it learns with the first plan
    "lawnmower",  # its swath is measured once, with the first plan
)
EACH_S = 2e-6  # that a detection probability takes on the fake clock
THOUSANDS_S = 1e-7  # of one that asks for thousands at a time: several times what they take in truth
CALL_S = 2e-5  # that a call takes besides


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


class SlowSensor:
    """A sensor whose every answer takes time."""

    def __init__(self, sensor: Any, clock: Clock, each: float) -> None:
        self.sensor, self.clock, self.each = sensor, clock, each

    def __getattr__(self, name: str) -> Any:
        return getattr(self.sensor, name)

    def jacobian(self, points: Any, pose: Any) -> Any:
        self.clock.now += CALL_S + self.each * points.shape[1]
        return self.sensor.jacobian(points, pose)

    def detection(self, points: Any, poses: Any) -> Any:
        self.clock.now += CALL_S + self.each * points.shape[1] * len(poses)
        return self.sensor.detection(points, poses)


def slow(kind: str, name: str = "drones_2d", robots: str = "abc") -> tuple[Any, Any, Clock]:
    clock = Clock()
    setup = contract.team(name, robots)
    each = THOUSANDS_S if kind == "irrt" else EACH_S
    eyes = {robot: SlowSensor(sensor, clock, each) for robot, sensor in setup.sensors.items()}
    setup = dataclasses.replace(setup, sensors=eyes)
    found = load("planners", kind)
    planner = found(found.Config(), setup)
    for one in (planner, getattr(planner, "single", planner)):
        one.deadline = lambda seconds: Deadline(seconds, clock)
    return planner, setup, clock


@pytest.mark.parametrize("kind", kinds("planners"))
@pytest.mark.parametrize("deadline", [0.001, 0.003, 0.005, 0.01, 0.03, 0.1])
def test_no_plan_is_more_than_two_milliseconds_late(kind: str, deadline: float) -> None:
    planner, setup, clock = slow(kind)
    problem = dataclasses.replace(contract.ordinary(setup), deadline_s=deadline)
    if kind in REHEARSED:
        planner.plan(dataclasses.replace(problem, deadline_s=np.inf))
        clock.now = 0.0
    plan = planner.plan(problem)
    contract.check(plan, problem, setup)
    assert clock.now <= deadline + 2e-3


@pytest.mark.parametrize("kind", ["maasi", "mi", "thompson"])
def test_more_time_gives_a_plan_no_worse_and_enough_time_the_best(kind: str) -> None:
    values = []
    for deadline in (0.004, 0.01, 0.03, 10.0, np.inf):
        planner, setup, _ = slow(kind)
        problem = dataclasses.replace(contract.ordinary(setup), others=(), deadline_s=deadline)
        values.append(planner.plan(problem).objective)
    assert (np.diff(values) >= -1e-12).all()
    assert values[-2] == pytest.approx(values[-1], rel=1e-9)


def test_with_two_hundred_others_there_is_a_plan_in_time_all_the_same() -> None:
    planner, setup, clock = slow("maasi")
    many = {f"x{i}": setup.sensors["a"] for i in range(200)}
    planner.setup = dataclasses.replace(setup, sensors=setup.sensors | many)
    crowd = contract.AWKWARD["two hundred others"](contract.ordinary(setup))
    plan = planner.plan(dataclasses.replace(crowd, deadline_s=0.01, separation=0.5))
    assert clock.now <= 0.012
    assert plan.trajectory is not None


@pytest.mark.parametrize("deadline", [0.002, 0.005, 0.02, 0.05, 0.2, 1.0, 30.0])
def test_a_team_is_planned_for_in_time(deadline: float) -> None:
    planner, setup, clock = slow("maasi_joint", robots="ab")
    first = dataclasses.replace(contract.ordinary(setup), others=(), deadline_s=deadline)
    place = contract.state(setup, "b", 50.0, 45.0, 0.0)
    problems = (first, dataclasses.replace(first, robot="b", state=place))
    plans = planner.plan_jointly(problems)
    for plan, problem in zip(plans, problems, strict=True):
        contract.check(plan, problem, setup)
    assert clock.now <= deadline + 2e-3
    if deadline >= 30.0:
        free = planner.plan_jointly(tuple(dataclasses.replace(p, deadline_s=np.inf) for p in problems))
        assert sum(p.objective for p in plans) == pytest.approx(sum(p.objective for p in free), rel=1e-9)


@pytest.mark.parametrize("deadline", [0.003, 0.005, 0.009])
def test_the_first_plan_of_all_begins_no_solver_that_it_may_not_end_in_time(deadline: float) -> None:
    planner, setup, _ = slow("mpc")
    problem = dataclasses.replace(contract.ordinary(setup), deadline_s=deadline)
    plan = planner.plan(problem)
    contract.check(plan, problem, setup)
    assert plan.trajectory is not None
    assert "the solver had no time" in plan.reason
    for _ in range(6):  # by and by it is known: no time at all
        planner.plan(dataclasses.replace(problem, deadline_s=math.inf))
    assert "the solver had no time" not in planner.plan(problem).reason


def test_a_robot_that_shares_no_tasks_knows_of_them_by_half_of_its_time_and_goes_there_in_the_other() -> None:
    planner, setup, clock = slow("cbba")
    problem = dataclasses.replace(contract.ordinary(setup), others=())
    planner.plan(problem)
    for deadline in (0.006, 0.01, 0.02):
        clock.now = 0.0
        plan = planner.plan(dataclasses.replace(problem, deadline_s=deadline))
        assert plan.task
        assert clock.now <= deadline + 2e-3
