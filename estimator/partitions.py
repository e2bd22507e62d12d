"""Sums over the partitions of several sensors' measurements, as the multisensor PHD corrector needs them.

Measurements fall into groups that no target can have caused together. A subset W of a group has at most one
measurement of each sensor; F(U) = sum over partitions of U into subsets of prod d_W is found for every U by
dynamic programming over bit masks, so nothing is left out. Only a group of more than `most` measurements is
cut at its weakest links. Nothing depends on the order of sensors or measurements but rounding.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel

MOST = 12  # measurements in a group: 3^12 steps


@dataclass(frozen=True, slots=True, eq=False)
class Touching:
    """Which of all M measurements (numbered through all sensors) may come from each of n sources."""

    offsets: IntArray  # (n + 1,) of each source's entries
    measurements: IntArray  # (e,) numbers
    closeness: FloatArray  # (e,) 0..1, 1 is a perfect fit
    order: IntArray  # (e,) where each entry stood in the arrays that `of` was given

    @staticmethod
    def of(owners: IntArray, measurements: IntArray, closeness: FloatArray, count: int) -> "Touching":
        """Of entries (e,) in any order, for `count` sources."""
        order = np.argsort(owners, kind="stable")
        offsets = np.concatenate([[0], np.cumsum(np.bincount(owners, minlength=count))]).astype(np.int64)
        return Touching(offsets, measurements[order], closeness[order], order)

    def owners(self) -> IntArray:
        """(e,) the source of each entry."""
        return np.repeat(np.arange(self.offsets.size - 1), np.diff(self.offsets))


@dataclass(frozen=True, slots=True, eq=False)
class Groups:
    """Measurements that one target may have caused together, each with a bit in its group's subsets."""

    sensors: IntArray  # (M,) sensor of each measurement
    numbers: IntArray  # (M,) group of each
    bits: IntArray  # (M,) place of each in its group
    bases: IntArray  # (g + 1,) where the slots of a group's subsets begin; slot = base + subset's bits

    @property
    def slots(self) -> int:
        return int(self.bases[-1])


@dataclass(frozen=True, slots=True, eq=False)
class Terms:
    """All subsets W that each source may have caused."""

    owners: IntArray  # (t,) source
    slots: IntArray  # (t,) group and subset
    members: IntArray  # (t, q) the source's entry of each sensor, -1 for none


def grouped(touching: Sequence[Touching], sensors: IntArray, most: int = MOST) -> Groups:
    """Groups of the M measurements with sensors (M,), linked where a source touches two of different sensors.

    Strongest links first; none that would make a group of more than `most`.
    """
    count = sensors.size
    firsts, seconds, strengths = [], [], []
    for t in touching:
        a, b, strength = _links(t.offsets, t.measurements, t.closeness, sensors)
        firsts.append(a)
        seconds.append(b)
        strengths.append(strength)
    a, b, strength = np.concatenate(firsts), np.concatenate(seconds), np.concatenate(strengths)
    keys, inverse = np.unique(a * count + b, return_inverse=True)
    best = np.zeros(keys.size)
    np.maximum.at(best, inverse, strength)
    order = np.argsort(-best, kind="stable")
    roots = _joined(keys[order] // max(count, 1), keys[order] % max(count, 1), count, most)
    _, numbers = np.unique(roots, return_inverse=True)
    numbers = np.asarray(numbers, dtype=np.int64)
    sizes = np.bincount(numbers)
    bits = np.empty(count, np.int64)
    by_group = np.argsort(numbers, kind="stable")
    bits[by_group] = np.arange(count) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    bases = np.concatenate([[0], np.cumsum(1 << sizes)]).astype(np.int64)
    return Groups(sensors, numbers, bits, bases)


def terms(touching: Touching, groups: Groups, sensors: int) -> Terms:
    """Every subset W of what touches each source, within one group, with at most one of each sensor."""
    entries = touching.measurements
    keys, numbers = groups.sensors[entries], groups.numbers[entries]
    order = np.asarray(np.lexsort((keys, numbers, touching.owners())), dtype=np.int64)
    runs = np.empty(entries.size, np.int64)
    count = _runs(touching.offsets, order, keys, numbers, runs)
    owners, slots, members = (
        np.empty(count, np.int64),
        np.empty(count, np.int64),
        np.empty((count, sensors), np.int64),
    )
    starts = np.stack([groups.bases[numbers], 1 << groups.bits[entries]], axis=1).ravel()
    _enumerate(touching.offsets, order, runs, keys, starts, owners, slots, members)
    return Terms(owners, slots, members)


def coefficients(totals: FloatArray, groups: Groups) -> FloatArray:
    """a_W (slots,) from d_W (slots,); 0 throughout a group whose measurements cannot have happened."""
    out = np.zeros(groups.slots)
    _coefficients(totals, groups.bases, out)
    return out


def with_clutter(totals: FloatArray, clutter: FloatArray, groups: Groups) -> FloatArray:
    """d_W: the sources' totals (slots,) and the clutter intensities (M,) of the measurements alone."""
    totals = totals.copy()
    totals[groups.bases[groups.numbers] + (1 << groups.bits)] += clutter
    return totals


def summed(values: FloatArray, where: IntArray, count: int) -> FloatArray:
    """Sums (count,) of the values by where they belong."""
    return np.asarray(np.bincount(where, values, minlength=count), dtype=np.float64)


@kernel
def _links(
    offsets: IntArray, measurements: IntArray, closeness: FloatArray, sensors: IntArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs a < b of measurements of different sensors that a source touches, and how well it fits both."""
    pairs = 0
    for i in range(offsets.size - 1):
        size = offsets[i + 1] - offsets[i]
        pairs += size * (size - 1) // 2
    first, second, strength = np.empty(pairs, np.int64), np.empty(pairs, np.int64), np.empty(pairs)
    at = 0
    for i in range(offsets.size - 1):
        for e in range(offsets[i], offsets[i + 1]):
            for f in range(e + 1, offsets[i + 1]):
                a, b = measurements[e], measurements[f]
                if sensors[a] != sensors[b]:
                    first[at], second[at] = min(a, b), max(a, b)
                    strength[at] = closeness[e] * closeness[f]
                    at += 1
    return first[:at], second[:at], strength[:at]


@kernel
def _joined(first: IntArray, second: IntArray, count: int, most: int) -> IntArray:
    """Root (count,) of each measurement's group after joining the pairs in turn, none larger than `most`."""
    root, size = np.arange(count), np.ones(count, np.int64)
    for k in range(first.size):
        a, b = first[k], second[k]
        while root[a] != a:
            a = root[a]
        while root[b] != b:
            b = root[b]
        if a != b and size[a] + size[b] <= most:
            root[max(a, b)] = min(a, b)
            size[min(a, b)] += size[max(a, b)]
    for a in range(count):
        top = a
        while root[top] != top:
            top = root[top]
        root[a] = top
    return root


@kernel
def _runs(offsets: IntArray, order: IntArray, keys: IntArray, groups: IntArray, runs: IntArray) -> int:
    """Fills runs (e,): 0 where an entry goes on with the sensor before, 1 where a sensor begins, 2 a group.

    `order` sorts a source's entries by group, then sensor; `keys` and `groups` are of the entries.
    Returns the number of terms: for each source and group prod of (entries + 1) over sensors, less the empty.
    """
    total, product, size = 0, 1, 0
    for i in range(offsets.size - 1):
        for e in range(offsets[i], offsets[i + 1]):
            here = order[e]
            if e == offsets[i] or groups[here] != groups[order[e - 1]]:
                total += product * (size + 1) - 1
                product, size = 1, 0
                runs[e] = 2
            elif keys[here] != keys[order[e - 1]]:
                product *= size + 1
                size = 0
                runs[e] = 1
            else:
                runs[e] = 0
            size += 1
    return int(total + product * (size + 1) - 1)


@kernel
def _enumerate(
    offsets: IntArray,
    order: IntArray,
    runs: IntArray,
    keys: IntArray,
    starts: IntArray,
    owners: IntArray,
    slots: IntArray,
    members: IntArray,
) -> None:
    """Fills owner, slot and members of each term; `starts` has base and bit of each entry (2 e,), `keys` its
    sensor (e,).
    """
    at, begin, end, q = 0, 0, 0, members.shape[1]
    for i in range(offsets.size - 1):
        for e in range(offsets[i], offsets[i + 1]):
            entry = order[e]
            if runs[e] == 2:
                begin = at
            if runs[e] > 0:
                end = at  # subsets without this sensor: begin..end, and the empty one
            base, bit = starts[2 * entry], starts[2 * entry + 1]
            owners[at] = i
            slots[at] = base + bit
            for s in range(q):
                members[at, s] = -1
            members[at, keys[entry]] = entry
            at += 1
            for k in range(begin, end):
                owners[at] = i
                slots[at] = slots[k] + bit
                for s in range(q):
                    members[at, s] = members[k, s]
                members[at, keys[entry]] = entry
                at += 1


@kernel
def _coefficients(totals: FloatArray, bases: IntArray, out: FloatArray) -> None:
    for g in range(bases.size - 1):
        base, subsets = bases[g], bases[g + 1] - bases[g]
        scale = np.zeros(
            subsets
        )  # of subsets: products of a scale for each measurement, so that no F is huge
        scale[0] = 1.0
        low = 1
        while low < subsets:
            single = totals[base + low]
            if single <= 0.0:
                for w in range(subsets):
                    if w & low:
                        single = max(single, totals[base + w])
            for w in range(low):
                scale[low + w] = scale[w] * (single if single > 0.0 else 1.0)
            low *= 2
        partitions = np.zeros(subsets)
        partitions[0] = 1.0
        for whole in range(1, subsets):
            low = whole & -whole
            rest = whole ^ low
            part = rest
            while True:
                w = part | low
                if totals[base + w] > 0.0:
                    partitions[whole] += totals[base + w] / scale[w] * partitions[whole ^ w]
                if part == 0:
                    break
                part = (part - 1) & rest
        everything = partitions[subsets - 1]
        if everything > 0.0:
            for w in range(1, subsets):
                out[base + w] = partitions[(subsets - 1) ^ w] / everything / scale[w]
