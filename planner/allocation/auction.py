"""What the rounds of CBBA work on, as arrays: what tasks are worth to whom, and what robots believe."""

from typing import NamedTuple

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from planner.allocation.consensus import NOBODY
from planner.allocation.score import TeamScores

ROUND, HEARING, ROBOT, DIFFERING = 0, 1, 2, 3  # of `marks`: where to go on; tasks that are talked about


class Prices(NamedTuple):
    """What tasks are worth to whom, and who hears whom. See `TeamScores`."""

    values: FloatArray
    first: FloatArray
    legs: FloatArray
    legs_to: FloatArray
    durations: FloatArray
    first_e: FloatArray
    legs_e: FloatArray
    legs_to_e: FloatArray
    durations_e: FloatArray
    kinds: IntArray
    fuel: float
    limits: FloatArray
    home: FloatArray
    groups: IntArray  # (t,) the slots of one task have one number
    offsets: IntArray  # (n + 1,) robot i hears edges[offsets[i]:offsets[i + 1]], in order
    edges: IntArray

    @staticmethod
    def of(scores: TeamScores, groups: IntArray, offsets: IntArray, edges: IntArray) -> "Prices":
        """Of n robots and t tasks."""
        return Prices(
            scores.values,
            scores.first,
            scores.legs,
            scores.legs_to,
            scores.durations,
            scores.first_e,
            scores.legs_e,
            scores.legs_to_e,
            scores.durations_e,
            scores.kinds,
            scores.fuel,
            scores.limits,
            scores.home,
            groups,
            offsets,
            edges,
        )


class Auction(NamedTuple):
    """What n robots believe of t tasks, and how far the rounds have come. Arrays are changed in place."""

    y: FloatArray  # (n, t) winning bids
    z: IntArray  # (n, t) winning agents
    s: FloatArray  # (n, n) timestamps
    bundles: IntArray  # (n, capacity)
    paths: IntArray  # (n, capacity)
    lengths: IntArray  # (n,) of both
    gains: FloatArray  # (n, capacity, t) on top of the first l tasks of each robot's bundle
    places: IntArray  # (n, capacity, t) of these in the path
    computed: IntArray  # (n,) up to which l
    dirty: BoolArray  # (t,) tasks that robots may differ on
    stale: BoolArray  # (n,) robots whose beliefs changed since they built
    columns: IntArray  # (t,) the tasks that are talked about, as many as marks[DIFFERING]
    y_said: FloatArray  # (n, t) what robots say of these
    z_said: IntArray  # (n, t)
    s_said: FloatArray  # (n, n)
    marks: IntArray  # (4,)

    @staticmethod
    def opened(n: int, t: int, capacity: int) -> "Auction":
        """Nothing known, nothing bid."""
        return Auction(
            y=np.zeros((n, t)),
            z=np.full((n, t), NOBODY, dtype=np.int64),
            s=np.full((n, n), -1.0),
            bundles=np.zeros((n, capacity), dtype=np.int64),
            paths=np.zeros((n, capacity), dtype=np.int64),
            lengths=np.zeros(n, dtype=np.int64),
            gains=np.empty((n, capacity, t)),
            places=np.empty((n, capacity, t), dtype=np.int64),
            computed=np.full(n, -1, dtype=np.int64),
            dirty=np.zeros(t, dtype=np.bool_),
            stale=np.ones(n, dtype=np.bool_),
            columns=np.empty(t, dtype=np.int64),
            y_said=np.empty((n, t)),
            z_said=np.empty((n, t), dtype=np.int64),
            s_said=np.empty((n, n)),
            marks=np.zeros(4, dtype=np.int64),
        )
