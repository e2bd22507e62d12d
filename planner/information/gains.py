"""The information of many actions at once: what they share is worked out once.

Of each action's T events only two things are needed: for every subset U of them, prod_{i in U} (-d_i) at
each point (`entropy.products`), and what the events' conditional entropies add up to. Both are computed once
per action and used in every joint action that it is part of. A joint action's table of B(U), U a subset of
all robots' events, is then made of dot products over the points that both what is fixed and the action see.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel
from planner.information.conditional import conditional_kernel
from planner.information.entropy import moebius, products, subtract_clutter, surprise, zeta


@dataclass(frozen=True, slots=True)
class Options:
    """a actions of one robot, of T events each, over n points."""

    terms: FloatArray  # (a, n, 2^T) prod of -p_D over each subset of events
    seen: BoolArray  # (a, n) whether any event of the action sees the point
    sums: FloatArray  # (a, 2^T) `terms` times the weights, summed over the points
    clutter: FloatArray  # (T,) mu of each event
    given: FloatArray  # (a,) H[y | X] of all its events
    error: FloatArray  # (a,) by which `given` may be off

    @property
    def size(self) -> int:
        return len(self.terms)

    def detection(self, index: int) -> FloatArray:
        """p_D (T, n) of one action's events."""
        single = 1 << np.arange(self.clutter.size)
        return np.ascontiguousarray(-self.terms[index][:, single].T)


@dataclass(frozen=True, slots=True)
class Fixed:
    """k events that are decided, over n points."""

    terms: FloatArray  # (n, 2^k) weights times prod of -p_D over each subset
    clutter: FloatArray  # (k,)
    given: float  # H[y | X] of them all
    error: float = 0.0  # by which `given` may be off

    @staticmethod
    def none(weights: FloatArray) -> "Fixed":
        """Nothing is decided."""
        return Fixed(weights[:, None].copy(), np.zeros(0), 0.0)

    @staticmethod
    def of(detection: FloatArray, weights: FloatArray, clutter: FloatArray, terms: int) -> "Fixed":
        """Events with p_D (k, n) and mu (k,)."""
        stated, low, high = conditional_kernel(detection, weights, clutter, terms)
        given = float((stated - 0.5 * (low + high)).sum())
        return Fixed(products(detection, weights), clutter, given, float(0.5 * (high - low).sum()))

    def with_action(self, options: Options, index: int) -> "Fixed":
        """One robot's action is decided too; its events' bits follow."""
        joined = options.terms[index][:, :, None] * self.terms[:, None, :]
        return Fixed(
            np.ascontiguousarray(joined.reshape(len(joined), -1)),
            np.append(self.clutter, options.clutter),
            self.given + float(options.given[index]),
            self.error + float(options.error[index]),
        )

    def entropy(self) -> float:
        """H[Y] of what is decided."""
        return float(_fixed_entropy(self.terms, self.clutter))

    @property
    def information(self) -> float:
        """I[X; Y] of what is decided."""
        return self.entropy() - self.given


def options(detection: FloatArray, weights: FloatArray, clutter: FloatArray, terms: int) -> Options:
    """Actions with p_D (a, T, n) and mu (T,) of each event."""
    made, sums, given, error = _options(detection, weights, clutter, terms)
    return Options(made, np.asarray((detection > 0.0).any(axis=1)), sums, clutter, given, error)


def joined(parts: list[Options]) -> Options:
    """All actions of several sets of the same robot, in their order."""
    return Options(
        np.concatenate([p.terms for p in parts]),
        np.concatenate([p.seen for p in parts]),
        np.concatenate([p.sums for p in parts]),
        parts[0].clutter,
        np.concatenate([p.given for p in parts]),
        np.concatenate([p.error for p in parts]),
    )


def information(fixed: Fixed, some: Options, rows: IntArray | None = None) -> FloatArray:
    """(a,) I[X; Y] of what is fixed together with each action, or with those of some rows only."""
    rows = np.arange(some.size) if rows is None else rows
    bits = np.append(fixed.clutter, some.clutter)
    h = _entropies(fixed.terms, bits, some.terms, some.seen, some.sums, rows)
    return np.asarray(h - fixed.given - some.given[rows])


def nearest_first(detection: FloatArray, points: FloatArray, weights: FloatArray, at: FloatArray) -> IntArray:
    """Numbers of events (k,), that first whose expected detections have their middle nearest to `at` (d,)."""
    middles = (detection * weights) @ points.T / np.maximum((detection @ weights)[:, None], 1e-300)
    return np.argsort(np.linalg.norm(middles - at, axis=1), kind="stable")


@kernel
def _options(
    detection: FloatArray, weights: FloatArray, clutter: FloatArray, terms: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    a, t, n = detection.shape
    made, sums = np.empty((a, n, 1 << t)), np.zeros((a, 1 << t))
    given, error = np.empty(a), np.empty(a)
    ones = np.ones(n)
    for i in range(a):
        made[i] = products(detection[i], ones)
        for x in range(n):
            for u in range(1 << t):
                sums[i, u] += made[i, x, u] * weights[x]
        stated, low, high = conditional_kernel(detection[i], weights, clutter, terms)
        given[i] = (stated - 0.5 * (low + high)).sum()
        error[i] = 0.5 * (high - low).sum()
    return made, sums, given, error


@kernel
def _alone(fixed: FloatArray) -> FloatArray:
    """B(U) (2^k,) of `fixed` (n, 2^k); 0 for the empty set, which says nothing."""
    table = np.zeros(fixed.shape[1])
    for x in range(fixed.shape[0]):
        for u in range(table.size):
            table[u] += fixed[x, u]
    table[0] = 0.0
    return table


@kernel
def _fixed_entropy(fixed: FloatArray, clutter: FloatArray) -> float:
    return _entropy_of(_alone(fixed), clutter)


@kernel
def _entropy_of(table: FloatArray, clutter: FloatArray) -> float:
    """H[Y] from B(U) in `table` (2^m,), which is used up."""
    zeta(table)
    subtract_clutter(table, clutter)
    for s in range(table.size):
        table[s] = np.exp(table[s])
    moebius(table)
    return surprise(table)


@kernel
def _entropies(
    fixed: FloatArray,
    clutter: FloatArray,
    terms: FloatArray,
    seen: BoolArray,
    sums: FloatArray,
    rows: IntArray,
) -> FloatArray:
    """H[Y] (r,) of the events in `fixed` (n, 2^k) with each of the actions `rows` of `terms` (a, n, 2^T)."""
    n, base = fixed.shape
    own = terms.shape[2]
    alone = _alone(fixed)
    touched = np.zeros(n, dtype=np.bool_)
    for x in range(n):
        bit = 1
        while bit < base:  # single events tell which points are seen at all
            touched[x] |= fixed[x, bit] != 0.0
            bit *= 2
    table = np.empty(base * own)
    out = np.empty(rows.size)
    for r in range(rows.size):
        i = rows[r]
        table[:base] = alone
        for v in range(1, own):
            table[v * base] = sums[i, v]
            table[v * base + 1 : (v + 1) * base] = 0.0
        for x in range(n):
            if not (touched[x] and seen[i, x]):
                continue
            for v in range(1, own):
                factor = terms[i, x, v]
                if factor != 0.0:
                    place = v * base
                    for u in range(1, base):
                        table[place + u] += factor * fixed[x, u]
        out[r] = _entropy_of(table, clutter)
    return out
