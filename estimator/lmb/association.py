"""Which track made which measurement: marginal association probabilities over all joint associations.

A joint association gives each track at most one measurement and each measurement at most one track. With the
weight w_i0 of track i going unseen, w_ij of it making measurement j, and lambda_j of measurement j coming
from elsewhere (clutter, or a target never seen before), its probability is in proportion to the product of
psi_ij = w_ij / (w_i0 lambda_j) over its pairs. Tracks and measurements that no chain of pairs connects are
independent, and each such group is solved on its own:

- small groups exactly, by summing over subsets of the smaller side;
- others by loopy belief propagation (Williams & Lau, "Approximate evaluation of marginal association
  probabilities with belief propagation", IEEE Transactions on Aerospace and Electronic Systems, 2014, eqs.
  30-33), which is exact too where the group is a tree;
- or by Gibbs sampling (Vo, Vo & Hoang, "An efficient implementation of the generalized labeled
  multi-Bernoulli filter", IEEE Transactions on Signal Processing, 2017, algorithm 1): the distinct joint
  associations that the sampler visits, each with its exact weight. Every other sweep is tempered, which
  only changes what is visited.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel

Method = Literal["lbp", "gibbs"]

_ITERATIONS = 1000
_TOLERANCE = 1e-7  # relative change of the messages at which belief propagation has converged
_TEMPER = 0.3
# Beyond this a track and a measurement belong together for all that float64 can tell. It keeps products over
# a group finite where there is neither clutter nor a way to go unseen, and every psi would be infinite.
CERTAIN = 1e30


@dataclass(frozen=True, slots=True)
class Pairs:
    """Track i may have made the measurements `columns[offsets[i]:offsets[i + 1]]`, and no others."""

    offsets: IntArray  # (n + 1,)
    columns: IntArray  # (p,) measurements, in 0..m-1, each at most once in a row
    psi: FloatArray  # (p,) w_ij / (w_i0 lambda_j), >= 0
    measurements: int  # m


@dataclass(frozen=True, slots=True)
class Marginals:
    """Probabilities over all joint associations."""

    pairs: FloatArray  # (p,) track i made measurement j
    unseen: FloatArray  # (n,) track i made none, or does not exist
    others: FloatArray  # (m,) measurement j was made by none of the tracks
    converged: bool  # whether belief propagation met its tolerance; True where it was not needed


def associated(
    pairs: Pairs,
    method: Method = "lbp",
    *,
    exact_up_to: int = 5,
    sweeps: int = 100,
    rng: np.random.Generator | None = None,
) -> Marginals:
    """The marginals of `pairs`.

    Groups whose smaller side has at most `exact_up_to` members are solved exactly, the others by `method`.
    `sweeps` and `rng` are for Gibbs sampling, which is the only user of random numbers.

    Raises:
        ValueError: if psi is negative or not a number, or Gibbs sampling has no generator.
    """
    psi = np.minimum(pairs.psi, CERTAIN)
    if psi.size and not psi.min() >= 0.0:
        raise ValueError("psi: expected numbers from 0 up")
    n, m = pairs.offsets.size - 1, pairs.measurements
    out = Marginals(np.zeros(psi.size), np.ones(n), np.ones(m), True)
    if psi.size == 0:
        return out
    by_column, entries = _transposed(pairs.offsets, pairs.columns, m)
    left = np.zeros(n, np.bool_)
    _solve_small(
        pairs.offsets, pairs.columns, psi, by_column, entries, exact_up_to, out.pairs, out.unseen, left
    )
    converged = True
    if left.any():
        if method == "lbp":
            converged = _propagate(
                pairs.offsets, psi, by_column, entries, left, _ITERATIONS, _TOLERANCE, out.pairs, out.unseen
            )
        else:
            if rng is None:
                raise ValueError("rng: Gibbs sampling needs a generator")
            _sample(
                pairs.offsets,
                pairs.columns,
                psi,
                by_column,
                entries,
                left,
                rng.random((max(sweeps, 1), n)),
                out.pairs,
                out.unseen,
            )
    _rest(pairs.columns, out.pairs, out.others)
    return Marginals(out.pairs, out.unseen, out.others, converged)


@kernel
def _transposed(offsets: IntArray, columns: IntArray, m: int) -> tuple[IntArray, IntArray]:
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
def _rest(columns: IntArray, marginals: FloatArray, others: FloatArray) -> None:
    for p in range(columns.size):
        others[columns[p]] -= marginals[p]
    for j in range(others.size):
        others[j] = min(max(others[j], 0.0), 1.0)


@kernel
def _owners(offsets: IntArray) -> IntArray:
    """The track of each pair (p,)."""
    owners = np.empty(offsets[offsets.size - 1], np.int64)
    for i in range(offsets.size - 1):
        for p in range(offsets[i], offsets[i + 1]):
            owners[p] = i
    return owners


@kernel
def _group(
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


@kernel
def _solve_small(
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
    owners = _owners(offsets)
    seen_tracks, seen_columns = np.zeros(n, np.bool_), np.zeros(m, np.bool_)
    tracks, members = np.empty(n, np.int64), np.empty(m, np.int64)
    bit = np.empty(max(n, m), np.int64)
    straight = np.arange(psi.size)
    for i in range(n):
        if seen_tracks[i] or offsets[i] == offsets[i + 1]:
            continue
        count, taken = _group(
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


@kernel
def _propagate(
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


@kernel
def _scrambled(p: int) -> int:
    """A well mixed 63-bit number for a pair; a joint association's key is the exclusive or of its pairs'."""
    x = (p + 1) * 2654435769
    x = (x ^ (x >> 15)) * 2246822519 & 0x7FFFFFFFFFFFFFFF
    x = (x ^ (x >> 28)) * 3266489917 & 0x7FFFFFFFFFFFFFFF
    return x ^ (x >> 31)


@kernel
def _sample(
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
    owners = _owners(offsets)
    seen_tracks, seen_columns = ~left, np.zeros(m, np.bool_)
    tracks, members = np.empty(n, np.int64), np.empty(m, np.int64)
    for i in range(n):
        if seen_tracks[i]:
            continue
        count, _ = _group(
            i, offsets, columns, by_column, entries, owners, seen_tracks, seen_columns, tracks, members
        )
        _sample_group(tracks[:count], offsets, columns, psi, m, uniforms, marginals, unseen)


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
