"""Exact association probabilities of small groups, by summing over subsets of the smaller side."""

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel
from estimator.lmb.groups import group_of, owners_of


@kernel
def solve_small(
    offsets: IntArray,
    columns: IntArray,
    psi: FloatArray,
    by_column: IntArray,
    entries: IntArray,
    limit: int,
    marginals: FloatArray,
    unseen: FloatArray,
    left: BoolArray,
) -> None:
    """Fill in the small groups; mark the tracks of the others in `left`."""
    n, m = offsets.size - 1, by_column.size - 1
    owners = owners_of(offsets)
    seen_tracks, seen_columns = np.zeros(n, np.bool_), np.zeros(m, np.bool_)
    tracks, members = np.empty(n, np.int64), np.empty(m, np.int64)
    bit = np.empty(max(n, m), np.int64)
    straight = np.arange(psi.size)
    for i in range(n):
        if seen_tracks[i] or offsets[i] == offsets[i + 1]:
            continue
        count, taken = group_of(
            i, offsets, columns, by_column, entries, owners, seen_tracks, seen_columns, tracks, members
        )
        if min(count, taken) > max(limit, 1):  # with one track or measurement the sum is plain
            for k in range(count):
                left[tracks[k]] = True
            continue
        if taken <= count:
            for b in range(taken):
                bit[members[b]] = b
            _sum_subsets(tracks[:count], offsets, straight, columns, bit, taken, psi, marginals)
        else:
            for b in range(count):
                bit[tracks[b]] = b
            _sum_subsets(members[:taken], by_column, entries, owners, bit, count, psi, marginals)
        for k in range(count):
            total = 0.0
            for p in range(offsets[tracks[k]], offsets[tracks[k] + 1]):
                total += marginals[p]
            unseen[tracks[k]] = max(1.0 - total, 0.0)


@kernel
def _sum_subsets(
    items: IntArray,
    offsets: IntArray,
    entries: IntArray,
    partners: IntArray,
    bit: IntArray,
    bits: int,
    psi: FloatArray,
    marginals: FloatArray,
) -> None:
    """Exact marginals of one group: items one after another against subsets of the `bits` partners.

    ahead[k, s] sums over what the first k items can do using exactly the partners s, behind[k, s] over what
    items from k on can do without the partners s.
    """
    count, size = items.size, 1 << bits
    ahead, behind = np.zeros((count + 1, size)), np.ones((count + 1, size))
    ahead[0, 0] = 1.0
    for k in range(count):
        for s in range(size):
            value = ahead[k, s]
            if value == 0.0:
                continue
            ahead[k + 1, s] += value
            for e in range(offsets[items[k]], offsets[items[k] + 1]):
                p = entries[e]
                b = 1 << bit[partners[p]]
                if s & b == 0:
                    ahead[k + 1, s | b] += value * psi[p]
    for k in range(count - 1, -1, -1):
        for s in range(size):
            value = behind[k + 1, s]
            for e in range(offsets[items[k]], offsets[items[k] + 1]):
                p = entries[e]
                b = 1 << bit[partners[p]]
                if s & b == 0:
                    value += psi[p] * behind[k + 1, s | b]
            behind[k, s] = value
    inverse = 1.0 / behind[0, 0]
    for k in range(count):
        for e in range(offsets[items[k]], offsets[items[k] + 1]):
            p = entries[e]
            b = 1 << bit[partners[p]]
            total = 0.0
            for s in range(size):
                if s & b == 0:
                    total += ahead[k, s] * behind[k + 1, s | b]
            marginals[p] = total * psi[p] * inverse
