"""Planner `cbba`: the team shares its tasks by CBBA, and each robot plans its way to the first of its own.

Sources: Choi, Brunet, How (2009) and Ponda et al. (2012) for the allocation; the way within a task is chosen
as by (MA)ASI (17), (27) among places in the task, given what the others have committed to.

Who does what is settled between the robots before any of them plans, and is given with the problem (see
`desk`). A robot that is given nothing is alone: it takes what is worth most to it.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import msgspec
import numpy as np

from estimator.arrays import Count, NonNegative, Positive
from planner.allocation.approach import approach, places_in
from planner.allocation.cbba import AllocationState, build_bundle
from planner.allocation.desk import Assignment, BidRules, Desk
from planner.allocation.slots import task_of
from planner.allocation.tasks import Request, Task, TaskRules
from planner.allocation.valuation import Worth, slot_names
from planner.baselines.choice import Pace
from planner.budget import limited, returning
from planner.deadline import Deadline, Reserve
from planner.maasi.maasi import MaasiConfig, unplannable
from planner.others import Others
from planner.plan import Plan, PlannerSetup, PlanProblem

FEWEST_REGIONS = 8  # also of small teams: in larger ones a robot finds no good way about
LATE = "holds: its deadline was over before it knew its task"
CUT_S = {
    "explore": 4e-3,
    "refine": 1e-3,
    "request": 1e-3,
}  # that cutting a task into places may take at first
LIST_S = 1e-3  # and finding out what tasks there are
VALUE_S = 2e-3  # and what they are worth
VALUING = 0.5  # of the time there is may go into that; the rest is for the way


class CbbaConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a team shares its tasks."""

    bundle: Count = 5  # tasks that a robot takes on, at most
    regions_per_robot: Count = 2  # to explore, when nothing is explored; 8 in all at least
    spacing_m: NonNegative = 10.0  # clusters nearer to each other than this are one task
    refine: NonNegative = 1.0  # worth of what is learnt of one target
    enough_m: Positive = 0.25  # standard deviation per axis at which a target is known well enough
    explore: NonNegative = 5.0  # worth of exploring the whole area, in targets
    discount_s: Positive = 60.0  # a reward that much later is worth 1/e
    fuel: NonNegative = 0.0  # cost of a second on the way, in targets
    loyalty: NonNegative = 0.2  # how much more a task is worth to the robot that is at it
    places: Count = 12  # in a task, among which a robot chooses where to go
    alpha: NonNegative = 0.5  # on the way: weight of target refinement
    beta: NonNegative = 0.5  # on the way: weight of exploration
    control_cost: NonNegative = 1.0  # on the way: weight of the control effort
    renew_s: Positive = 1.0  # between two looks at what there is to do and what it is worth
    round_s: Positive = 0.05  # between two bids of a robot, at least
    heartbeat_s: Positive = 0.5  # between two bids of a robot, at most: it bids on when all is agreed
    silence_s: Positive = 5.0  # a robot that nobody has heard for so long is taken for gone


class Cbba:
    """Planner: CBBA over the tasks of the moment, then a way to the first of one's own."""

    Config: ClassVar[type[CbbaConfig]] = CbbaConfig
    deadline: Callable[[float], Deadline] = Deadline  # tests give it another clock

    def __init__(self, config: CbbaConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        self._rules = TaskRules(
            regions=max(config.regions_per_robot * len(setup.vehicles), FEWEST_REGIONS),
            spacing=config.spacing_m,
        )
        self._worth = Worth(
            refine=config.refine,
            explore=config.explore,
            discount_s=config.discount_s,
            fuel=config.fuel,
            enough=config.enough_m,
            loyalty=config.loyalty,
        )
        self._way = MaasiConfig(alpha=config.alpha, beta=config.beta, control_cost=config.control_cost)
        self._desks: dict[str, Desk] = {}
        self._last: dict[str, Assignment] = {}  # of robots that are given none
        self._pace = Pace()
        self._cutting = {kind: Reserve(seconds) for kind, seconds in CUT_S.items()}
        self._listing = Reserve(LIST_S)
        self._valuing = Reserve(VALUE_S)

    def __repr__(self) -> str:
        return f"Cbba({self.config!r})"

    def desk(self, robot: str) -> Desk:
        """One robot's part in sharing tasks."""
        if robot not in self._desks:
            config = self.config
            rules = BidRules(
                config.bundle, config.renew_s, config.round_s, config.heartbeat_s, config.silence_s
            )
            self._desks[robot] = Desk(robot, self.setup, self._rules, self._worth, rules)
        return self._desks[robot]

    def plan(self, problem: PlanProblem) -> Plan:
        """The way into the first task of this robot's path; a hold with the reason where there is none."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = self.deadline(problem.deadline_s)
        assignment = problem.context.get("assignment")
        if not isinstance(assignment, Assignment):
            assignment = self._alone(problem, deadline)
        if assignment is None:
            return Plan(None, LATE)
        tasks = assignment.tasks
        if not tasks:
            return Plan(None, "holds: there are no tasks, all is explored and no target is waiting")
        by_name = {task.name: task for task in tasks}
        own = [by_name[name] for name in assignment.path if name in by_name]
        spare = "" if own else "all tasks are others', it helps with "
        reason, others = "holds: there is no task for it", Others(problem.others, problem)
        altitude = float(self.setup.vehicles[problem.robot].pose(problem.state)[2])
        _, width = self.desk(problem.robot).ability(problem, altitude)
        for task in own or self._nearest(problem, tasks):
            cutting = self._cutting[task.kind]
            if not cutting.fits(deadline):
                reason = LATE
                break
            with cutting.measured(deadline):
                places = places_in(task, problem, altitude, width, self.config.places)
            plan = approach(problem, self.setup, task, self._way, places, deadline, self._pace, others)
            if plan.trajectory is not None:
                return replace(plan, reason=f"{spare}{task.name}: {plan.reason}", task=task.name)
            reason = plan.reason
        if limited(problem):
            return returning(problem, self.setup, reason.removeprefix("holds: "))
        return Plan(None, reason)

    def _alone(self, problem: PlanProblem, deadline: Deadline) -> Assignment | None:
        """What is worth most to this robot, were there no others.

        Without time to work that out, what it was at the last time; None if there was none.
        """
        made = self._worked_out(problem, deadline)
        if made is None:
            return self._last.get(problem.robot)
        if not problem.context.get("rehearsal"):
            self._last[problem.robot] = made
        return made

    def _worked_out(self, problem: PlanProblem, deadline: Deadline) -> Assignment | None:
        if not self._listing.fits(deadline):
            return None
        requests = tuple(r for r in problem.context.get("requests", ()) if isinstance(r, Request))
        desk, robot = self.desk(problem.robot), problem.robot
        with self._listing.measured(deadline):
            tasks = tuple(task for task in desk.tasks(problem, requests) if task.robots == 1)
        left = deadline.left()
        until = deadline if math.isinf(left) else deadline.less((1.0 - VALUING) * left)
        if not self._valuing.fits(until):
            return None
        with self._valuing.watched(until) as over:
            state = AllocationState.start(robot, [robot], self.config.bundle)
            score = desk.score(problem, tasks, over=over)
            state = build_bundle(state, slot_names(tasks), score)
        return Assignment(tasks, tuple(task_of(slot) for slot in state.path))

    def _nearest(self, problem: PlanProblem, tasks: tuple[Task, ...]) -> list[Task]:
        here = self.setup.vehicles[problem.robot].pose(problem.state)[: problem.area.dimension]
        return sorted(tasks, key=lambda task: float(np.linalg.norm(task.place - here)))[:3]
