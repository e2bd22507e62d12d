"""Gibbs sampling of joint associations: the distinct ones that are visited, each with its exact weight.

Vo, Vo & Hoang, "An efficient implementation of the generalized labeled multi-Bernoulli filter", IEEE
Transactions on Signal Processing, 2017, algorithm 1. Every other sweep is tempered, which only changes what
is visited. Associations never visited count as impossible: many of similar weight need more sweeps.
"""

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel
from estimator.lmb.groups import group_of, owners_of

_TEMPER = 0.3


@kernel
def sample(
    offsets: IntArray,
    columns: IntArray,
    psi: FloatArray,
    by_column: IntArray,
    entries: IntArray,
    left: BoolArray,
    uniforms: FloatArray,
    marginals: FloatArray,
    unseen: FloatArray,
) -> None:
    """Gibbs sampling of each group of the tracks `left`; uniforms (sweeps, n)."""
    n, m = offsets.size - 1, by_column.size - 1
    owners = owners_of(offsets)
    seen_tracks, seen_columns = ~left, np.zeros(m, np.bool_)
    tracks, members = np.empty(n, np.int64), np.empty(m, np.int64)
    for i in range(n):
        if seen_tracks[i]:
            continue
        count, _ = group_of(
            i, offsets, columns, by_column, entries, owners, seen_tracks, seen_columns, tracks, members
        )
        _sample_group(tracks[:count], offsets, columns, psi, m, uniforms, marginals, unseen)


@kernel
def _scrambled(p: int) -> int:
    """A well mixed 63-bit number for a pair; a joint association's key is the exclusive or of its pairs'."""
    x = (p + 1) * 2654435769
    x = (x ^ (x >> 15)) * 2246822519 & 0x7FFFFFFFFFFFFFFF
    x = (x ^ (x >> 28)) * 3266489917 & 0x7FFFFFFFFFFFFFFF
    return x ^ (x >> 31)


@kernel
def _sample_group(
    tracks: IntArray,
    offsets: IntArray,
    columns: IntArray,
    psi: FloatArray,
    m: int,
    uniforms: FloatArray,
    marginals: FloatArray,
    unseen: FloatArray,
) -> None:
    count, sweeps = tracks.size, uniforms.shape[0]
    chosen = np.full(count, -1)
    free = np.ones(m, np.bool_)
    table_size = 16
    while table_size < 2 * (count * sweeps + 1):
        table_size *= 2
    table = np.zeros(table_size, np.int64)
    occupied = np.zeros(table_size, np.bool_)
    key, weight, largest, total = 0, 0.0, 0.0, 1.0  # logarithm of the weight; all unseen is visited first
    occupied[0] = True
    none = np.zeros(count)  # summed weights of going unseen, relative to exp(largest)
    none[:] = 1.0
    for sweep in range(sweeps):
        power = 1.0 if sweep % 2 == 0 else _TEMPER
        for t in range(count):
            i = tracks[t]
            if chosen[t] >= 0:
                free[columns[chosen[t]]] = True
                key ^= _scrambled(chosen[t])
                weight -= np.log(psi[chosen[t]])
                chosen[t] = -1
            mass = 1.0
            for p in range(offsets[i], offsets[i + 1]):
                if free[columns[p]]:
                    mass += psi[p] ** power
            level = uniforms[sweep, i] * mass - 1.0
            for p in range(offsets[i], offsets[i + 1]):
                if level < 0.0:
                    break
                if free[columns[p]] and psi[p] > 0.0:
                    level -= psi[p] ** power
                    if level < 0.0:
                        chosen[t] = p
                        free[columns[p]] = False
                        key ^= _scrambled(p)
                        weight += np.log(psi[p])
            slot = key & (table_size - 1)
            while occupied[slot] and table[slot] != key:
                slot = (slot + 1) & (table_size - 1)
            if occupied[slot]:
                continue
            occupied[slot], table[slot] = True, key
            if weight > largest:
                scale = np.exp(largest - weight)
                largest = weight
                total *= scale
                for s in range(count):
                    none[s] *= scale
                    for p in range(offsets[tracks[s]], offsets[tracks[s] + 1]):
                        marginals[p] *= scale
            share = np.exp(weight - largest)
            total += share
            for s in range(count):
                if chosen[s] >= 0:
                    marginals[chosen[s]] += share
                else:
                    none[s] += share
    for s in range(count):
        unseen[tracks[s]] = none[s] / total
        for p in range(offsets[tracks[s]], offsets[tracks[s] + 1]):
            marginals[p] /= total
