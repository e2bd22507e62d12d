"""Which new thing is which old one: the matching of least cost, within a limit."""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import exact_kernel


def matched(cost: FloatArray, most: float) -> list[int]:
    """For each of n new things the old one (of m) that it is, or -1; none is taken twice.

    As many as possible are matched at a cost of at most `most` each, and of these matchings the one of least
    total cost is taken.

    Args:
        cost: (n, m), finite and >= 0.
        most: above it two things are never the same.
    """
    n, m = cost.shape
    if n == 0 or m == 0:
        return [-1] * n
    allowed = cost <= most
    never = 1.0 + 2.0 * min(n, m) * max(float(cost[allowed].max(initial=0.0)), 1e-9)
    square = np.full((max(n, m), max(n, m)), never)
    square[:n, :m] = np.where(allowed, cost, never)
    columns = _assignment(square)
    return [int(j) if j < m and allowed[i, j] else -1 for i, j in enumerate(columns[:n])]


@exact_kernel
def _assignment(cost: FloatArray) -> IntArray:
    """The column (n,) of each row of a square matrix in the assignment of least cost.

    The Hungarian method with shortest augmenting paths, O(n^3) (Jonker, Volgenant, Computing 38, 1987).
    scipy has one, which takes a process 0.15 s to import.
    """
    n = cost.shape[0]
    rows, columns = np.zeros(n + 1), np.zeros(n + 1)  # dual prices; column n stands for "none yet"
    row_of = np.full(n + 1, -1, dtype=np.int64)
    for i in range(n):
        row_of[n] = i
        least = np.full(n, np.inf)
        before = np.full(n, n, dtype=np.int64)
        done = np.zeros(n + 1, dtype=np.bool_)
        j = n
        while row_of[j] >= 0:
            done[j] = True
            row, step, nearest = row_of[j], np.inf, n
            for other in range(n):
                if done[other]:
                    continue
                reduced = cost[row, other] - rows[row] - columns[other]
                if reduced < least[other]:
                    least[other], before[other] = reduced, j
                if least[other] < step:
                    step, nearest = least[other], other
            for other in range(n + 1):
                if done[other]:
                    rows[row_of[other]] += step
                    columns[other] -= step
                elif other < n:
                    least[other] -= step
            j = nearest
        while j != n:
            row_of[j] = row_of[before[j]]
            j = before[j]
    found = np.empty(n, dtype=np.int64)
    for j in range(n):
        found[row_of[j]] = j
    return found
