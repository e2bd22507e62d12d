"""The information of many actions at once: what they share is worked out once.

Of each action's T events only two things are needed: for every subset V of them, prod_{i in V} (-d_i) at
each point that they see, and what the events' conditional entropies add up to. Both are computed once per
action and used in every joint action that it is part of. Of the events that are decided, the table of B(U)
(`entropy`) over their subsets is kept. Of both together, B(U + V) is a sum over those points only that both
see; without such points they are independent, and their entropies add up.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray, ShortArray
from estimator.kernels import kernel
from planner.information.conditional import conditional_kernel
from planner.information.entropy import entropy_of_table, subset_sums


@dataclass(frozen=True, slots=True)
class Options:
    """a actions of one robot, of T events each, over n points."""

    offsets: IntArray  # (a + 1,) action i sees the points offsets[i]:offsets[i + 1] of the next two
    points: ShortArray  # (total,) numbers of points that an action sees
    factors: FloatArray  # (total, 2^T) prod of -p_D over each subset of its events
    sums: FloatArray  # (a, 2^T) `factors` times the weights, summed over the points; 0 for the empty set
    clutter: FloatArray  # (T,) mu of each event
    alone: FloatArray  # (a,) H[y] of its events
    given: FloatArray  # (a,) H[y | X] of its events
    error: FloatArray  # (a,) by which `given` may be off

    @property
    def size(self) -> int:
        return len(self.given)

    def detection(self, index: int, points: int) -> FloatArray:
        """p_D (T, n) of one action's events at all of n points."""
        rows = slice(self.offsets[index], self.offsets[index + 1])
        out = np.zeros((self.clutter.size, points))
        out[:, self.points[rows]] = -self.factors[rows][:, 1 << np.arange(self.clutter.size)].T
        return out

    def only(self, rows: IntArray) -> "Options":
        """Some of the actions, in this order."""
        counts = np.diff(self.offsets)[rows]
        ends = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(counts)])
        kept = np.arange(ends[-1]) + np.repeat(self.offsets[rows] - ends[:-1], counts)
        return Options(
            ends,
            self.points[kept],
            self.factors[kept],
            self.sums[rows],
            self.clutter,
            self.alone[rows],
            self.given[rows],
            self.error[rows],
        )


@dataclass(frozen=True, slots=True)
class Fixed:
    """k events that are decided, over n points."""

    detection: FloatArray  # (n, k) p_D
    weights: FloatArray  # (n,)
    clutter: FloatArray  # (k,)
    sums: FloatArray  # (2^k,) B of each subset, 0 for the empty one
    alone: float  # H[y] of them all
    given: float  # H[y | X] of them all
    error: float = 0.0  # by which `given` may be off

    @staticmethod
    def of(detection: FloatArray, weights: FloatArray, clutter: FloatArray, terms: int) -> "Fixed":
        """Events with p_D (k, n) and mu (k,)."""
        turned = np.ascontiguousarray(detection.T)
        sums, alone, given, error = _fixed(turned, weights, clutter, terms)
        return Fixed(turned, weights, clutter, sums, alone, given, error)

    def with_action(self, options: Options, index: int) -> "Fixed":
        """One robot's action is decided too; its events' bits follow."""
        clutter = np.append(self.clutter, options.clutter)
        first, last = options.offsets[index], options.offsets[index + 1]
        points, factors = options.points[first:last], options.factors[first:last]
        detection, sums, alone = _together(
            self.detection, self.weights, self.sums, clutter, points, factors, options.sums[index]
        )
        return Fixed(
            detection,
            self.weights,
            clutter,
            sums,
            alone,
            self.given + float(options.given[index]),
            self.error + float(options.error[index]),
        )

    @property
    def information(self) -> float:
        """I[X; Y] of what is decided."""
        return self.alone - self.given


def options(detection: FloatArray, weights: FloatArray, clutter: FloatArray, terms: int) -> Options:
    """Actions with p_D (a, T, n) and mu (T,) of each event."""
    offsets, points, factors, sums, alone, given, error = _options(detection, weights, clutter, terms)
    return Options(offsets, points, factors, sums, clutter, alone, given, error)


def joined(parts: list[Options]) -> Options:
    """All actions of several sets of the same robot, in their order."""
    if len(parts) == 1:
        return parts[0]
    counts = np.concatenate([np.diff(part.offsets) for part in parts])
    return Options(
        np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(counts)]),
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.factors for part in parts]),
        np.concatenate([part.sums for part in parts]),
        parts[0].clutter,
        np.concatenate([part.alone for part in parts]),
        np.concatenate([part.given for part in parts]),
        np.concatenate([part.error for part in parts]),
    )


def information(fixed: Fixed, some: Options, first: int = 0, last: int | None = None) -> FloatArray:
    """(a,) I[X; Y] of what is fixed together with each action, or with those numbered `first` to `last`."""
    rows = slice(first, some.size if last is None else last)
    alone = some.alone[rows].copy()
    _entropies(
        fixed.detection,
        fixed.weights,
        fixed.sums,
        fixed.alone,
        np.append(fixed.clutter, some.clutter),
        some.offsets[rows.start : rows.stop + 1],
        some.points,
        some.factors,
        some.sums[rows],
        alone,
    )
    return np.asarray(alone - fixed.given - some.given[rows])


@kernel
def _options(
    detection: FloatArray, weights: FloatArray, clutter: FloatArray, terms: int
) -> tuple[IntArray, ShortArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    a, t, n = detection.shape
    offsets = np.zeros(a + 1, np.int64)
    for i in range(a):
        offsets[i + 1] = offsets[i]
        for x in range(n):
            most = 0.0
            for e in range(t):
                most = max(most, detection[i, e, x])
            if most > 0.0 and weights[x] > 0.0:
                offsets[i + 1] += 1
    points, factors = np.empty(offsets[a], np.int32), np.empty((offsets[a], 1 << t))
    sums, given, error, alone = np.zeros((a, 1 << t)), np.empty(a), np.empty(a), np.empty(a)
    table, at = np.empty(1 << t), 0
    for i in range(a):
        for x in range(n):
            most = 0.0
            for e in range(t):
                most = max(most, detection[i, e, x])
            if not (most > 0.0 and weights[x] > 0.0):
                continue
            points[at], factors[at, 0] = x, 1.0
            for e in range(t):
                for u in range(1 << e):
                    factors[at, (1 << e) + u] = -factors[at, u] * detection[i, e, x]
            for u in range(1, 1 << t):
                sums[i, u] += weights[x] * factors[at, u]
            at += 1
        stated, low, high = conditional_kernel(detection[i], weights, clutter, terms)
        given[i] = (stated - 0.5 * (low + high)).sum()
        error[i] = 0.5 * (high - low).sum()
        table[:] = sums[i]
        alone[i] = entropy_of_table(table, clutter)
    return offsets, points, factors, sums, alone, given, error


@kernel
def _fixed(
    detection: FloatArray, weights: FloatArray, clutter: FloatArray, terms: int
) -> tuple[FloatArray, float, float, float]:
    """B(U) (2^k,), H[y], H[y | X] and its error of events with p_D (n, k)."""
    sums = subset_sums(detection, weights)
    stated, low, high = conditional_kernel(detection.T.copy(), weights, clutter, terms)
    given = (stated - 0.5 * (low + high)).sum()
    return sums, entropy_of_table(sums.copy(), clutter), given, 0.5 * (high - low).sum()


@kernel
def _join(
    detection: FloatArray,
    weights: FloatArray,
    sums: FloatArray,
    points: ShortArray,
    factors: FloatArray,
    own: FloatArray,
    values: FloatArray,
    subsets: IntArray,
    table: FloatArray,
) -> bool:
    """B of decided events' subsets with an action's in `table` (2^(k + T),); whether they share a point.

    If they do not, the table is left as it was.

    Of the decided events: p_D (n, k), weights (n,), B (2^k,). Of the action: points, factors, B (2^T,).
    values, subsets: (2^k,), to work in.
    """
    base, k = sums.size, detection.shape[1]
    shared = False
    for e in range(points.size):
        x = points[e]
        filled = 1
        values[0], subsets[0] = weights[x], 0
        for i in range(k):
            d = detection[x, i]
            if d != 0.0:
                for u in range(filled):
                    values[filled + u] = -values[u] * d
                    subsets[filled + u] = subsets[u] | (1 << i)
                filled *= 2
        if filled == 1:
            continue
        if not shared:
            shared = True
            table[:base] = sums
            for v in range(1, own.size):
                table[v * base] = own[v]
                table[v * base + 1 : (v + 1) * base] = 0.0
        for v in range(1, own.size):
            factor, place = factors[e, v], v * base
            if factor == 0.0:
                continue
            if filled == base:
                for u in range(1, base):
                    table[place + u] += factor * values[u]
            else:
                for u in range(1, filled):
                    table[place + subsets[u]] += factor * values[u]
    return shared


@kernel
def _together(
    detection: FloatArray,
    weights: FloatArray,
    sums: FloatArray,
    clutter: FloatArray,
    points: ShortArray,
    factors: FloatArray,
    own: FloatArray,
) -> tuple[FloatArray, FloatArray, float]:
    """p_D (n, k + T), B (2^(k + T),) and H[y] of decided events and an action."""
    base, k, t = sums.size, detection.shape[1], clutter.size - detection.shape[1]
    both = np.zeros((detection.shape[0], k + t))
    both[:, :k] = detection
    for e in range(points.size):
        for i in range(t):
            both[points[e], k + i] = -factors[e, 1 << i]
    table = np.zeros(base * own.size)
    values, subsets = np.empty(base), np.empty(base, np.int64)
    if not _join(detection, weights, sums, points, factors, own, values, subsets, table):
        table[:base] = sums
        table[base::base] = own[1:]
    return both, table, entropy_of_table(table.copy(), clutter)


@kernel
def _entropies(
    detection: FloatArray,
    weights: FloatArray,
    sums: FloatArray,
    entropy: float,
    clutter: FloatArray,
    offsets: IntArray,
    points: ShortArray,
    factors: FloatArray,
    own: FloatArray,
    alone: FloatArray,
) -> None:
    """`alone` (a,), H[y] of each action's events, becomes that of theirs with the decided ones."""
    table = np.empty(sums.size * own.shape[1])
    values, subsets = np.empty(sums.size), np.empty(sums.size, np.int64)
    for i in range(alone.size):
        rows = slice(offsets[i], offsets[i + 1])
        if _join(detection, weights, sums, points[rows], factors[rows], own[i], values, subsets, table):
            alone[i] = entropy_of_table(table, clutter)
        else:
            alone[i] += entropy
