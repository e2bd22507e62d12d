"""The joint (MA)ASI planner: one centre chooses for all robots that plan at the same instant, (26)-(32).

For comparison with `maasi` in `simulate`. The exploration terms couple the robots; the coupling of a
joint index factors by pairs: what robot b on its way to candidate w_b leaves unexplored at the corners that
robot a looks at on its way to w_a. These factors are computed once per pair of candidates, and the joint
indices are then enumerated by multiplying them.

Where there are more than `max_joint` joint indices, enumeration gives way to coordinate ascent: the robots
choose in turn, each given the others' present choices, beginning with the choices that they would make one
after the other, until none gains by another choice. That finds a joint index that no single robot can
improve, not necessarily the best of all.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import numpy as np

from estimator.arrays import BoolArray, Count, FloatArray, IntArray
from planner.budget import affordable, limited, way_to
from planner.deadline import Deadline, Reserve
from planner.maasi.coupling import NOT_YET, Coupling, couple
from planner.maasi.maasi import (
    LATE,
    Maasi,
    MaasiConfig,
    chosen,
    crowded,
    scored,
    unplannable,
)
from planner.maasi.outlook import Outlook, outlook
from planner.plan import Commitment, Plan, PlannerSetup, PlanProblem

PART = 512  # joint indices between two looks at the deadline
FINISH_S = 1.5e-3  # that the chosen ways of each robot may take, before they were measured
VIEW_S = 5e-3  # that an outlook on all candidates of a robot may take, before it was measured
ROUNDS = 50  # of coordinate ascent at most; it ends by itself long before


class MaasiJointConfig(MaasiConfig, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """As of the planner for one robot, and how many joint indices to enumerate."""

    max_joint: Count = 27**3


class MaasiJoint:
    """TeamPlanner, and Planner for a team of one."""

    Config: ClassVar[type[MaasiJointConfig]] = MaasiJointConfig
    deadline: Callable[[float], Deadline] = Deadline  # tests give it another clock

    def __init__(self, config: MaasiJointConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        self.single = Maasi(config, setup)
        self._finish, self._view = Reserve(FINISH_S), Reserve(VIEW_S)

    def __repr__(self) -> str:
        return f"MaasiJoint({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The plan of one robot, all others being continuing agents: that of `Maasi`."""
        return self.single.plan(problem)

    def plan_jointly(self, problems: tuple[PlanProblem, ...]) -> tuple[Plan, ...]:
        """One plan per problem; commitments of robots that plan now are not conditioned on.

        With a deadline (the soonest of the problems') the robots first plan one after the other, and keep
        these plans if time does not suffice for the joint choice.
        """
        soonest = min((p.deadline_s for p in problems if not math.isnan(p.deadline_s)), default=math.inf)
        if soonest == math.inf:
            return self._jointly(problems, Deadline(math.inf)) or ()
        deadline = self.deadline(soonest)
        deadline = deadline.less(self._finish.seconds * len(problems))
        began = deadline.left()
        plans = self._in_turn(problems, deadline, 0.5)
        each = began - deadline.left()
        if LATE in [plan.reason for plan in plans]:
            return plans if deadline.over() else self._in_turn(problems, deadline, 1.0)
        if deadline.left() < 2.0 * each:
            return plans
        return self._jointly(problems, deadline) or plans

    def _in_turn(
        self, problems: tuple[PlanProblem, ...], deadline: Deadline, part: float
    ) -> tuple[Plan, ...]:
        """Each robot by itself, given the plans of those before it, in a part of the time that is left."""
        plans: list[Plan] = []
        planning = {problem.robot for problem in problems}
        known: list[Commitment] = []
        for index, problem in enumerate(problems):
            others = _without(problem, planning)
            share = part * deadline.left() / (len(problems) - index)
            share = problem.deadline_s if math.isnan(problem.deadline_s) else share
            if deadline.over() and not math.isnan(share):
                plans.append(Plan(None, unplannable(problem, self.setup) or LATE))
            else:
                given = replace(problem, others=(*others, *known), deadline_s=share)
                plans.append(self.single.plan(given))
            known += self._standing_or_going(problem, plans[-1])
        return tuple(plans)

    def _jointly(self, problems: tuple[PlanProblem, ...], deadline: Deadline) -> tuple[Plan, ...] | None:
        """The joint choice; None if there was no time for it."""
        plans: dict[int, Plan] = {}
        views: dict[int, Outlook] = {}
        options: list[IntArray] = []
        planning = {problem.robot for problem in problems}
        for index, problem in enumerate(problems):
            awkward = unplannable(problem, self.setup)
            if awkward:
                plans[index] = Plan(None, awkward)
                continue
            altitude = float(self.setup.vehicles[problem.robot].pose(problem.state)[2])
            others = _without(problem, planning)
            waypoints = self.single.candidates.waypoints(altitude)
            if not self._view.fits(deadline):
                return None
            finely = problem.separation > 0 and len(problems) > 1
            with self._view.measured(deadline):
                view = outlook(problem, self.setup, waypoints, others, finely, deadline.over)
            allowed = np.isfinite(scored(view, view.exploration, self.config)) & view.clear
            option = np.flatnonzero(allowed & self._affordable(problem, view, allowed))
            if option.size:
                views[index] = view
                options.append(option)
            else:  # it holds with a reason or returns home, and the others plan around that
                plans[index] = self.single.plan(replace(problem, deadline_s=deadline.left()))
            if deadline.over():
                return None
        going = [c for i, p in plans.items() if p.trajectory for c in self._standing_or_going(problems[i], p)]
        team = [problems[index] for index in views]
        if team and going:
            around = tuple(replace(p, others=(*_without(p, planning), *going)) for p in team)
            answers = self._jointly(around, deadline)
        else:
            answers = self._choose(team, list(views.values()), options, deadline) if team else ()
        if answers is None:
            return None
        plans.update(zip(views, answers, strict=True))
        return tuple(plans[index] for index in range(len(problems)))

    def _affordable(self, problem: PlanProblem, view: Outlook, asked: BoolArray) -> BoolArray:
        """(w,) which of the candidates that are asked for the budget allows."""
        can = asked.copy()
        if limited(problem):
            for w in np.flatnonzero(asked):
                goal = view.predictions.waypoints[w]
                way = way_to(problem, self.setup, problem.state, problem.start_time, goal)
                can[w] = way is not None and affordable(problem, self.setup, way)
        return can

    def _standing_or_going(self, problem: PlanProblem, plan: Plan) -> tuple[Commitment, ...]:
        """What a plan commits a robot to, for the others to plan around."""
        if problem.robot not in self.setup.vehicles or not np.isfinite(problem.state).all():
            return ()
        way, pose = plan.trajectory, self.setup.vehicles[problem.robot].pose(problem.state)[None]
        return (
            Commitment(
                robot=problem.robot,
                version=0,
                measure_times=np.zeros(0) if way is None else way.measure_times,
                measure_poses=np.zeros((0, 4)) if way is None else way.measure_poses,
                times=np.array([problem.start_time]) if way is None else way.times,
                poses=pose if way is None else way.poses,
                measure_period=problem.measure_period,
            ),
        )

    def _choose(
        self, problems: list[PlanProblem], views: list[Outlook], options: list[IntArray], deadline: Deadline
    ) -> tuple[Plan, ...] | None:
        coupling = couple(problems, self.setup, views, deadline.over)
        if coupling is None:
            return None
        if np.prod([float(option.size) for option in options]) <= self.config.max_joint:
            joint = np.stack([axis.ravel() for axis in np.meshgrid(*options, indexing="ij")], axis=1)
            best, value = self._best_so_far(coupling, views, joint, deadline)
        else:
            best, value = self._ascend(coupling, views, options, deadline)
        if deadline.over() and ((best == NOT_YET).any() or not np.isfinite(value)):
            return None
        if not np.isfinite(value):
            return self._without_last(problems, deadline)
        explorations = [coupling.exploration(a, best[None])[0] for a in range(len(views))]
        plans = []
        for problem, view, w, e in zip(problems, views, best, np.array(explorations), strict=True):
            value = float(self._objective(view, w[None], e[None])[0])
            with self._finish.measured(deadline):
                plans.append(chosen(problem, self.setup, view, int(w), float(e), value))
        return tuple(plans)

    def _best_so_far(
        self, coupling: Coupling, views: list[Outlook], joint: IntArray, deadline: Deadline
    ) -> tuple[IntArray, float]:
        """`_best`, in parts if there is a deadline."""
        part = len(joint) if math.isinf(deadline.seconds) else PART
        best, value = joint[0], -np.inf
        for first in range(0, len(joint), part):
            choice, gained = self._best(coupling, views, joint[first : first + part])
            if gained > value:
                best, value = choice, gained
            if deadline.over():
                break
        return best, value

    def _best(self, coupling: Coupling, views: list[Outlook], joint: IntArray) -> tuple[IntArray, float]:
        """The joint index, among those in rows (j, a), of the highest sum (26); the first of equals."""
        total = np.where(coupling.apart(joint), 0.0, -np.inf)
        for a, view in enumerate(views):
            total += self._objective(view, joint[:, a], coupling.exploration(a, joint))
        best = int(np.argmax(total))
        return joint[best], float(total[best])

    def _objective(self, view: Outlook, index: IntArray, exploration: FloatArray) -> FloatArray:
        """J^a (j,), (27), of candidates `index` (j,) with E^a (j,); 0 for a robot that has not chosen yet."""
        config = self.config
        gain = config.alpha * view.refinement[index] + config.beta * exploration
        value = (gain - config.control_cost * view.control[index]) / np.maximum(view.steps[index], 1)
        return np.where(index == NOT_YET, 0.0, value)

    def _ascend(
        self, coupling: Coupling, views: list[Outlook], options: list[IntArray], deadline: Deadline
    ) -> tuple[IntArray, float]:
        """Coordinate ascent on the sum (26)."""
        best, value = np.full(len(views), NOT_YET), -np.inf
        for sweep in range(ROUNDS):
            before = best.copy()
            for a, option in enumerate(options):
                joint = np.tile(best, (option.size, 1))
                joint[:, a] = option
                choice, gained = self._best(coupling, views, joint)
                if sweep == 0 or gained > value:
                    best, value = choice, gained
                if deadline.over():
                    return best, value
            if (best == before).all():
                break
        return best, value

    def _without_last(self, problems: list[PlanProblem], deadline: Deadline) -> tuple[Plan, ...] | None:
        """When no joint index keeps all apart, the last robot holds and the others plan around it."""
        last = problems[-1]
        hold = Plan(None, crowded(last.separation))
        if len(problems) == 1:
            return (hold,)
        standing = self._standing_or_going(last, hold)
        rest = tuple(
            replace(problem, others=(*_without(problem, {last.robot}), *standing))
            for problem in problems[:-1]
        )
        plans = self._jointly(rest, deadline)
        return None if plans is None else (*plans, hold)


def _without(problem: PlanProblem, robots: set[str]) -> tuple[Commitment, ...]:
    return tuple(other for other in problem.others if other.robot not in robots)
