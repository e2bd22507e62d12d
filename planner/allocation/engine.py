"""CBBA of a whole team in rounds, on arrays: what the state machines of `cbba` come to, in milliseconds.

Every round all robots build their bundles, then each hears all its neighbours in their order, what they
believed at the round's end; see `rounds`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from planner.allocation.auction import ROUND, Auction, Prices
from planner.allocation.consensus import NOBODY
from planner.allocation.rounds import CONVERGED, RUNNING, run
from planner.allocation.score import TeamScores

PART = 200_000  # work between two questions for the time, about half a millisecond
_ALL = 2**62


@dataclass(frozen=True, slots=True, eq=False)
class Allocation:
    """Who does what, in which order, of n robots and t tasks."""

    paths: tuple[IntArray, ...]  # of each robot, tasks in the order of execution
    bundles: tuple[IntArray, ...]  # in the order of the bids
    winning_agents: IntArray  # (n, t) as each robot believes, -1 for nobody
    winning_bids: FloatArray  # (n, t)
    rounds: int  # until no robot changed anything
    converged: bool  # False: robots may have the same task still

    @property
    def worth(self) -> float:
        """The sum of the winning bids."""
        return float(self.winning_bids[0].sum()) if len(self.winning_bids) else 0.0


def allocate(
    scores: TeamScores,
    capacity: int,
    *,
    neighbours: BoolArray | None = None,
    groups: IntArray | None = None,
    needed: IntArray | None = None,
    max_rounds: int | None = None,
    over: Callable[[], bool] | None = None,
) -> Allocation:
    """CBBA to convergence, every robot starting from nothing.

    Args:
        scores: of n robots and t tasks.
        capacity: tasks in a bundle, at most.
        neighbours: (n, n) whether robot i hears robot k; default: all hear all.
        groups: (t,) the slots of one task have one number; default: every task its own.
        needed: (t,) how many robots the task of each slot needs; a task that does not get them is withdrawn
            (the one with the lowest sum of bids first), and all bid again.
        max_rounds: default: more than enough for any connected graph.
        over: whether the time is up, asked again and again; what the robots believe by then is the result.

    Raises:
        ValueError: if a shape does not fit.
    """
    n, t = scores.robots, scores.tasks
    if capacity < 0:
        raise ValueError(f"capacity: expected a number >= 0, got {capacity}")
    offsets, edges = _edges(neighbours, n)
    own = np.arange(t) if groups is None else np.asarray(groups, dtype=np.int64)
    if own.shape != (t,):
        raise ValueError(f"groups: expected shape ({t},), got {own.shape}")
    if needed is not None and np.shape(needed) != (t,):
        raise ValueError(f"needed: expected shape ({t},), got {np.shape(needed)}")
    rounds = 2 * (min(t, n * capacity) + 1) * max(n, 1) if max_rounds is None else max_rounds
    while True:
        made = _allocate(scores, min(capacity, t), offsets, edges, own, rounds, over)
        short = -1 if needed is None or not made.converged else _incomplete(made, own, np.asarray(needed))
        if short < 0:
            return made
        scores = replace(scores, values=np.where(own == short, -np.inf, scores.values))


def _allocate(
    scores: TeamScores,
    capacity: int,
    offsets: IntArray,
    edges: IntArray,
    groups: IntArray,
    max_rounds: int,
    over: Callable[[], bool] | None,
) -> Allocation:
    n, t = scores.robots, scores.tasks
    auction = Auction.opened(n, t, capacity)
    said = CONVERGED
    if n and t and capacity:
        prices = Prices.of(scores, groups, offsets, edges)
        said = RUNNING
        while said == RUNNING and not (over is not None and over()):
            said = run(prices, auction, max_rounds, _ALL if over is None else PART)
    return Allocation(
        paths=tuple(path[:length] for path, length in zip(auction.paths, auction.lengths, strict=True)),
        bundles=tuple(
            bundle[:length] for bundle, length in zip(auction.bundles, auction.lengths, strict=True)
        ),
        winning_agents=auction.z,
        winning_bids=auction.y,
        rounds=int(auction.marks[ROUND]),
        converged=said == CONVERGED,
    )


def _edges(neighbours: BoolArray | None, n: int) -> tuple[IntArray, IntArray]:
    """Whom each robot hears: rows offsets[i]:offsets[i + 1] of the second array, in order."""
    heard = np.ones((n, n), dtype=np.bool_) if neighbours is None else np.array(neighbours, dtype=np.bool_)
    if heard.shape != (n, n):
        raise ValueError(f"neighbours: expected shape ({n}, {n}), got {heard.shape}")
    np.fill_diagonal(heard, False)
    offsets = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(heard.sum(axis=1))])
    return offsets, np.nonzero(heard)[1].astype(np.int64)


def _incomplete(made: Allocation, groups: IntArray, needed: IntArray) -> int:
    """The group with some of its slots taken but not all that has the lowest sum of bids; -1: none."""
    if not len(made.winning_agents):
        return -1
    taken = made.winning_agents[0] != NOBODY
    of, column = np.unique(groups, return_inverse=True)
    wanted = np.zeros(of.size, dtype=np.int64)
    np.maximum.at(wanted, column, needed)
    got = np.bincount(column, taken, of.size)
    short = (got > 0) & (got < wanted)
    if not short.any():
        return -1
    sums = np.bincount(column, np.where(taken, made.winning_bids[0], 0.0), of.size)
    return int(of[np.argmin(np.where(short, sums, np.inf))])


def connected(neighbours: BoolArray) -> bool:
    """Whether words reach every robot from every other, over (n, n) who hears whom."""
    n = len(neighbours)
    reach = np.eye(n, dtype=np.bool_) | np.asarray(neighbours, dtype=np.bool_)
    for _ in range(max(1, int(np.ceil(np.log2(max(n, 2)))))):
        reach = reach @ reach
    return bool(reach.all())


def named(
    paths: Sequence[IntArray], robots: Sequence[str], tasks: Sequence[str]
) -> dict[str, tuple[str, ...]]:
    """Paths of indices as paths of names, by robot."""
    return {robot: tuple(tasks[j] for j in path) for robot, path in zip(robots, paths, strict=True)}
