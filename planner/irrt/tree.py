"""The information-rich random tree of one robot: it grows, is valued anew, and is cut to where the robot is.

Ponda et al. (2012), Algorithms 1 and 2. A node is the end of an edge on which the robot takes a fixed number
of looks; the poses of the looks stay with the node, so that its information can be worked out again whenever
the estimates change, without predicting the vehicle again (Algorithm 2, line 9).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.sensor import SensorModel
from planner.irrt.fisher import accumulate, information
from planner.irrt.growth import EXPLORE, INFORM, OPTIMISE, adopt, extended, subtree
from planner.irrt.kinematics import Kinematics
from planner.irrt.targets import Targets
from planner.plan import Ground

SAMPLES = 16  # towards which the tree grows at once
REVALUED = 128  # nodes at once
CHAIN = 8  # edges towards one sample, at most
HEURISTICS = np.array([EXPLORE, EXPLORE, OPTIMISE, INFORM])  # of which one is drawn for each sample


@dataclass(frozen=True, slots=True)
class Edges:
    """What the edges of a tree are."""

    looks: int  # on each
    each: int  # measurements that one look stands for
    seconds: float  # between looks

    @property
    def duration(self) -> float:
        return self.looks * self.seconds


@dataclass(frozen=True, slots=True)
class Bounds:
    """Where and for how long a tree may grow."""

    low: FloatArray  # (3,) m
    high: FloatArray  # (3,)
    ground: Ground | None
    horizon: float  # s after the root


class Tree:
    """Nodes in flat arrays with room for `room`; node 0 is the root, and parents come before children."""

    def __init__(self, pose: FloatArray, room: int, edges: Edges, kinematics: Kinematics) -> None:
        self.edges, self.kinematics = edges, kinematics
        self.count = 1
        self.parents = np.full(room, -1, dtype=np.int64)
        self.poses = np.zeros((room, 4))
        self.times = np.zeros(room)  # s after the root
        self.looks = np.zeros((room, edges.looks, 4))
        self.cost = np.zeros(room)  # I of (13), m^2
        self.fisher = np.zeros((room, 0, 2, 2))
        self.poses[0] = pose
        self.looks[0] = pose
        k = kinematics
        self._model = np.array([k.mode, k.speed, k.turn_rate, float(k.heads), k.climb], dtype=np.float64)

    def __repr__(self) -> str:
        return f"Tree({self.count} of {self.parents.size} nodes)"

    @property
    def full(self) -> bool:
        return self.count == self.parents.size

    def value(
        self, sensor: SensorModel, targets: Targets, root: FloatArray, over: Callable[[], bool]
    ) -> None:
        """Work out the information of all nodes anew, from the root's (n, d, d) on.

        When time is `over` meanwhile, the nodes that are left are dropped.
        """
        n, d = targets.count, targets.means.shape[0]
        self.fisher = np.zeros((self.parents.size, n, d, d))
        self.fisher[0] = root
        nothing = np.zeros((1, 1, n, d, d))
        accumulate(np.zeros(1, dtype=np.int64), nothing, targets.weights, 0, 1, self.fisher, self.cost)
        for first in range(1, self.count, REVALUED):
            if over():
                self.count = first
                return
            self._inform(sensor, targets, first, min(first + REVALUED, self.count))

    def grow(
        self,
        sensor: SensorModel,
        targets: Targets,
        bounds: Bounds,
        bias: float,
        worth: float,
        rng: np.random.Generator,
    ) -> int:
        """Grow towards SAMPLES places, with information; how many nodes came (Algorithm 1).

        Args:
            sensor: whose looks are valued.
            targets: towards one of which, drawn by weight, a share `bias` of the samples is taken.
            bounds: of the ways.
            bias: see above; the other samples lie anywhere within the bounds.
            worth: seconds that a m^2 of (13) is worth, where the node to extend is chosen by information.
            rng: of all draws; it is advanced alike whatever grows.
        """
        samples = rng.uniform(bounds.low, bounds.high, (SAMPLES, 3))
        towards = rng.random(SAMPLES) < bias
        picks = rng.random(SAMPLES)
        spreads = rng.standard_normal((SAMPLES, 3))
        kinds = HEURISTICS[rng.integers(0, HEURISTICS.size, SAMPLES)]
        if targets.count:
            d = targets.means.shape[0]
            chosen = np.minimum(np.searchsorted(np.cumsum(targets.weights), picks), targets.count - 1)
            wide = np.sqrt(np.diagonal(targets.covariances, axis1=1, axis2=2))[chosen]
            near = targets.means[:, chosen].T + wide * spreads[:, :d]
            samples[towards, :d] = near[towards]
        samples = np.clip(samples, bounds.low, bounds.high)
        starts, edges, ways = extended(
            samples, kinds, self.count, self.poses, self.times, self.cost, self._model, CHAIN,
            self.edges.looks, self.edges.seconds, bounds.horizon, worth, bounds.low, bounds.high,
        )  # fmt: skip
        free = self._free(starts, edges, ways, bounds.ground, targets.means.shape[0])
        first = self.count
        self.count = adopt(
            starts, edges, ways, free, first, self.edges.seconds,
            self.parents, self.poses, self.times, self.looks,
        )  # fmt: skip
        self._inform(sensor, targets, first, self.count)
        return self.count - first

    def path(self, node: int) -> list[int]:
        """The nodes from the root's child to `node`."""
        nodes = []
        while node > 0:
            nodes.append(node)
            node = int(self.parents[node])
        return nodes[::-1]

    def moved(self, pose: FloatArray, near: float, turned: float) -> "Tree | None":
        """The tree from the node at which the robot is now, with the pose (4,) as its root.

        None if no node is within `near` metres and, where yaw is the direction of travel, `turned` radians.
        """
        offsets = self.poses[: self.count] - pose
        gaps = np.linalg.norm(offsets[:, :3], axis=1)
        if self.kinematics.heads:
            off = np.abs((offsets[:, 3] + math.pi) % (2 * math.pi) - math.pi)
            gaps = np.where(off <= turned, gaps, np.inf)
        close = np.flatnonzero(gaps <= near)
        if close.size == 0:
            return None
        best: tuple[IntArray, IntArray] | None = None
        for node in close[np.argsort(gaps[close], kind="stable")][:4]:  # the one of most descendants
            kept, above = subtree(int(node), self.count, self.parents)
            if best is None or kept.size > best[0].size:
                best = kept, above
        assert best is not None
        kept, above = (rows[: max(1, 3 * self.parents.size // 4)] for rows in best)
        other = Tree(pose, self.parents.size, self.edges, self.kinematics)
        other.count = n = kept.size
        other.parents[:n] = above
        other.poses[1:n] = self.poses[kept[1:]]
        other.looks[1:n] = self.looks[kept[1:]]
        other.times[1:n] = self.times[kept[1:]] - self.times[kept[0]]
        return other

    def _inform(self, sensor: SensorModel, targets: Targets, first: int, last: int) -> None:
        if last <= first:
            return
        n, d = targets.count, targets.means.shape[0]
        gains = information(sensor, self.looks[first:last].reshape(-1, 4), targets.means)
        gains = self.edges.each * gains.reshape(last - first, self.edges.looks, n, d, d)
        accumulate(self.parents, gains, targets.weights, first, last, self.fisher, self.cost)

    def _free(
        self, starts: IntArray, edges: IntArray, ways: FloatArray, ground: Ground | None, d: int
    ) -> BoolArray:
        """Whether each edge (b, chain) keeps clear of the ground's obstacles."""
        b, chain, looks, _ = ways.shape
        free = np.ones((b, chain), dtype=np.bool_)
        if ground is None:
            return free
        there = np.flatnonzero((starts >= 0) & (edges > 0))
        flat = ways[there].reshape(there.size, chain * looks, 4)[:, :, :d]
        before = np.concatenate([self.poses[starts[there], None, :d], flat[:, :-1]], axis=1)
        used = np.repeat(np.arange(chain)[None] < edges[there, None], looks, axis=1)
        clear = np.ones(used.shape, dtype=np.bool_)
        clear[used] = ground.segments_clear(
            np.ascontiguousarray(before[used].T), np.ascontiguousarray(flat[used].T)
        )
        free[there] = clear.reshape(there.size, chain, looks).all(axis=2)
        return free
