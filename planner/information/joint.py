"""Planner `mutual_information_joint`: a centre chooses for all robots that plan at the same instant.

Dames & Kumar 2015 (see `entropy`) plan in a centre; this is for comparison with `mutual_information` in
`simulate`. Modes: 0 and 1 look at all joint actions, 2 and 3 let robots choose in turn to consensus, 4 and 5
draw; in 1, 3 and 5 all robots act at one length scale, that of the most information (14). Where joint
actions are more than `max_joint`, or robot-steps more than `exact_steps`, 0 and 1 go on as 2 and 3.

A robot's action that would meet another robot gives way to its next best, given the others' actions.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import prod
from typing import ClassVar

import numpy as np

from estimator.arrays import FloatArray, IntArray
from planner.deadline import Deadline
from planner.information.actions import ActionSet
from planner.information.config import JointConfig
from planner.information.events import Events, committed, nearest_first
from planner.information.following import LATE as NO_TIME_FOR_A_WAY
from planner.information.following import LEAST, Chosen, in_order
from planner.information.gains import Options, joined
from planner.information.single import LATE, MODES_BY_SCALE, RANDOM, MutualInformation
from planner.information.team import NOTHING, Joint, Rules, View, decided, enumerated, in_turn, same_others
from planner.maasi.maasi import unplannable
from planner.plan import Commitment, Plan, PlannerSetup, PlanProblem, Trajectory

AT_ONCE = (0, 1)
WAYS = 2  # for which time is kept for each robot: the first may not be free
EACH_S = 3e-4  # that a robot takes besides
EVALUATION = 0.6  # of the time there is may go into the robots' actions; the rest is for choosing


@dataclass(frozen=True, slots=True)
class Member:
    """A robot that is planned for, with those of its actions that there was time for."""

    number: int  # of its problem
    problem: PlanProblem
    place: FloatArray  # (d,) where it is
    actions: ActionSet
    rows: IntArray  # (r,) numbers of the actions that the options are of
    options: Options

    def only(self, rows: IntArray) -> "Member":
        """With some of its options."""
        return replace(self, rows=self.rows[rows], options=self.options.only(rows))

    @property
    def lengths(self) -> FloatArray:
        """(r,) metres of each option's length scale."""
        return self.actions.lengths[self.rows]


class MutualInformationJoint(MutualInformation):
    """TeamPlanner, and Planner for a team of one."""

    Config: ClassVar[type[JointConfig]] = JointConfig
    config: JointConfig

    def __init__(self, config: JointConfig, setup: PlannerSetup) -> None:
        super().__init__(config, setup)

    def plan_jointly(self, problems: tuple[PlanProblem, ...]) -> tuple[Plan, ...]:
        """One plan per problem; commitments of robots that plan now are not conditioned on.

        The intensity, the others' commitments and the deadline are those of the first problem that can be
        planned for: a centre has one of each.
        """
        plans = {number: Plan(None, unplannable(p, self.setup)) for number, p in enumerate(problems)}
        some = [number for number, plan in plans.items() if not plan.reason]
        if not some:
            return tuple(plans.values())
        first = problems[some[0]]
        deadline = self.deadline(first.deadline_s)
        ways = self.following.reserve
        if deadline.left() <= len(some) * ways.seconds:
            held = self.late()
            return tuple(plan if plan.reason else held for plan in plans.values())
        choosing = deadline.less(len(some) * (WAYS * ways.seconds + EACH_S))
        team: list[Member] = []
        points, weights = np.zeros((0, 0)), np.zeros(0)
        for done, number in enumerate(some):
            found, *thinned = self.prepared(problems[number])
            if found is not None:
                plans[number] = found
                continue
            if not points.size:
                first, (points, weights) = problems[number], thinned
            left, until = choosing.left(), choosing
            if math.isfinite(left):
                until = choosing.less((1.0 - EVALUATION / (len(some) - done)) * left)
            member = self._member(number, problems[number], points, weights, until)
            if isinstance(member, Plan):
                plans[number] = member
            else:
                team.append(member)
        if team and choosing.over():
            plans.update(dict.fromkeys([member.number for member in team], self.late()))
        elif team:
            plans.update(self._together(problems, team, first, points, weights, choosing, deadline))
        return tuple(plans.values())

    def _member(
        self,
        number: int,
        problem: PlanProblem,
        points: FloatArray,
        weights: FloatArray,
        deadline: Deadline,
    ) -> Member | Plan:
        """A robot with its actions, or its plan if it has none."""
        parts = list(self.reaches.parts(problem, points, weights, deadline))
        if not parts or not parts[0].actions.corners:
            return self.nowhere(problem, late=not parts)
        place = self.setup.vehicles[problem.robot].pose(problem.state)[: len(points)]
        rows = np.concatenate([part.rows for part in parts])
        options = joined([part.options for part in parts])
        return Member(number, problem, place, parts[0].actions, rows, options)

    def _together(
        self,
        problems: tuple[PlanProblem, ...],
        team: list[Member],
        first: PlanProblem,
        points: FloatArray,
        weights: FloatArray,
        choosing: Deadline,
        deadline: Deadline,
    ) -> dict[int, Plan]:
        config = self.config
        rules = Rules(points, weights, config.taylor_terms, self.exact_steps(deadline))
        planning = tuple(problem.robot for problem in problems)
        events = committed(first, self.setup, points, config.steps, planning, choosing.over)
        best: tuple[Joint, list[Member]] | None = None
        for some in self._kinds(team):
            joint = self._joint(some, events, rules, first.seed, choosing)
            if best is None or joint.information.value > best[0].information.value:
                best = joint, some
            if choosing.over():
                break
        assert best is not None  # there is at least one kind
        joint, team = best
        if not joint.information.exact and math.isinf(deadline.seconds):
            whole = decided([member.options for member in team], joint.choice, events)
            joint = replace(joint, information=rules.of(whole))
        return self._followed(problems, team, joint, events, rules, choosing, deadline)

    def _kinds(self, team: list[Member]) -> Iterator[list[Member]]:
        """The team with the length scales that it may choose from, for each choice that is compared."""
        if self.config.mode not in MODES_BY_SCALE:
            yield team
            return
        lengths = [set(np.unique(member.lengths).tolist()) for member in team]
        common = sorted(set.intersection(*lengths))
        for length in common:
            yield [member.only(np.flatnonzero(member.lengths == length)) for member in team]
        if not common:
            yield team

    def _joint(
        self, team: list[Member], events: Events, rules: Rules, seed: int, deadline: Deadline
    ) -> Joint:
        config = self.config
        options, places = [member.options for member in team], [member.place for member in team]
        if config.mode in RANDOM:
            rng = np.random.default_rng(seed)
            choice = tuple(int(rng.integers(some.size)) for some in options)
            return self._told(Joint(choice, NOTHING, 0, (None,) * len(team)), team, events, rules, deadline)
        steps = len(team) * config.steps
        few = prod(some.size for some in options) <= config.max_joint and steps <= rules.limit
        at_once = config.mode in AT_ONCE and few
        turns = None
        if not at_once or math.isfinite(deadline.seconds):
            turns = in_turn(options, events, places, rules, config.cycles, deadline.over)
            if not at_once or deadline.over():
                return turns
        near = events
        if len(events.clutter) > rules.limit - steps:
            order = nearest_first(events.detection, rules.points, rules.weights, np.mean(places, axis=0))
            near = events.only(np.sort(order[: rules.limit - steps]))
        found = enumerated(options, near, rules, deadline.over)
        if found is None or (turns is not None and turns.information.value > found.information.value):
            assert turns is not None
            return turns
        found = found if turns is None else replace(found, views=turns.views)
        return found if near is events else self._told(found, team, events, rules, deadline)

    def _told(
        self, joint: Joint, team: list[Member], events: Events, rules: Rules, deadline: Deadline
    ) -> Joint:
        """With what all events say, as far as there is time for it."""
        view = self._view(joint, 0, team, events, rules, deadline)
        if view is None or not np.isfinite(view.values[joint.choice[0]]):
            return joint
        views = (view, *joint.views[1:])
        told = rules.told(view, team[0].options, joint.choice[0])
        return replace(joint, information=told, views=views)

    def _view(
        self, joint: Joint, r: int, team: list[Member], events: Events, rules: Rules, deadline: Deadline
    ) -> View | None:
        """A robot's options given the others' choice; without time, what is known."""
        known = joint.views[r]
        if known is not None and same_others(known.others, joint.choice, r):
            return known
        if deadline.over():
            return known
        options = [member.options for member in team]
        return rules.view(options, joint.choice, r, events, team[r].place, deadline.over)

    def _followed(
        self,
        problems: tuple[PlanProblem, ...],
        team: list[Member],
        joint: Joint,
        events: Events,
        rules: Rules,
        choosing: Deadline,
        deadline: Deadline,
    ) -> dict[int, Plan]:
        """Plans of the joint action, each robot's around those before it; the others stand where they are."""
        plans: dict[int, Plan] = {}
        standing = {p.robot: self._standing(p) for p in problems if self._known(p)}
        late = False
        for r, member in enumerate(team):
            problem, choice = member.problem, joint.choice[r]
            view = self._view(joint, r, team, events, rules, choosing) if choice >= 0 else None
            if view is None or late:
                plans[member.number] = Plan(None, LATE)
                continue
            order = in_order(view.values)
            worth = view.values[choice] - view.without > LEAST
            if choice in order and (worth or self.config.mode in RANDOM):
                order.remove(choice)
                order.insert(0, choice)
            chosen = Chosen(
                member.actions,
                [int(member.rows[i]) for i in order],
                [float(view.values[i]) for i in order],
                view.without,
                joint.information.error,
                f", with {len(team) - 1} others",
            )
            ways = tuple(standing[p.robot] for p in problems if p.robot in standing and p is not problem)
            apart = tuple(other for other in problem.others if other.robot not in standing)
            around = replace(problem, others=apart + ways)
            plan = self.following.plan(around, chosen, deadline, pointless=self.config.mode in RANDOM)
            if plan.trajectory is not None:
                standing[problem.robot] = _committed(problem, plan.trajectory)
                terms = dict(plan.terms) | {"joint": joint.information.value, "cycles": float(joint.cycles)}
                plan = replace(plan, terms=terms)
            late = plan.reason == NO_TIME_FOR_A_WAY
            plans[member.number] = plan
        return plans

    def _known(self, problem: PlanProblem) -> bool:
        return problem.robot in self.setup.vehicles and bool(np.isfinite(problem.state).all())

    def _standing(self, problem: PlanProblem) -> Commitment:
        pose = self.setup.vehicles[problem.robot].pose(problem.state)
        none, start = np.zeros((0, 4)), np.array([problem.start_time])
        return Commitment(problem.robot, 0, np.zeros(0), none, start, pose[None], problem.measure_period)


def _committed(problem: PlanProblem, way: Trajectory) -> Commitment:
    """A plan of this round, for those after it."""
    return Commitment(
        problem.robot, 0, way.measure_times, way.measure_poses, way.times, way.poses, problem.measure_period
    )
