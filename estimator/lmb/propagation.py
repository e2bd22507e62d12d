"""Loopy belief propagation between tracks and measurements.

Williams & Lau, "Approximate evaluation of marginal association probabilities with belief propagation", IEEE
Transactions on Aerospace and Electronic Systems, 2014, eqs. 30-33. Exact where a group is a tree.
"""

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel


@kernel
def propagate(
    offsets: IntArray,
    psi: FloatArray,
    by_column: IntArray,
    entries: IntArray,
    left: BoolArray,
    iterations: int,
    tolerance: float,
    marginals: FloatArray,
    unseen: FloatArray,
) -> bool:
    """Loopy belief propagation on the tracks `left`; whether the messages stopped changing.

    What a message leaves out is never subtracted from a total, which would lose small numbers beside large.
    """
    n, m = offsets.size - 1, by_column.size - 1
    to_track, to_column = np.ones(psi.size), np.zeros(psi.size)
    others = np.empty(psi.size)
    change = np.inf
    for _ in range(iterations):
        for i in range(n):
            if left[i]:
                before = 1.0
                for p in range(offsets[i], offsets[i + 1]):
                    others[p] = before
                    before += psi[p] * to_track[p]
                after = 0.0
                for p in range(offsets[i + 1] - 1, offsets[i] - 1, -1):
                    to_column[p] = psi[p] / (others[p] + after)
                    after += psi[p] * to_track[p]
        change = 0.0
        for j in range(m):
            before = 1.0
            for e in range(by_column[j], by_column[j + 1]):
                others[entries[e]] = before
                before += to_column[entries[e]]
            after = 0.0
            for e in range(by_column[j + 1] - 1, by_column[j] - 1, -1):
                p = entries[e]
                value = 1.0 / (others[p] + after)
                after += to_column[p]
                change = max(change, abs(value - to_track[p]) / value)
                to_track[p] = value
        if change < tolerance:
            break
    for i in range(n):
        if left[i]:
            total = 1.0
            for p in range(offsets[i], offsets[i + 1]):
                total += psi[p] * to_track[p]
            for p in range(offsets[i], offsets[i + 1]):
                marginals[p] = psi[p] * to_track[p] / total
            unseen[i] = 1.0 / total
    return bool(change < tolerance)
