"""Which new thing is which old one: the matching of least cost, within a limit."""

import numpy as np

from estimator.arrays import FloatArray


def matched(cost: FloatArray, most: float) -> list[int]:
    """For each of n new things the old one (of m) that it is, or -1; none is taken twice.

    As many as possible are matched at a cost of at most `most` each, and of these matchings the one of least
    total cost is taken.

    Args:
        cost: (n, m), finite.
        most: above it two things are never the same.
    """
    n, m = cost.shape
    if n == 0 or m == 0:
        return [-1] * n
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - 0.15 s, only where tasks are made

    allowed = cost <= most
    never = 1.0 + 2.0 * min(n, m) * max(float(cost[allowed].max(initial=0.0)), 1e-9)
    rows, columns = linear_sum_assignment(np.where(allowed, cost, never))
    made = [-1] * n
    for i, j in zip(rows, columns, strict=True):
        if allowed[i, j]:
            made[int(i)] = int(j)
    return made
