"""Planner `mdp_greedy`, the baseline of Ponda et al. (2012), section IV.B.1: towards the cell with the most.

The density of the targets is summed up in cells, the cell with the largest share is the goal, and the way
there is planned by value iteration, moving to adjacent cells straight or diagonally.
"""

from collections.abc import Callable
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta

from estimator.arrays import Count, FloatArray, IntArray
from planner.budget import limited, returning, truncated, way_along
from planner.deadline import Deadline, Reserve
from planner.irrt.value_iteration import neighbours, values
from planner.maasi.maasi import crowded, unplannable
from planner.others import Others
from planner.plan import Over, Plan, PlannerSetup, PlanProblem, Trajectory
from planner.separation import keeps_apart

MASS_S, TRY_S = (
    1e-3,
    2e-3,
)  # that summing up what is sought, and one goal, may take, before they were measured
CHECKS_S = 5e-4  # kept free while a way is reckoned, for what is asked of it then
LATE = "holds: its deadline was over before a way was found"
TRIES = 6  # goals, the best first
DEFAULT_CELLS = {2: [20, 20], 3: [10, 10, 6]}


class MdpGreedyConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The grid of the decision process."""

    cells: Annotated[list[Annotated[int, Meta(ge=1, le=200)]], Meta(min_length=2, max_length=3)] | None = (
        None  # per axis; default: 20 x 20, in 3D 10 x 10 x 6
    )
    steps: Count = 5  # moves that a plan makes towards the goal


class MdpGreedy:
    """Planner: some moves of the shortest way to the cell that holds most of what is sought."""

    Config: ClassVar[type[MdpGreedyConfig]] = MdpGreedyConfig
    deadline: Callable[[float], Deadline] = Deadline  # tests give it another clock

    def __init__(self, config: MdpGreedyConfig, setup: PlannerSetup) -> None:
        self.config, self.setup = config, setup
        area = setup.area
        counts = config.cells or DEFAULT_CELLS[area.dimension]
        if len(counts) != area.dimension:
            raise ValueError(f"cells: expected {area.dimension} numbers, one per axis, got {counts}")
        self._shape = tuple(counts)
        self._side = (area.high - area.low) / np.array(counts)
        axes = [
            low + (np.arange(n) + 0.5) * side
            for low, n, side in zip(area.low, counts, self._side, strict=True)
        ]
        self._centres = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(area.dimension, -1)
        self._moves = neighbours(self._shape, self._centres, setup.ground)
        self._lengths = np.linalg.norm(self._centres[:, self._moves] - self._centres[:, :, None], axis=0)
        self._summing, self._trying = Reserve(MASS_S), Reserve(TRY_S, yields=True)

    def __repr__(self) -> str:
        return f"MdpGreedy({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """Moves towards the richest cell that may be gone to; a hold with the reason where there is none."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = self.deadline(problem.deadline_s)
        if not self._summing.fits(deadline.less(self._trying.kept(deadline))):
            return Plan(None, LATE)
        with self._summing.measured(deadline):
            mass = self._mass(problem)
        if not mass.any():
            return self._otherwise(problem, "all is explored and no target is left to look for")
        vehicle, d = self.setup.vehicles[problem.robot], problem.area.dimension
        here = vehicle.pose(problem.state)[:3]
        others = Others(problem.others, problem)
        own = int(self._cells(here[:d, None])[0])
        entries = self._entries(here[:d], own)
        why = "there is no way from here to any cell"
        order = np.argsort(-mass, kind="stable")
        for goal in order[: int((mass > 0).sum())][: TRIES + 1]:
            if goal == own:
                continue
            if not self._trying.fits(deadline):
                why = LATE[7:]
                break
            with self._trying.measured(deadline):
                over = deadline.less(CHECKS_S).over
                way, why = self._way(problem, here, entries, int(goal), others, over)
            if way is not None:
                share = float(mass[goal] / mass.sum())
                place = ", ".join(f"{x:.1f}" for x in self._centres[:, goal])
                return Plan(way, f"towards ({place}) with {share:.0%} of what is sought", share)
        return self._otherwise(problem, why)

    def _way(
        self,
        problem: PlanProblem,
        here: FloatArray,
        entries: IntArray,
        goal: int,
        others: Others,
        over: Over,
    ) -> tuple[Trajectory | None, str]:
        """The first moves towards a goal's cell, or why they may not be made."""
        v = values(self._moves, self._lengths, goal, self._moves.shape[0])
        route = self._route(here, v, entries, goal)
        if route is None:
            return None, "there is no way from here to any cell"
        way = way_along(problem, self.setup, route, 0.5 * float(self._side[:2].min()), over)
        if way is None:
            return None, LATE[7:] if over() else "every way would touch an obstacle"
        way = truncated(problem, self.setup, way)
        if way is None:
            return None, "its budget allows no way"
        if not way.end_time > way.start_time:
            return None, "it is there already"
        if not keeps_apart(problem, self.setup.vehicles[problem.robot], way, others.courses):
            return None, crowded(problem.separation).removeprefix("holds: ")
        return way, ""

    def _mass(self, problem: PlanProblem) -> FloatArray:
        """What is sought (cells,): the intensity, else the clusters, else what is unexplored."""
        total = self._centres.shape[1]
        believed = problem.intensity
        for points, weights in (
            (np.zeros((0, 0)), np.zeros(0)) if believed is None else (believed.points, believed.weights),
            (problem.clusters, np.ones(problem.clusters.shape[1])),
        ):
            keep = np.isfinite(weights) & (weights > 0)
            keep = keep & np.isfinite(points).all(axis=0) if points.size else np.zeros(0, dtype=np.bool_)
            if keep.any():
                return np.asarray(np.bincount(self._cells(points[:, keep]), weights[keep], total), np.float64)
        e = problem.exploration
        axes = [np.linspace(e.low[i], e.high[i], n) for i, n in enumerate(e.values.shape)]
        points = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(len(axes), -1)
        left = np.where(e.values > 1e-3, e.values, 0.0).ravel()  # False for NaN
        return np.asarray(np.bincount(self._cells(points), left, total), np.float64)

    def _cells(self, points: FloatArray) -> IntArray:
        """The cell (n,) of each of points (d, n); the nearest of those outside the area."""
        inside = np.clip(points, self.setup.area.low[:, None], self.setup.area.high[:, None])
        index = ((inside - self.setup.area.low[:, None]) / self._side[:, None]).astype(np.int64)
        index = np.minimum(index, np.array(self._shape)[:, None] - 1)
        return np.asarray(np.ravel_multi_index(tuple(index), self._shape), dtype=np.int64)

    def _entries(self, here: FloatArray, own: int) -> IntArray:
        """Cells whose centres the robot can go to from where it is: its own and those around."""
        index = np.stack(np.unravel_index(np.arange(self._centres.shape[1]), self._shape))
        close = np.flatnonzero((np.abs(index - index[:, [own]]) <= 1).all(axis=0))
        ground = self.setup.ground
        if ground is not None:
            starts = np.repeat(here[:, None], close.size, axis=1)
            close = close[ground.segments_clear(starts, np.ascontiguousarray(self._centres[:, close]))]
        return np.asarray(close, dtype=np.int64)

    def _route(self, here: FloatArray, v: FloatArray, entries: IntArray, goal: int) -> FloatArray | None:
        """Waypoints (r, 3) of the first moves of the greedy policy; None where there is no way."""
        d = self._centres.shape[0]
        first = np.linalg.norm(self._centres[:, entries] - here[:d, None], axis=0) + v[entries]
        if not entries.size or not np.isfinite(first.min()):
            return None
        cell, cells = int(entries[np.argmin(first)]), []
        for _ in range(self.config.steps):
            cells.append(cell)
            if cell == goal:
                break
            around = self._moves[cell][self._moves[cell] >= 0]
            gaps = np.linalg.norm(self._centres[:, around] - self._centres[:, [cell]], axis=0)
            cell = int(around[np.argmin(gaps + v[around])])
        route = np.tile(here, (len(cells), 1))
        route[:, :d] = self._centres[:, cells].T
        return route

    def _otherwise(self, problem: PlanProblem, why: str) -> Plan:
        return returning(problem, self.setup, why) if limited(problem) else Plan(None, f"holds: {why}")
