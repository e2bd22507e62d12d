"""Planner `cbba`: the team shares its tasks by CBBA, and each robot plans its way to the first of its own.

Sources: Choi, Brunet, How (2009) and Ponda et al. (2012) for the allocation; the way within a task is chosen
as by (MA)ASI (17), (27) among places in the task, given what the others have committed to.

Who does what is settled between the robots before any of them plans, and is given with the problem (see
`desk`). A robot that is given nothing is alone: it takes what is worth most to it.
"""

from dataclasses import replace
from typing import ClassVar

import msgspec
import numpy as np

from estimator.arrays import Count, FloatArray, NonNegative, Positive
from planner.allocation.cbba import AllocationState, build_bundle
from planner.allocation.desk import Assignment, BidRules, Desk
from planner.allocation.partition import equal_shares
from planner.allocation.slots import task_of
from planner.allocation.tasks import Request, Task, TaskRules
from planner.allocation.valuation import Worth, slot_names
from planner.budget import affordable, limited, returning
from planner.deadline import Deadline
from planner.maasi.maasi import MaasiConfig, chosen, crowded, scored, unplannable
from planner.maasi.outlook import outlook
from planner.plan import Plan, PlannerSetup, PlanProblem
from planner.separation import keeps_apart
from planner.vehicles.route import routed

LATE = "holds: its time to plan is over"
BATCH = 4  # places that are looked at between two looks at the clock


class CbbaConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a team shares its tasks."""

    bundle: Count = 5  # tasks that a robot takes on, at most
    regions_per_robot: Count = 2  # to explore, when nothing is explored
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
    round_s: Positive = 0.05  # between two bids of a robot, at least
    heartbeat_s: Positive = 0.5  # between two bids of a robot, at most: it bids on when all is agreed
    silence_s: Positive = 5.0  # a robot that nobody has heard for so long is taken for gone


class Cbba:
    """Planner: CBBA over the tasks of the moment, then a way to the first of one's own."""

    Config: ClassVar[type[CbbaConfig]] = CbbaConfig

    def __init__(self, config: CbbaConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        self._rules = TaskRules(
            regions=config.regions_per_robot * max(len(setup.vehicles), 1), spacing=config.spacing_m
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

    def __repr__(self) -> str:
        return f"Cbba({self.config!r})"

    def desk(self, robot: str) -> Desk:
        """One robot's part in sharing tasks."""
        if robot not in self._desks:
            config = self.config
            rules = BidRules(config.bundle, config.round_s, config.heartbeat_s, config.silence_s)
            self._desks[robot] = Desk(robot, self.setup, self._rules, self._worth, rules)
        return self._desks[robot]

    def plan(self, problem: PlanProblem) -> Plan:
        """The way into the first task of this robot's path; a hold with the reason where there is none."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = Deadline(problem.deadline_s)
        assignment = problem.context.get("assignment")
        if not isinstance(assignment, Assignment):
            assignment = self._alone(problem)
        tasks = assignment.tasks
        if not tasks:
            return Plan(None, "holds: there are no tasks, all is explored and no target is waiting")
        by_name = {task.name: task for task in tasks}
        own = [by_name[name] for name in assignment.path if name in by_name]
        spare = "" if own else "all tasks are others', it helps with "
        reason = "holds: no place in a task can be reached within the budget"
        for task in own or self._nearest(problem, tasks):
            if deadline.over():
                return Plan(None, LATE)
            plan = self._towards(problem, task, deadline)
            if plan.trajectory is not None:
                return replace(plan, reason=f"{spare}{task.name}: {plan.reason}", task=task.name)
            reason = plan.reason
        if limited(problem):
            return returning(problem, self.setup, reason.removeprefix("holds: "))
        return Plan(None, reason)

    def _alone(self, problem: PlanProblem) -> Assignment:
        """What is worth most to this robot, were there no others."""
        requests = tuple(r for r in problem.context.get("requests", ()) if isinstance(r, Request))
        desk, robot = self.desk(problem.robot), problem.robot
        tasks = tuple(task for task in desk.tasks(problem, requests) if task.robots == 1)
        state = AllocationState.start(robot, [robot], self.config.bundle)
        state = build_bundle(state, slot_names(tasks), desk.score(problem, tasks))
        return Assignment(tasks, tuple(task_of(slot) for slot in state.path))

    def _nearest(self, problem: PlanProblem, tasks: tuple[Task, ...]) -> list[Task]:
        here = self.setup.vehicles[problem.robot].pose(problem.state)[: problem.area.dimension]
        return sorted(tasks, key=lambda task: float(np.linalg.norm(task.place - here)))[:3]

    def _towards(self, problem: PlanProblem, task: Task, deadline: Deadline) -> Plan:
        """The best way into one task."""
        vehicle = self.setup.vehicles[problem.robot]
        here = vehicle.pose(problem.state)[:3]
        speed, width = self.desk(problem.robot).ability(problem, float(here[2]))
        waypoints = self._waypoints(problem, task, float(here[2]), width)
        ground, d = self.setup.ground, problem.area.dimension
        if ground is not None and len(waypoints):
            waypoints = waypoints[ground.clear(waypoints[:, :d].T)]
            starts = np.repeat(here[:d, None], len(waypoints), axis=1)
            straight = ground.segments_clear(starts, np.ascontiguousarray(waypoints[:, :d].T))
            if not straight.any():
                return self._around(problem, waypoints, here)
            waypoints = waypoints[straight]
        waypoints = waypoints[_affordable(problem, here, waypoints)]
        if not len(waypoints):
            return Plan(None, "holds: no place in its tasks can be reached within the budget")
        best, reason = Plan(None, "", -np.inf), "holds: it is at its task already, or its budget is spent"
        batch = len(waypoints) if np.isinf(problem.deadline_s) else BATCH
        for first in range(0, len(waypoints), batch):
            if first and deadline.over():
                break
            view = outlook(problem, self.setup, waypoints[first : first + batch], problem.others)
            objective = scored(view, view.exploration, self._way)
            seconds = view.steps * vehicle.control_period
            allowed = np.isfinite(objective) & (
                seconds <= problem.budget.time - _homeward(problem, view.predictions.waypoints) / speed
            )
            if allowed.any() and not (allowed & view.clear).any():
                reason = crowded(problem.separation)
            objective = np.where(allowed & view.clear, objective, -np.inf)
            for w in np.argsort(-objective, kind="stable"):
                if not objective[w] > best.objective:
                    break
                plan = chosen(problem, self.setup, view, int(w), view.exploration[w], float(objective[w]))
                if plan.trajectory is not None and affordable(problem, self.setup, plan.trajectory):
                    best = plan
                    break
                reason = "holds: its tasks and the way home are beyond its budget"
        return best if best.trajectory is not None else Plan(None, reason)

    def _around(self, problem: PlanProblem, waypoints: FloatArray, here: FloatArray) -> Plan:
        """To the first place of a task that there is a way to, around what stands between."""
        ground, d = self.setup.ground, problem.area.dimension
        for waypoint in waypoints if ground is not None else ():
            corners = ground.path(here[:d], waypoint[:d]) if ground is not None else None
            if corners is None or corners.shape[1] < 2:
                continue
            route = np.tile(waypoint, (corners.shape[1] - 1, 1))
            route[:, :d] = corners[:, 1:].T
            length = float(np.linalg.norm(np.diff(np.vstack([here, route]), axis=0), axis=1).sum())
            if length + _homeward(problem, waypoint[None])[0] > problem.budget.distance:
                continue
            vehicle = self.setup.vehicles[problem.robot]
            way = routed(vehicle, problem.state, route, problem.start_time, problem.measure_period, near=1.0)
            if affordable(problem, self.setup, way) and keeps_apart(problem, vehicle, way):
                return Plan(way, f"around obstacles, {length:.0f} m")
        return Plan(None, "holds: there is no way to its tasks")

    def _waypoints(self, problem: PlanProblem, task: Task, altitude: float, width: float) -> FloatArray:
        """Places (w, 3) in a task to choose from, the middle among them; the sensor sweeps `width` m."""
        points = [task.place[:, None]]
        if task.kind == "explore":
            labels, _ = equal_shares(task.points, task.weights, self.config.places)
            for label in range(int(labels.max(initial=-1)) + 1):
                rows = labels == label
                points.append(np.average(task.points[:, rows], axis=1, weights=task.weights[rows])[:, None])
        elif task.kind == "refine":
            points.append(task.points[:, : self.config.places])
            around = 0.5 * (task.radius + width)
            angles = 2 * np.pi * np.arange(8) / 8
            ring = np.repeat(task.place[:, None], 8, axis=1)
            ring[0] += around * np.cos(angles)
            ring[1] += around * np.sin(angles)
            points.append(ring)
        made = np.hstack(points)
        inside = ((made >= problem.area.low[:, None]) & (made <= problem.area.high[:, None])).all(axis=0)
        made = made[:, inside & np.isfinite(made).all(axis=0)]
        waypoints = np.full((made.shape[1], 3), altitude)
        waypoints[:, : len(made)] = made.T
        return waypoints


def _homeward(problem: PlanProblem, waypoints: FloatArray) -> FloatArray:
    """Metres (w,) from each waypoint home; 0 where there is no home to return to."""
    home = problem.budget.home
    if home is None:
        return np.zeros(len(waypoints))
    return np.asarray(np.linalg.norm(waypoints - home, axis=1))


def _affordable(problem: PlanProblem, here: FloatArray, waypoints: FloatArray) -> FloatArray:
    """(w,) whether the way to each waypoint and home from there is within the budget's metres."""
    metres = np.linalg.norm(waypoints - here, axis=1) + _homeward(problem, waypoints)
    return np.asarray(metres <= problem.budget.distance)
