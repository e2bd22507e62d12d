import dataclasses
import itertools
import math

import numpy as np
import pytest

from planner.maasi.candidates import CandidateGrid
from planner.maasi.maasi import Maasi
from planner.maasi.maasi_joint import MaasiJoint
from planner.plan import TeamPlanner
from tests.planner.maasi.test_maasi import gap, standing
from tests.planner.problems import committed, problem, slow_looks, slow_objective, team


def planners(setup, points=2, **changes):
    d = setup.area.dimension
    side = float(setup.area.high[0])
    grid = CandidateGrid(low=[0.1 * side] * d, high=[0.9 * side] * d, points=[points] * d)
    shared = {"alpha": 0.3, "beta": 3.0, "control_cost": 0.01, "candidates": grid}
    single = Maasi(Maasi.Config(**shared), setup)
    return MaasiJoint(MaasiJoint.Config(**{**shared, **changes}), setup), single


def other_way(setup, robot, seed):
    vehicle = setup.vehicles[robot]
    rng = np.random.default_rng(seed)
    state = vehicle.initial_state(np.append(rng.uniform(0, 40, 3), 0.0))
    return committed(vehicle.trajectory(state, rng.uniform(0, 40, 3), 1.0, 0.9), robot, 0.9)


def test_satisfies_the_seam():
    assert isinstance(planners(team(2))[0], TeamPlanner)


@pytest.mark.parametrize("seed", range(4))
def test_one_robot_gets_the_plan_of_maasi(seed):
    setup = team(3, "abc")
    joint, single = planners(setup)
    given = problem(setup, seed, others=[other_way(setup, "c", seed)], separation=2.0)
    expected = single.plan(given)
    (plan,) = joint.plan_jointly((given,))
    for answer in (plan, joint.plan(given)):
        assert answer.objective == pytest.approx(expected.objective, rel=1e-12)
        assert np.array_equal(answer.trajectory.waypoint, expected.trajectory.waypoint)


def brute_force(problems, setup, single, continuing):
    """The best joint index (26) by trying all, each with its whole literal objective."""
    waypoints = [single.candidates.waypoints(p.state[2]) for p in problems]
    ways = [
        [
            committed(
                setup.vehicles[p.robot].trajectory(p.state, w, p.start_time, p.measure_period),
                p.robot,
                p.measure_period,
            )
            for w in options
        ]
        for p, options in zip(problems, waypoints, strict=True)
    ]
    best, found = -math.inf, None
    for joint in itertools.product(*(range(len(options)) for options in waypoints)):
        total = 0.0
        for a, p in enumerate(problems):
            others = [*continuing, *(ways[b][joint[b]] for b in range(len(problems)) if b != a)]
            seen = [(o.robot, t, q) for o in others for t, q in slow_looks(o, p.start_time, 40.0)]
            total += slow_objective(p, setup, waypoints[a][joint[a]], single.config, seen)
        if total > best + 1e-12:
            best, found = total, joint
    return best, [waypoints[a][w] for a, w in enumerate(found)]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("robots", ["ab", "abd"])
def test_joint_plan_is_that_of_brute_force(seed, robots):
    setup = team(2, "abcd")
    joint, single = planners(setup)
    continuing = [other_way(setup, "c", seed)]
    periods = {"a": 1.5, "b": 1.1, "d": 2.0}
    problems = tuple(
        problem(
            setup, seed, robot, continuing, clusters=2, period=periods[robot], start=[10.0 + 4 * i, 20, 10]
        )
        for i, robot in enumerate(robots)
    )
    best, waypoints = brute_force(problems, setup, single, continuing)
    plans = joint.plan_jointly(problems)
    assert sum(plan.objective for plan in plans) == pytest.approx(best, rel=1e-9)
    for plan, waypoint in zip(plans, waypoints, strict=True):
        assert np.array_equal(plan.trajectory.waypoint, waypoint)


def test_stale_commitments_of_planning_robots_do_not_count():
    setup = team(2, "ab")
    joint, _ = planners(setup)
    fresh = tuple(problem(setup, 1, robot) for robot in "ab")
    stale = tuple(
        dataclasses.replace(p, others=(other_way(setup, "b" if p.robot == "a" else "a", 5),)) for p in fresh
    )
    assert [p.objective for p in joint.plan_jointly(fresh)] == [
        p.objective for p in joint.plan_jointly(stale)
    ]


@pytest.mark.parametrize("seed", range(4))
def test_coordinate_ascent_cannot_be_improved_by_one_robot(seed):
    setup = team(2, "abc")
    exact, _ = planners(setup, points=3)
    climbing, _ = planners(setup, points=3, max_joint=1)
    problems = tuple(problem(setup, seed + 10 * i, robot, clusters=2) for i, robot in enumerate("abc"))
    best = sum(plan.objective for plan in exact.plan_jointly(problems))
    found = sum(plan.objective for plan in climbing.plan_jointly(problems))
    assert found <= best + 1e-12
    assert found >= 0.9 * best


@pytest.mark.parametrize("max_joint", [27**3, 1])
@pytest.mark.parametrize("seed", range(4))
def test_robots_that_plan_together_keep_apart(seed, max_joint):
    setup = team(2, "abc")
    joint, _ = planners(setup, points=3, max_joint=max_joint)
    places = {"a": [2.0, 2.0, 10.0], "b": [38.0, 2.0, 10.0], "c": [20.0, 38.0, 10.0]}
    problems = tuple(
        problem(setup, seed, robot, start=place, separation=8.0) for robot, place in places.items()
    )
    plans = joint.plan_jointly(problems)
    ways = [plan.trajectory for plan in plans]
    assert all(way is not None for way in ways)
    for first, second in itertools.permutations(ways, 2):
        assert gap(first, second) >= 8.0 - 0.05


def test_last_robot_holds_when_there_is_no_room_for_all():
    setup = team(2, "ab")
    joint, _ = planners(setup, points=1)
    problems = (
        problem(setup, 0, "a", start=[5.0, 20.0, 10.0], separation=4.0),
        problem(setup, 0, "b", start=[35.0, 20.0, 10.0], separation=4.0),
    )
    first, last = joint.plan_jointly(problems)
    assert first.trajectory is not None
    assert last.trajectory is None
    assert "4 m" in last.reason


def test_awkward_problems_hold_and_the_others_plan():
    setup = team(2, "ab")
    joint, _ = planners(setup)
    good, bad = problem(setup, 0, "a"), problem(setup, 0, "b")
    bad = dataclasses.replace(bad, state=np.full(18, np.inf))
    held, planned = joint.plan_jointly((bad, good))
    assert held.trajectory is None
    assert planned.trajectory is not None
    assert joint.plan_jointly(()) == ()


def test_blocked_robot_holds_and_the_others_plan():
    setup = team(2, "abc")
    joint, _ = planners(setup, points=1)
    blocked = problem(
        setup, 0, "a", others=[standing("c", [20.0, 20.0, 10.0])], start=[2.0, 2.0, 10.0], separation=3.0
    )
    held, planned = joint.plan_jointly((blocked, problem(setup, 0, "b", start=[30.0, 2.0, 10.0])))
    assert held.trajectory is None
    assert planned.trajectory is not None
