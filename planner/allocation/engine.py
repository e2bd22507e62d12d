"""CBBA of a whole team in rounds, on arrays: what the state machines of `cbba` come to, in milliseconds.

Every round all robots build their bundles, then each hears all its neighbours in their order, what they
believed at the round's end. Two things keep the work small. What all robots believe alike about a task no
message changes, so only tasks that they differ on are looked at. And what a robot's tasks gain on top of the
first l of its bundle depends on these alone, so it is kept for every l, for when the tail is released.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import exact_kernel
from planner.allocation.consensus import LEAVE, NOBODY, UPDATE, beats, verdict
from planner.allocation.insertion import insertion_gains
from planner.allocation.score import TeamScores


@dataclass(frozen=True, slots=True, eq=False)
class Allocation:
    """Who does what, in which order, of n robots and t tasks."""

    paths: tuple[IntArray, ...]  # of each robot, tasks in the order of execution
    bundles: tuple[IntArray, ...]  # in the order of the bids
    winning_agents: IntArray  # (n, t) as each robot believes, -1 for nobody
    winning_bids: FloatArray  # (n, t)
    rounds: int  # until no robot changed anything
    converged: bool

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
        made = _allocate(scores, min(capacity, t), offsets, edges, own, rounds)
        short = -1 if needed is None or not made.converged else _incomplete(made, own, np.asarray(needed))
        if short < 0:
            return made
        scores = replace(scores, values=np.where(own == short, -np.inf, scores.values))


def _allocate(
    scores: TeamScores, capacity: int, offsets: IntArray, edges: IntArray, groups: IntArray, max_rounds: int
) -> Allocation:
    n, t = scores.robots, scores.tasks
    y, z = np.zeros((n, t)), np.full((n, t), NOBODY, dtype=np.int64)
    bundles, paths = np.zeros((2, n, max(capacity, 1)), dtype=np.int64)
    lengths = np.zeros(n, dtype=np.int64)
    rounds, converged = 0, True
    if n and t and capacity:
        rounds, converged = _run(
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
            capacity,
            offsets,
            edges,
            groups,
            max_rounds,
            y,
            z,
            bundles,
            paths,
            lengths,
        )
    return Allocation(
        paths=tuple(path[:length] for path, length in zip(paths, lengths, strict=True)),
        bundles=tuple(bundle[:length] for bundle, length in zip(bundles, lengths, strict=True)),
        winning_agents=z,
        winning_bids=y,
        rounds=rounds,
        converged=converged,
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
    short: list[tuple[float, int]] = []
    for group in np.unique(groups[taken]):
        mine = taken & (groups == group)
        if mine.sum() < needed[mine].max():
            short.append((float(made.winning_bids[0][mine].sum()), int(group)))
    return min(short)[1] if short else -1


@exact_kernel
def _run(
    values: FloatArray,
    first: FloatArray,
    legs: FloatArray,
    legs_to: FloatArray,
    durations: FloatArray,
    first_e: FloatArray,
    legs_e: FloatArray,
    legs_to_e: FloatArray,
    durations_e: FloatArray,
    kinds: IntArray,
    fuel: float,
    limits: FloatArray,
    home: FloatArray,
    capacity: int,
    offsets: IntArray,
    edges: IntArray,
    groups: IntArray,
    max_rounds: int,
    y: FloatArray,
    z: IntArray,
    bundles: IntArray,
    paths: IntArray,
    lengths: IntArray,
) -> tuple[int, bool]:
    n, t = values.shape
    s = np.full((n, n), -1.0)
    gains = np.empty((n, capacity, t))  # on top of the first l tasks of each robot's bundle
    places = np.empty((n, capacity, t), dtype=np.int64)
    computed = np.full(n, -1, dtype=np.int64)  # up to which l
    dirty = np.zeros(t, dtype=np.bool_)  # tasks that robots may differ on
    columns = np.empty(t, dtype=np.int64)
    taken = np.empty(t, dtype=np.bool_)
    stale = np.ones(n, dtype=np.bool_)  # robots whose beliefs changed since they built
    for turn in range(max_rounds):
        for i in range(n):
            if not stale[i]:
                continue
            stale[i] = False
            taken[:] = False
            kind = kinds[i]
            ceiling = np.inf
            level = 0
            while level < capacity:
                if computed[i] < level:
                    insertion_gains(
                        paths[i],
                        level,
                        values[i],
                        first[i],
                        legs[kind],
                        legs_to[kind],
                        durations,
                        first_e[i],
                        legs_e[kind],
                        legs_to_e[kind],
                        durations_e,
                        fuel,
                        limits[i],
                        home[i],
                        gains[i, level],
                        places[i, level],
                    )
                    computed[i] = level
                best = _best(i, gains[i, level], ceiling, y[i], z[i], taken)
                if best < 0:
                    break
                ceiling = min(gains[i, level, best], ceiling)
                if level == lengths[i] or bundles[i, level] != best:
                    _shorten(i, level, y[i], z[i], bundles[i], paths[i], lengths[i], dirty)
                    computed[i] = level
                    at = places[i, level, best]
                    for m in range(level, at, -1):
                        paths[i, m] = paths[i, m - 1]
                    paths[i, at] = best
                    bundles[i, level] = best
                    lengths[i] = level + 1
                if z[i, best] != i or y[i, best] != ceiling:
                    y[i, best] = ceiling
                    z[i, best] = i
                    dirty[best] = True
                _take(groups, best, taken)
                level += 1
            if level < lengths[i]:
                _shorten(i, level, y[i], z[i], bundles[i], paths[i], lengths[i], dirty)
                computed[i] = min(computed[i], level)
                lengths[i] = level
        count = 0
        for j in range(t):
            if dirty[j]:
                columns[count] = j
                count += 1
        if count == 0:
            return turn, True
        _exchange(turn, columns[:count], offsets, edges, y, z, s, stale)
        for m in range(count):
            j = columns[m]
            dirty[j] = False
            for i in range(1, n):
                if z[i, j] != z[0, j] or y[i, j] != y[0, j]:
                    dirty[j] = True
                    break
    return max_rounds, False


@exact_kernel
def _shorten(
    i: int,
    level: int,
    y: FloatArray,
    z: IntArray,
    bundle: IntArray,
    path: IntArray,
    length: int,
    dirty: BoolArray,
) -> None:
    """Release all but the first `level` tasks of the bundle; the path keeps their order."""
    if level >= length:
        return
    for m in range(level, length):
        j = bundle[m]
        if z[j] == i:
            z[j] = NOBODY
            y[j] = 0.0
            dirty[j] = True
    at = 0
    for m in range(length):
        for q in range(level):
            if bundle[q] == path[m]:
                path[at] = path[m]
                at += 1
                break


@exact_kernel
def _take(groups: IntArray, task: int, taken: BoolArray) -> None:
    """Mark all slots of a task."""
    for j in range(groups.size):
        if groups[j] == groups[task]:
            taken[j] = True


@exact_kernel
def _best(i: int, gains: FloatArray, ceiling: float, y: FloatArray, z: IntArray, taken: BoolArray) -> int:
    """The open task of the highest gain whose bid wins, the first of equals; -1 if there is none."""
    best, best_gain = -1, 0.0
    for j in range(gains.size):
        gain = gains[j]
        if not best_gain < gain < np.inf or taken[j]:
            continue
        if z[j] == i or beats(min(gain, ceiling), i, y[j], z[j]):
            best, best_gain = j, gain
    return best


@exact_kernel
def _exchange(
    turn: int,
    columns: IntArray,
    offsets: IntArray,
    edges: IntArray,
    y: FloatArray,
    z: IntArray,
    s: FloatArray,
    stale: BoolArray,
) -> None:
    """Every robot hears its neighbours' words of this turn about the tasks `columns`, one after another."""
    n, count = y.shape[0], columns.size
    y_said, z_said, s_said = np.empty((n, count)), np.empty((n, count), dtype=np.int64), s.copy()
    for k in range(n):
        s_said[k, k] = turn
        for m in range(count):
            y_said[k, m] = y[k, columns[m]]
            z_said[k, m] = z[k, columns[m]]
    y_own, z_own = np.empty(count), np.empty(count, dtype=np.int64)
    for i in range(n):
        s_own = s[i]
        for m in range(count):
            y_own[m] = y_said[i, m]
            z_own[m] = z_said[i, m]
        for edge in range(offsets[i], offsets[i + 1]):
            k = edges[edge]
            z_their, y_their, s_their = z_said[k], y_said[k], s_said[k]
            for m in range(count):
                z_i, z_k = z_own[m], z_their[m]
                y_i, y_k = y_own[m], y_their[m]
                at_i, at_k = max(z_i, 0), max(z_k, 0)
                s_ii, s_ki = s_own[at_i], s_their[at_i]
                void = (z_i < 0) | (z_i == i) | ((z_i != k) & (s_ki <= s_ii))
                if ((z_i == z_k) & (y_i == y_k)) | ((z_k < 0) & void):
                    continue  # most words say nothing new; one test that is nearly always true costs little
                s_ik, s_kk = s_own[at_k], s_their[at_k]
                action = verdict(i, k, z_i, y_i, z_k, y_k, s_ii, s_ki, s_ik, s_kk)
                if action == LEAVE:
                    continue
                stale[i] = True
                if action == UPDATE and z_k != NOBODY:
                    y_own[m] = y_k
                    z_own[m] = z_k
                else:
                    y_own[m] = 0.0
                    z_own[m] = NOBODY
            for m in range(n):
                if m != i and s_their[m] > s_own[m]:
                    s_own[m] = s_their[m]
        for m in range(count):
            y[i, columns[m]] = y_own[m]
            z[i, columns[m]] = z_own[m]


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
