"""Who stands for whom: the optimal partial assignment of two sets, exact, dense only where it must be.

A pair further apart than the cut-off costs as much as leaving both alone. So only near pairs are edges; the
graph of near pairs falls into connected components, most of them a single pair, and each is solved on its own
by shortest augmenting paths: Jonker & Volgenant, "A shortest augmenting path algorithm for dense and sparse
linear assignment problems", Computing, 1987 (without its column reduction,
which is for square costs).
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel

_REDUCTIONS = 4  # rounds of augmenting row reduction, which leave few rows to the augmenting paths


def assigned(gains: FloatArray) -> tuple[IntArray, IntArray]:
    """Rows and columns (k,) of the pairs whose gains (n, m) are positive and add up to the most.

    A row or column may stay alone; a gain of 0 or less is never taken. Rows ascend.
    """
    partners = _partners(np.ascontiguousarray(gains, dtype=np.float64))
    rows = np.flatnonzero(partners >= 0)
    return rows, partners[rows]


def cut_off_gains(distances: FloatArray, c: float, p: float) -> FloatArray:
    """c^p - d^p of distances (n, m) below c, else 0: what assigning a pair saves in OSPA and GOSPA."""
    return np.where(distances < c, c**p - np.minimum(distances, c) ** p, 0.0)


@kernel
def nearest_pairs(
    truth: FloatArray, estimates: FloatArray, c: float, p: float
) -> tuple[bool, IntArray, FloatArray]:
    """Whether all is finite; the estimate (n,) assigned to each true point, or -1; their distances (n,).

    For truth (d, n) and estimates (d, m), with the gains of `cut_off_gains`.
    """
    n, m = truth.shape[1], estimates.shape[1]
    finite = True
    for a in range(truth.shape[0]):
        for i in range(n):
            finite = finite and np.isfinite(truth[a, i])
        for j in range(m):
            finite = finite and np.isfinite(estimates[a, j])
    gains = np.zeros((n, m))
    if finite:
        for i in range(n):
            row = gains[i]
            for a in range(truth.shape[0]):
                x = truth[a, i]
                for j in range(m):
                    row[j] += (estimates[a, j] - x) ** 2
            if p == 2.0:
                for j in range(m):
                    row[j] = max(c * c - row[j], 0.0)
            else:
                for j in range(m):
                    row[j] = c**p - row[j] ** (0.5 * p) if row[j] < c * c else 0.0
    partners = _partners(gains)
    distances = np.zeros(n)
    for i in range(n):
        if partners[i] >= 0:
            square = 0.0
            for a in range(truth.shape[0]):
                square += (truth[a, i] - estimates[a, partners[i]]) ** 2
            distances[i] = np.sqrt(square)
    return finite, partners, distances


@kernel
def _partners(gains: FloatArray) -> IntArray:
    """The column (n,) assigned to each row of gains (n, m), -1 for none."""
    n, m = gains.shape
    partners = np.full(n, -1)
    rows, columns = np.empty(n, np.int64), np.empty(m, np.int64)
    rows_left, columns_left = np.arange(n), np.arange(m)
    n_left, m_left = n, m
    while n_left > 0 and m_left > 0:
        # one component, breadth first through the near pairs of what no component has yet
        n_left -= 1
        rows[0] = rows_left[n_left]
        r, s, rows_at, columns_at = 1, 0, 0, 0
        while rows_at < r or columns_at < s:
            if rows_at < r:
                row = gains[rows[rows_at]]
                rows_at += 1
                kept = 0
                for k in range(m_left):
                    j = columns_left[k]
                    if row[j] > 0.0:
                        columns[s] = j
                        s += 1
                    else:
                        columns_left[kept] = j
                        kept += 1
                m_left = kept
            else:
                column = columns[columns_at]
                columns_at += 1
                kept = 0
                for k in range(n_left):
                    i = rows_left[k]
                    if gains[i, column] > 0.0:
                        rows[r] = i
                        r += 1
                    else:
                        rows_left[kept] = i
                        kept += 1
                n_left = kept
        if s == 1 and r == 1:
            partners[rows[0]] = columns[0]
        elif s > 0:
            _solve(gains, rows[:r], columns[:s], partners)
    for i in range(n):
        if partners[i] >= 0 and not gains[i, partners[i]] > 0.0:
            partners[i] = -1
    return partners


@kernel
def _solve(gains: FloatArray, rows: IntArray, columns: IntArray, partners: IntArray) -> None:
    """The assignment within one component: the fewer side's members each get one of the other's."""
    r, s = rows.size, columns.size
    flipped = r > s
    cost = np.empty((min(r, s), max(r, s)))
    for a in range(r):
        for b in range(s):
            if flipped:
                cost[b, a] = -max(gains[rows[a], columns[b]], 0.0)
            else:
                cost[a, b] = -max(gains[rows[a], columns[b]], 0.0)
    owner = _shortest_augmenting_paths(cost)
    for b in range(owner.size):
        if owner[b] >= 0:
            if flipped:
                partners[rows[b]] = columns[owner[b]]
            else:
                partners[rows[owner[b]]] = columns[b]


@kernel
def _shortest_augmenting_paths(cost: FloatArray) -> IntArray:
    """The row (s,) assigned to each column of cost (r, s), r <= s, -1 for none; every row gets a column.

    v is the columns' dual: 0 while a column is free, never more. That of a row follows from its column's.
    """
    r, s = cost.shape
    v = np.zeros(s)
    owner, column_of = np.full(s, -1), np.full(r, -1)
    free, waiting = np.arange(r), r
    for _ in range(_REDUCTIONS):
        turned = 0
        for k in range(waiting):
            i = free[k]
            best, least, second = _two_least(cost[i], v)
            column_of[i] = best
            if owner[best] >= 0:
                column_of[owner[best]] = -1
                free[turned] = owner[best]
                turned += 1
            owner[best] = i
            if s > 1:
                v[best] -= second - least
        waiting = turned
    length, before = np.empty(s), np.empty(s, np.int64)
    left_columns, closed = np.empty(s, np.int64), np.empty(s, np.int64)
    for k in range(waiting):
        start = free[k]
        for j in range(s):
            length[j], before[j], left_columns[j] = cost[start, j] - v[j], start, j
        left, ready, end = s, 0, -1
        while True:
            at = 0
            for q in range(1, left):
                if length[left_columns[q]] < length[left_columns[at]]:
                    at = q
            j = left_columns[at]
            reached = length[j]
            if owner[j] < 0:
                end = j
                break
            left -= 1
            left_columns[at] = left_columns[left]
            closed[ready] = j
            ready += 1
            i = owner[j]
            base = reached - (cost[i, j] - v[j])
            for q in range(left):
                j = left_columns[q]
                through = base + cost[i, j] - v[j]
                if through < length[j]:
                    length[j], before[j] = through, i
        for q in range(ready):
            v[closed[q]] += length[closed[q]] - reached
        j = end
        while True:
            i = before[j]
            owner[j] = i
            following = column_of[i]
            column_of[i] = j
            if i == start:
                break
            j = following
    return owner


@kernel
def _two_least(row: FloatArray, v: FloatArray) -> tuple[int, float, float]:
    """Where row - v is least, and its two least values; the second infinite where there is none."""
    best, least, second = 0, np.inf, np.inf
    for j in range(row.size):
        reduced = row[j] - v[j]
        if reduced < second:
            if reduced < least:
                best, least, second = j, reduced, least
            else:
                second = reduced
    return best, least, second
