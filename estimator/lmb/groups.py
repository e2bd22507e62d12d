"""Which tracks and measurements chains of pairs connect: what shares nothing is independent."""

import numpy as np

from estimator.arrays import BoolArray, IntArray
from estimator.kernels import kernel


@kernel
def transposed(offsets: IntArray, columns: IntArray, m: int) -> tuple[IntArray, IntArray]:
    """The pairs by measurement: offsets (m + 1,) and indices of pairs (p,)."""
    starts = np.zeros(m + 1, np.int64)
    for p in range(columns.size):
        starts[columns[p] + 1] += 1
    for j in range(m):
        starts[j + 1] += starts[j]
    filled = starts[:m].copy()
    entries = np.empty(columns.size, np.int64)
    for p in range(columns.size):
        entries[filled[columns[p]]] = p
        filled[columns[p]] += 1
    return starts, entries


@kernel
def owners_of(offsets: IntArray) -> IntArray:
    """The track of each pair (p,)."""
    owners = np.empty(offsets[offsets.size - 1], np.int64)
    for i in range(offsets.size - 1):
        for p in range(offsets[i], offsets[i + 1]):
            owners[p] = i
    return owners


@kernel
def group_of(
    start: int,
    offsets: IntArray,
    columns: IntArray,
    by_column: IntArray,
    entries: IntArray,
    owners: IntArray,
    seen_tracks: BoolArray,
    seen_columns: BoolArray,
    tracks: IntArray,
    members: IntArray,
) -> tuple[int, int]:
    """The tracks and measurements that chains of pairs connect to track `start`; how many of each."""
    tracks[0], count, taken, at = start, 1, 0, 0
    seen_tracks[start] = True
    while at < count:
        i = tracks[at]
        at += 1
        for p in range(offsets[i], offsets[i + 1]):
            j = columns[p]
            if seen_columns[j]:
                continue
            seen_columns[j] = True
            members[taken] = j
            taken += 1
            for e in range(by_column[j], by_column[j + 1]):
                other = owners[entries[e]]
                if not seen_tracks[other]:
                    seen_tracks[other] = True
                    tracks[count] = other
                    count += 1
    return count, taken
