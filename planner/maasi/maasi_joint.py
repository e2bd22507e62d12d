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

from dataclasses import replace
from typing import ClassVar

import numpy as np

from estimator.arrays import Count, FloatArray, IntArray
from planner.maasi.coupling import NOT_YET, Coupling, couple
from planner.maasi.maasi import Maasi, MaasiConfig, chosen, crowded, scored, unplannable
from planner.maasi.outlook import Outlook, outlook
from planner.plan import Commitment, Plan, PlannerSetup, PlanProblem

ROUNDS = 50  # of coordinate ascent at most; it ends by itself long before


class MaasiJointConfig(MaasiConfig, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """As of the planner for one robot, and how many joint indices to enumerate."""

    max_joint: Count = 27**3


class MaasiJoint:
    """TeamPlanner, and Planner for a team of one."""

    Config: ClassVar[type[MaasiJointConfig]] = MaasiJointConfig

    def __init__(self, config: MaasiJointConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        self.single = Maasi(config, setup)

    def __repr__(self) -> str:
        return f"MaasiJoint({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The plan of one robot, all others being continuing agents: that of `Maasi`."""
        return self.single.plan(problem)

    def plan_jointly(self, problems: tuple[PlanProblem, ...]) -> tuple[Plan, ...]:
        """One plan per problem; commitments of robots that plan now are not conditioned on."""
        plans: dict[int, Plan] = {}
        views: dict[int, Outlook] = {}
        planning = {problem.robot for problem in problems}
        for index, problem in enumerate(problems):
            awkward = unplannable(problem, self.setup)
            if awkward:
                plans[index] = Plan(None, awkward)
                continue
            altitude = float(self.setup.vehicles[problem.robot].pose(problem.state)[2])
            others = tuple(other for other in problem.others if other.robot not in planning)
            waypoints = self.single.candidates.waypoints(altitude)
            view = outlook(
                problem, self.setup, waypoints, others, ways=problem.separation > 0 and len(problems) > 1
            )
            allowed = np.isfinite(scored(view, view.exploration, self.config)) & view.clear
            if allowed.any():
                views[index] = view
            else:
                plans[index] = self.single.plan(problem)  # for its reason
        if views:
            team = [problems[index] for index in views]
            answers = self._choose(team, list(views.values()))
            plans.update(zip(views, answers, strict=True))
        return tuple(plans[index] for index in range(len(problems)))

    def _choose(self, problems: list[PlanProblem], views: list[Outlook]) -> tuple[Plan, ...]:
        coupling = couple(problems, self.setup, views)
        options = [
            np.flatnonzero(np.isfinite(scored(view, view.exploration, self.config)) & view.clear)
            for view in views
        ]
        if np.prod([float(option.size) for option in options]) <= self.config.max_joint:
            joint = np.stack([axis.ravel() for axis in np.meshgrid(*options, indexing="ij")], axis=1)
            best, value = self._best(coupling, views, joint)
        else:
            best, value = self._ascend(coupling, views, options)
        if not np.isfinite(value):
            return self._without_last(problems)
        explorations = [coupling.exploration(a, best[None])[0] for a in range(len(views))]
        return tuple(
            chosen(
                problem, self.setup, view, int(w), float(e), float(self._objective(view, w[None], e[None])[0])
            )
            for problem, view, w, e in zip(problems, views, best, np.array(explorations), strict=True)
        )

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
        self, coupling: Coupling, views: list[Outlook], options: list[IntArray]
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
            if (best == before).all():
                break
        return best, value

    def _without_last(self, problems: list[PlanProblem]) -> tuple[Plan, ...]:
        """When no joint index keeps all apart, the last robot holds and the others plan around it."""
        last = problems[-1]
        hold = Plan(None, crowded(last.separation))
        if len(problems) == 1:
            return (hold,)
        pose = self.setup.vehicles[last.robot].pose(last.state)
        standing = Commitment(
            robot=last.robot,
            version=0,
            measure_times=np.zeros(0),
            measure_poses=np.zeros((0, 4)),
            times=np.array([last.start_time]),
            poses=pose[None],
            measure_period=last.measure_period,
        )
        rest = tuple(
            replace(problem, others=(*(o for o in problem.others if o.robot != last.robot), standing))
            for problem in problems[:-1]
        )
        return (*self.plan_jointly(rest), hold)
