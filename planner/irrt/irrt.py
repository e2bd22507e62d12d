"""Planner `irrt`: the path of an information-rich random tree with the least cost (14).

Source: Ponda et al., on teams of humans and robots that search by CBBA, IRRT and Gaussian mixtures, 2012,
(7)-(14), Algorithms 1 and 2; the tree is Levine's (2010). What differs here, and why:

- The information of others' planned looks is added at the root: the paper takes the ways of others as
  unknown, here they are published.
- What is not explored counts as targets too (`targets`), as the number of targets is not known.
- I of (14) is divided by its value at the root, and its weight is in seconds: what it would be worth to
  know everything. Without a goal from outside the goal of tau* is the target with the most to learn per
  second of way.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta

from estimator.arrays import Count, FloatArray, Fraction, NonNegative, Positive
from estimator.sensor import gaussian
from planner.budget import limited, returning, truncated, way_along
from planner.deadline import Deadline, Reserve
from planner.irrt.fisher import information
from planner.irrt.kinematics import FORWARD, Kinematics, identified
from planner.irrt.targets import Targets, targets_of
from planner.irrt.tree import Bounds, Edges, Tree
from planner.maasi.maasi import crowded, unplannable
from planner.others import Others
from planner.plan import Over, Plan, PlannerSetup, PlanProblem, Trajectory
from planner.separation import keeps_apart

# That these may take, before they were measured: the way with its checks, what there is to be known, the
# tree's beginning and end, a step of its growth.
WAY_S, TARGETS_S, ROOT_S, STEP_S = 1e-3, 1e-3, 1e-3, 1e-3
CHECKS_S = 5e-4  # kept free while a way is reckoned, for what is asked of it then
TRIES = 8  # of the best paths, the first that may be taken is
MOST_LOOKS = 6  # on an edge
EDGES_PER_SIDE = 15.0  # of the area, where the mission does not say how long an edge is
LATE = "holds: its deadline was over before a way was found"


class IrrtConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the tree grows and what a path is worth."""

    nodes: Annotated[int, Meta(ge=2, le=20_000)] = 2000  # of the tree, at most
    edge_m: Positive | None = None  # length of an edge, about; default: a fifteenth of the area's longer side
    commit: Count = 3  # edges that a plan goes along the best path
    horizon_s: Positive | None = None  # of the paths; default: time to go across the area and half back
    bias: Fraction = 0.5  # of the samples, drawn from the targets' densities
    time_weight: NonNegative = 0.9  # alpha_tau of (14)
    information_s: NonNegative = 100.0  # alpha_I of (14): seconds that knowing everything is worth
    explore: NonNegative = 1.0  # weight of an unexplored cell of the area, in targets
    keep: bool = True  # the tree from plan to plan


@dataclass(slots=True)
class _Memory:
    """Of one robot: what is the same for all plans, and the tree of the last."""

    kinematics: Kinematics
    tree: Tree | None = None


class Irrt:
    """Planner: Algorithm 2, one pass of its loop for each plan."""

    Config: ClassVar[type[IrrtConfig]] = IrrtConfig
    deadline: Callable[[float], Deadline] = Deadline  # tests give it another clock

    def __init__(self, config: IrrtConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        self._memories: dict[str, _Memory] = {}
        self._finish, self._seeing = Reserve(WAY_S, yields=True), Reserve(TARGETS_S)
        self._rooting, self._step = Reserve(ROOT_S), Reserve(STEP_S)

    def __repr__(self) -> str:
        return f"Irrt({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The beginning of the best path; a hold with the reason where there is none."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = self.deadline(problem.deadline_s)
        sensor = self.setup.sensors[problem.robot]
        try:
            gaussian(sensor)
        except ValueError:
            return Plan(None, "holds: irrt needs a sensor whose noise is Gaussian, this one has another")
        if not self._seeing.fits(deadline):
            return Plan(None, LATE)
        with self._seeing.measured(deadline):
            targets = targets_of(problem, self.config.explore)
        if targets.count == 0:
            return self._otherwise(problem, "all is explored and no target is left to learn of")
        if problem.area.dimension != sensor.dimension:
            return Plan(None, f"holds: its sensor is of {sensor.dimension}D targets")
        growing = deadline.less(self._finish.kept(deadline))
        if not self._rooting.fits(growing):
            return Plan(None, LATE)
        with self._rooting.measured(deadline):
            tree, bounds = self._planted(problem)
        others = Others(problem.others, problem)
        enough = growing.less(self._rooting.seconds + self._step.seconds)
        root = np.linalg.inv(targets.covariances) + self._told(others, targets, enough.over)
        tree.value(sensor, targets, root, growing.less(self._step.seconds).over)
        worth = self.config.information_s / max(float(tree.cost[0]), 1e-300)
        rng = np.random.default_rng(problem.seed)
        barren = 0
        while not tree.full and barren < 8 and self._step.fits(growing):
            with self._step.measured(deadline):
                grown = tree.grow(sensor, targets, bounds, self.config.bias, worth, rng)
            barren = 0 if grown else barren + 1
        if tree.count == 1:
            return self._otherwise(problem, "no way from here is free" if barren else LATE[7:])
        return self._chosen(problem, tree, self._costs(problem, tree, targets, worth), deadline, others)

    def _planted(self, problem: PlanProblem) -> tuple[Tree, Bounds]:
        """The tree of the last plan from where the robot is now, or a new one; and its bounds."""
        vehicle, area = self.setup.vehicles[problem.robot], problem.area
        side = float((area.high - area.low).max())
        memory = self._memories.get(problem.robot)
        if memory is None:
            memory = _Memory(identified(vehicle, problem.state, max(0.2 * side, 1.0)))
            self._memories[problem.robot] = memory
        kinematics = memory.kinematics
        length = self.config.edge_m or side / EDGES_PER_SIDE
        measurements = max(1, round(length / kinematics.speed / problem.measure_period))
        looks = min(measurements, MOST_LOOKS)
        each = max(1, round(measurements / looks))
        edges = Edges(looks, each, each * problem.measure_period)
        pose = vehicle.pose(problem.state)
        low, high = np.minimum(pose[:3], np.inf), np.maximum(pose[:3], -np.inf)
        d = area.dimension
        low[:d], high[:d] = np.minimum(low[:d], area.low), np.maximum(high[:d], area.high)
        across = 1.5 * float(np.linalg.norm(high - low)) / kinematics.speed
        horizon = self.config.horizon_s or max(across, 4 * edges.duration)
        horizon = max(min(horizon, problem.budget.time, problem.budget.distance / kinematics.speed), 0.0)
        bounds = Bounds(low, high, self.setup.ground, horizon)
        old = memory.tree if self.config.keep else None
        tree = None
        if old is not None and old.edges == edges and old.parents.size == self.config.nodes:
            tree = old.moved(pose, 0.25 * edges.duration * kinematics.speed, 0.4)
        if tree is None:
            tree = Tree(pose, self.config.nodes, edges, kinematics)
        memory.tree = tree
        return tree, bounds

    def _told(self, others: Others, targets: Targets, over: Over) -> FloatArray:
        """Information (n, d, d) of the looks that others will take."""
        total = np.zeros_like(targets.covariances)
        for i, other in enumerate(others.commitments):
            if over():
                break
            sensor = self.setup.sensors.get(other.robot)
            if sensor is None:
                continue
            planned = others.tail(i)
            poses = planned.poses
            if np.isfinite(planned.stand_time):
                poses = np.vstack([poses, planned.stand_pose])
            try:
                total += information(sensor, poses, targets.means).sum(axis=0)
            except ValueError:
                continue  # a sensor without a Jacobian says nothing here
        return total

    def _costs(self, problem: PlanProblem, tree: Tree, targets: Targets, worth: float) -> FloatArray:
        """(14) of every node, in seconds; infinite at the root."""
        n, speed = tree.count, tree.kinematics.speed
        d = targets.means.shape[0]
        goal = problem.context.get("goal")
        place = np.zeros(0) if goal is None else np.asarray(goal, dtype=np.float64).ravel()[:d]
        if place.size != d or not np.isfinite(place).all():
            here = np.linalg.norm(targets.means.T - tree.poses[0, :d], axis=1) / speed
            left = np.trace(np.linalg.inv(tree.fisher[0]), axis1=1, axis2=2)
            place = targets.means[:, int(np.argmax(targets.weights * left / (here + tree.edges.duration)))]
        to_go = np.linalg.norm(tree.poses[:n, :d] - place, axis=1) / speed
        cost = self.config.time_weight * tree.times[:n] + to_go + worth * tree.cost[:n]
        cost[0] = np.inf
        return np.where(np.isfinite(cost), cost, np.inf)

    def _chosen(
        self, problem: PlanProblem, tree: Tree, costs: FloatArray, deadline: Deadline, others: Others
    ) -> Plan:
        """The best path that may be taken, of the TRIES best that begin differently."""
        seen: set[int] = set()
        why = "no path has a value"
        for node in np.argsort(costs, kind="stable"):
            if not np.isfinite(costs[node]) or len(seen) == TRIES:
                break
            path = tree.path(int(node))[: self.config.commit]
            if path[-1] in seen:
                continue
            if seen and not self._finish.fits(deadline):
                why = "its deadline was over before a way was found that may be taken"
                break
            seen.add(path[-1])
            with self._finish.measured(deadline):
                way, why = self._way(problem, tree, path, others, deadline.less(CHECKS_S).over)
            if way is not None:
                terms = {
                    "seconds": float(tree.times[node]),
                    "information": float(tree.cost[node]),
                    "information_here": float(tree.cost[0]),
                    "nodes": float(tree.count),
                }
                place = ", ".join(f"{x:.1f}" for x in way.waypoint)
                reason = f"{len(path)} of {len(tree.path(int(node)))} edges of the best path, to ({place})"
                return Plan(way, reason, -float(costs[node]), terms)
        return self._otherwise(problem, why)

    def _way(
        self, problem: PlanProblem, tree: Tree, path: list[int], others: Others, over: Over
    ) -> tuple[Trajectory | None, str]:
        """The vehicle's own way along the nodes, or why it may not be taken."""
        vehicle = self.setup.vehicles[problem.robot]
        near = 0.3 * tree.edges.duration * tree.kinematics.speed
        if tree.kinematics.mode == FORWARD:
            near = max(near, 0.5 * tree.kinematics.turn_radius)
        route = tree.poses[path, :3]
        way = way_along(problem, self.setup, route, near, over)
        if way is None:
            return None, LATE[7:] if over() else "every way would touch an obstacle"
        if not way.end_time > way.start_time:
            return None, "it is there already"
        way = truncated(problem, self.setup, way)
        if way is None:
            return None, "its budget allows no way"
        if not keeps_apart(problem, vehicle, way, others.courses):
            return None, crowded(problem.separation).removeprefix("holds: ")
        return way, ""

    def _otherwise(self, problem: PlanProblem, why: str) -> Plan:
        return returning(problem, self.setup, why) if limited(problem) else Plan(None, f"holds: {why}")
