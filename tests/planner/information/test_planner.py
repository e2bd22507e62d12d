import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest

from planner.deadline import Deadline
from planner.information.events import Events
from planner.information.gains import Fixed, information, options
from planner.information.joint import MutualInformationJoint
from planner.information.mutual import mutual_information
from planner.information.single import MutualInformation
from planner.information.team import Rules, enumerated, in_turn
from planner.plan import Plan, PlannerSetup, PlanProblem
from tests.planner import contract
from tests.planner.information import brute


def never() -> bool:
    return False


def case(seed: int, robots: int = 3, actions: int = 4, steps: int = 2) -> tuple[list[Any], Events, Rules]:
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.0, 0.2, 25)
    made = []
    for _ in range(robots):
        detection = rng.uniform(0.1, 0.9, (actions, steps, 25)) * (rng.random((actions, steps, 25)) < 0.4)
        made.append(options(detection, weights, rng.uniform(0.1, 0.6, steps), 400))
    detection, _, clutter = brute.random_case(seed, 2, points=25)
    points = rng.uniform(0, 10, (2, 25))
    return made, Events(detection, clutter), Rules(points, weights, 400, 12)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_shared_between_actions_gives_each_its_own_information(seed: int) -> None:
    team, events, rules = case(seed)
    fixed = Fixed.of(events.detection, rules.weights, events.clutter, 400).with_action(team[0], 2)
    ours = information(fixed, team[1])
    for action in range(4):
        both = events.with_action(team[0], 2).with_action(team[1], action)
        whole = mutual_information(both.detection, rules.weights, both.clutter, 400)
        assert ours[action] == pytest.approx(whole.value, abs=1e-10)


@pytest.mark.parametrize("seed", range(4))
def test_enumeration_finds_the_best_joint_action(seed: int) -> None:
    team, events, rules = case(seed)
    found = enumerated(team, events, rules, never)
    best = -np.inf
    for choice in np.ndindex(4, 4, 4):
        whole = events
        for robot, index in zip(team, choice, strict=True):
            whole = whole.with_action(robot, index)
        best = max(best, rules.of(whole).value)
    assert found is not None
    assert found.information.value == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_in_turn_nobody_gains_by_another_action_and_three_cycles_are_enough(seed: int) -> None:
    """Three cycles at most until consensus is what the paper saw; one more is to see that nobody changes."""
    team, events, rules = case(seed)
    found = in_turn(team, events, [np.zeros(2)] * 3, rules, 10, never)
    assert found.cycles <= 4
    best = enumerated(team, events, rules, never)
    assert best is not None
    assert found.information.value <= best.information.value + 1e-9
    for r in range(3):
        for other in range(4):
            whole = events
            for k, robot in enumerate(team):
                whole = whole.with_action(robot, other if k == r else found.choice[k])
            assert rules.of(whole).value <= found.information.value + 1e-9


def pair(mode: int, **keys: Any) -> tuple[MutualInformationJoint, tuple[PlanProblem, ...], PlannerSetup]:
    setup = contract.team("ground_2d", "ab")
    config = MutualInformationJoint.Config(mode=mode, first_scale_m=8.0, **keys)
    a = dataclasses.replace(contract.ordinary(setup), others=())
    b = dataclasses.replace(a, robot="b", state=contract.state(setup, "b", 18.0, 24.0, 0.0))
    return MutualInformationJoint(config, setup), (a, b), setup


@pytest.mark.parametrize("mode", range(6))
def test_every_mode_has_a_plan_for_each_robot(mode: int) -> None:
    planner, problems, setup = pair(mode)
    plans = planner.plan_jointly(problems)
    for plan, problem in zip(plans, problems, strict=True):
        assert plan.trajectory is not None
        contract.check(plan, problem, setup)
    if mode in (1, 3, 5):
        assert plans[0].terms["length"] == plans[1].terms["length"]


def test_modes_rank_as_the_sets_they_choose_from() -> None:
    """Mode 0 chooses from all joint actions, 1 to 3 from some of them, 4 and 5 at random."""
    joint = {}
    for mode in range(6):
        planner, problems, _ = pair(mode)
        joint[mode] = planner.plan_jointly(problems)[0].terms["joint"]
    assert all(joint[0] >= joint[mode] - 1e-9 for mode in range(1, 6))
    assert joint[1] >= joint[3] - 1e-9
    assert min(joint[m] for m in range(4)) > max(joint[4], joint[5])


def test_a_robot_keeps_away_from_what_another_will_look_at() -> None:
    setup = contract.team("ground_2d", "ab")
    planner = MutualInformation(MutualInformation.Config(first_scale_m=10.0), setup)
    problem = dataclasses.replace(contract.ordinary(setup), others=(), separation=0.0)
    alone = planner.plan(problem).trajectory
    assert alone is not None
    other = contract.committed(alone, "b")
    again = planner.plan(dataclasses.replace(problem, others=(other,))).trajectory
    assert again is not None
    assert np.linalg.norm(again.waypoint - alone.waypoint) > 1.0


def test_it_goes_to_the_first_of_its_poses_and_plans_again() -> None:
    setup = contract.team("ground_2d", "a")
    problem = dataclasses.replace(contract.ordinary(setup), others=())
    for after, share in ((1, 1 / 3), (3, 1.0)):
        config = MutualInformation.Config(first_scale_m=9.0, replan_after=after)
        plan = MutualInformation(config, setup).plan(problem)
        assert plan.trajectory is not None
        gone = np.linalg.norm(plan.trajectory.waypoint[:2] - problem.state[:2])
        assert gone == pytest.approx(share * plan.terms["length"])


def test_a_search_that_is_settled_is_over() -> None:
    setup = contract.team("ground_2d", "a")
    problem = dataclasses.replace(contract.ordinary(setup), others=())
    points = np.array([[10.25, 40.25], [20.25, 30.25]])
    assert problem.intensity is not None
    known = dataclasses.replace(problem.intensity, points=points, weights=np.ones(2))
    planner = MutualInformation(MutualInformation.Config(settled=0.05), setup)
    over: Plan = planner.plan(dataclasses.replace(problem, intensity=known))
    assert over.trajectory is None
    assert "over" in over.reason
    assert planner.plan(problem).trajectory is not None


@pytest.mark.parametrize("asked", [1, 3, 10, 40])
def test_with_little_time_each_robot_has_a_defined_plan(asked: int) -> None:
    """A clock that goes on by a millisecond each time that it is read."""
    ticks = itertools.count()
    planner, problems, setup = pair(2)
    planner.deadline = lambda seconds: Deadline(seconds, lambda: 1e-3 * next(ticks))  # type: ignore
    late = tuple(dataclasses.replace(p, deadline_s=1e-3 * asked) for p in problems)
    for plan, problem in zip(planner.plan_jointly(late), late, strict=True):
        contract.check(plan, problem, setup)
        assert plan.trajectory is not None or "deadline" in plan.reason
    one = planner.plan(late[0])
    assert one.trajectory is not None or "deadline" in one.reason


def test_what_was_slow_once_is_tried_again() -> None:
    setup = contract.team("ground_2d", "a")
    planner = MutualInformation(MutualInformation.Config(), setup)
    ticks = itertools.count()
    planner.deadline = lambda seconds: Deadline(seconds, lambda: 1e-3 * next(ticks))  # type: ignore
    planner.following.reserve.seconds = 1.0
    problem = dataclasses.replace(contract.ordinary(setup), others=(), deadline_s=0.5)
    assert any(planner.plan(problem).trajectory is not None for _ in range(100))


def test_random_modes_draw_anew_with_every_seed() -> None:
    setup = contract.team("ground_2d", "a")
    planner = MutualInformation(MutualInformation.Config(mode=4), setup)
    problem = dataclasses.replace(contract.ordinary(setup), others=())
    drawn = {planner.plan(dataclasses.replace(problem, seed=seed)).reason for seed in range(6)}
    assert len(drawn) > 3
