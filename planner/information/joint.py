"""Planner `mutual_information_joint`: a centre chooses for all robots that plan at the same instant.

Dames & Kumar 2015 (see `entropy`) plan in a centre; this is for comparison with `mutual_information` in
`simulate`. Modes: 0 and 1 look at all joint actions, 2 and 3 let robots choose in turn to consensus, 4 and 5
draw; in 1, 3 and 5 all robots act at one length scale, that of the most information (14). Where joint
actions are more than `max_joint`, or robot-steps more than `exact_steps`, 0 and 1 go on as 2 and 3.

A robot's action that would meet another robot gives way to its next best, given the others' actions.
"""

from dataclasses import replace
from math import prod
from typing import ClassVar

import numpy as np

from estimator.arrays import FloatArray
from planner.deadline import Deadline
from planner.information.config import JointConfig
from planner.information.gains import Options, information, joined
from planner.information.single import LEAST, MODES_BY_SCALE, RANDOM, Chosen, MutualInformation, Reach
from planner.information.team import Events, Joint, Rules, decided, enumerated, in_turn
from planner.plan import Commitment, Plan, PlannerSetup, PlanProblem

AT_ONCE = (0, 1)


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
        plans: dict[int, Plan] = {}
        first: tuple[PlanProblem, Deadline, FloatArray, FloatArray] | None = None
        reaches: dict[int, list[Reach]] = {}
        for number, problem in enumerate(problems):
            if np.isnan(problem.deadline_s):
                plans[number] = Plan(None, "holds: its deadline is not a number")
                continue
            awkward, points, weights = self.prepared(problem)
            if awkward is not None:
                plans[number] = awkward
                continue
            if first is None:
                first = problem, Deadline(problem.deadline_s), points, weights
            _, deadline, points, weights = first
            reaches[number] = list(self.reach(problem, points, weights, deadline))
            if not reaches[number]:
                plans[number] = self._nowhere(problem, deadline)
                del reaches[number]
        if first is not None and reaches:
            plans.update(self._together(problems, reaches, *first))
        return tuple(plans[number] for number in range(len(problems)))

    def _together(
        self,
        problems: tuple[PlanProblem, ...],
        reaches: dict[int, list[Reach]],
        first: PlanProblem,
        deadline: Deadline,
        points: FloatArray,
        weights: FloatArray,
    ) -> dict[int, Plan]:
        config = self.config
        rules = Rules(points, weights, config.taylor_terms, config.exact_steps)
        team = [problems[number] for number in reaches]
        planning = tuple(problem.robot for problem in problems)
        events = Events(*self.events(first, points, planning))
        places = [self.setup.vehicles[p.robot].pose(p.state)[: len(points)] for p in team]
        sets = list(reaches.values())
        kinds = self._kinds(sets)
        best: tuple[Joint, list[Options], list[list[tuple[int, int]]]] | None = None
        for kind in kinds:
            options = [
                joined([robot[s].options for s in scales]) for robot, scales in zip(sets, kind, strict=True)
            ]
            names = [
                [(s, i) for s in scales for i in range(robot[s].options.size)]
                for robot, scales in zip(sets, kind, strict=True)
            ]
            joint = self._joint(options, events, places, rules, first.seed, deadline)
            if best is None or joint.information.value > best[0].information.value:
                best = joint, options, names
            if deadline.over():
                break
        assert best is not None  # there is at least one kind
        return self._followed(problems, reaches, *best, events, places, rules, deadline)

    def _kinds(self, sets: list[list[Reach]]) -> list[list[list[int]]]:
        """Which length scales each robot may choose from, for each choice to be made and compared."""
        every = [list(range(len(robot))) for robot in sets]
        if self.config.mode not in MODES_BY_SCALE:
            return [every]
        lengths = [{reach.actions.length: s for s, reach in enumerate(robot)} for robot in sets]
        common = sorted(set.intersection(*(set(robot) for robot in lengths)))
        return [[[robot[length]] for robot in lengths] for length in common] or [every]

    def _joint(
        self,
        team: list[Options],
        events: Events,
        places: list[FloatArray],
        rules: Rules,
        seed: int,
        deadline: Deadline,
    ) -> Joint:
        config = self.config
        if config.mode in RANDOM:
            rng = np.random.default_rng(seed)
            choice = tuple(int(rng.integers(options.size)) for options in team)
            return Joint(choice, rules.of(decided(team, choice, events)), 0)
        steps = len(team) * config.steps
        few = prod(options.size for options in team) <= config.max_joint and steps <= config.exact_steps
        turns = None
        if not (config.mode in AT_ONCE and few) or np.isfinite(deadline.seconds):
            turns = in_turn(team, events, places, rules, config.cycles, deadline.over)
            if not (config.mode in AT_ONCE and few) or deadline.over():
                return turns
        room = config.exact_steps - steps
        middle = np.mean(places, axis=0)
        near = np.sort(rules.order(events, middle)[:room])
        some = Events(np.ascontiguousarray(events.detection[near]), events.clutter[near])
        found = enumerated(team, some, rules, deadline.over)
        if found is None or (turns is not None and turns.information.value > found.information.value):
            assert turns is not None
            return turns
        return (
            found
            if near.size == len(events.clutter)
            else replace(found, information=rules.of(decided(team, found.choice, events)))
        )

    def _followed(
        self,
        problems: tuple[PlanProblem, ...],
        reaches: dict[int, list[Reach]],
        joint: Joint,
        team: list[Options],
        names: list[list[tuple[int, int]]],
        events: Events,
        places: list[FloatArray],
        rules: Rules,
        deadline: Deadline,
    ) -> dict[int, Plan]:
        """Plans of the joint action, each robot's around those before it; the others stand where they are."""
        plans: dict[int, Plan] = {}
        standing = {p.robot: self._standing(p) for p in problems if self._known(p)}
        for r, number in enumerate(reaches):
            problem = problems[number]
            others = decided(team, [-1 if k == r else c for k, c in enumerate(joint.choice)], events)
            fixed = rules.fixed(others, self.config.steps, places[r])
            without = fixed.information
            values = information(fixed, team[r])
            order = sorted(range(team[r].size), key=lambda i: (i != joint.choice[r], -values[i]))
            if self.config.mode not in RANDOM and values[joint.choice[r]] - without <= LEAST:
                order = sorted(order, key=lambda i: -values[i])
            chosen = Chosen(
                reaches[number],
                [names[r][i] for i in order],
                [float(values[i]) for i in order],
                without,
                joint.information.error,
                f", with {len(team) - 1} others",
            )
            ways = tuple(standing[p.robot] for p in problems if p.robot in standing and p is not problem)
            apart = tuple(other for other in problem.others if other.robot not in standing)
            plan = self.followed(replace(problem, others=apart + ways), chosen, deadline)
            if plan.trajectory is not None:
                way = plan.trajectory
                standing[problem.robot] = Commitment(
                    problem.robot,
                    0,
                    way.measure_times,
                    way.measure_poses,
                    way.times,
                    way.poses,
                    problem.measure_period,
                )
                terms = dict(plan.terms) | {"joint": joint.information.value, "cycles": float(joint.cycles)}
                plan = replace(plan, terms=terms)
            plans[number] = plan
        return plans

    def _known(self, problem: PlanProblem) -> bool:
        return problem.robot in self.setup.vehicles and bool(np.isfinite(problem.state).all())

    def _standing(self, problem: PlanProblem) -> Commitment:
        pose = self.setup.vehicles[problem.robot].pose(problem.state)
        return Commitment(
            problem.robot,
            0,
            np.zeros(0),
            np.zeros((0, 4)),
            np.array([problem.start_time]),
            pose[None],
            problem.measure_period,
        )
