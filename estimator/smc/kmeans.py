"""Weighted K-means that finds the number of clusters itself and leaves stray mass out.

An intensity is a few narrow peaks, each about one target, and faint mass in between; plain K-means would draw
that mass into its clusters and make them wide. So here
1. seeds are the heaviest places: previous centres first, then the cells of a grid of side `cutoff` by falling
   mass, each moved to the mean of the mass within `cutoff` (two steps of mean shift, Comaniciu & Meer 2002);
   mass within a seed's cut-off seeds no more, and a seed with less than `least` mass is none;
2. Lloyd's iterations run with that cut-off: a particle further than it from every centre is in no cluster
   (trimmed K-means, Cuesta-Albertos, Gordaliza & Matran 1997);
3. two clusters that are not separate become one, and one that falls into two separate halves becomes two
   (bisecting K-means), where separate means that the centres' distance is more than `separation` standard
   deviations, sqrt(s_a^2 + s_b^2) along the line between them. Halves of one normal peak are 1.9 apart.
Nothing is random. The number of clusters follows from where the mass is: a place counts with `least` of it.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.filter import Clusters
from estimator.kernels import kernel
from estimator.smc.seeding import seeded

_ITERATIONS = 20


def kmeans(
    positions: FloatArray,
    weights: FloatArray,
    cutoff: float,
    *,
    least: float = 0.1,
    separation: float = 3.0,
    start: FloatArray | None = None,
) -> tuple[Clusters, IntArray]:
    """Clusters of particles at positions (d, n) with weights (n,), heaviest first, and labels (n,).

    `cutoff` in metres; `least` in targets; `start` (d, k) are centres to begin with. Label -1: in no cluster.

    Raises:
        ValueError: if a shape is wrong, or cutoff or least are not positive.
    """
    positions = np.ascontiguousarray(positions, dtype=np.float64)
    weights = np.ascontiguousarray(weights, dtype=np.float64)
    if positions.ndim != 2 or weights.shape != (positions.shape[1],):
        raise ValueError(f"weights: expected one per column of {positions.shape}, got {weights.shape}")
    if not cutoff > 0 or not least > 0:
        raise ValueError("cutoff and least: must be positive")
    d = positions.shape[0]
    centres = np.ascontiguousarray(np.zeros((0, d)) if start is None else start.T)
    seeds = seeded(positions, weights, centres, cutoff, least)
    labels = np.empty(weights.size, np.int64)
    if len(seeds) == 0:
        labels.fill(-1)
        return Clusters.none(d), labels
    seeds = _lloyd(positions, weights, seeds, cutoff, labels)
    count = _restructured(positions, weights, labels, len(seeds), separation, least)
    means, covariances, masses = _moments(positions, weights, labels, count)
    order = np.argsort(-masses, kind="stable")
    order = order[masses[order] >= least]
    rank = np.full(count + 1, -1, dtype=np.int64)
    rank[order] = np.arange(order.size)
    labels = rank[labels]
    covariances = covariances[order]
    radii = np.sqrt(np.trace(covariances, axis1=1, axis2=2) / d)
    return Clusters(np.ascontiguousarray(means[order].T), covariances, masses[order], radii), labels


@kernel
def _assign(
    positions: FloatArray, centres: FloatArray, reach2: float, labels: IntArray, best: FloatArray
) -> None:
    """Label of the nearest centre (k, d) within sqrt(reach2), else -1."""
    d, n = positions.shape
    px, py = positions[0], positions[1]
    for i in range(n):
        best[i] = reach2
        labels[i] = -1
    for j in range(centres.shape[0]):
        x, y = centres[j, 0], centres[j, 1]
        if d == 2:
            for i in range(n):
                dx, dy = px[i] - x, py[i] - y
                far = dx * dx + dy * dy
                nearer = far < best[i]
                best[i] = far if nearer else best[i]
                labels[i] = j if nearer else labels[i]
        else:
            z, pz = centres[j, 2], positions[2]
            for i in range(n):
                dx, dy, dz = px[i] - x, py[i] - y, pz[i] - z
                far = dx * dx + dy * dy + dz * dz
                nearer = far < best[i]
                best[i] = far if nearer else best[i]
                labels[i] = j if nearer else labels[i]


@kernel
def _lloyd(
    positions: FloatArray, weights: FloatArray, seeds: FloatArray, cutoff: float, labels: IntArray
) -> FloatArray:
    """Lloyd's iterations with a cut-off until the centres rest; fills labels (n,), returns centres (k, d)."""
    d, n = positions.shape
    k = seeds.shape[0]
    best = np.empty(n)
    centres = seeds.copy()
    for _ in range(_ITERATIONS):
        _assign(positions, centres, cutoff * cutoff, labels, best)
        mass, sums = np.zeros(k), np.zeros((k, d))
        for i in range(n):
            j = labels[i]
            if j >= 0:
                mass[j] += weights[i]
                for a in range(d):
                    sums[j, a] += weights[i] * positions[a, i]
        moved = 0.0
        for j in range(k):
            if mass[j] > 0.0:
                for a in range(d):
                    x = sums[j, a] / mass[j]
                    moved = max(moved, abs(x - centres[j, a]))
                    centres[j, a] = x
        if moved < 1e-3 * cutoff:
            break
    return centres


@kernel
def _moments(
    positions: FloatArray, weights: FloatArray, labels: IntArray, count: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means (k, d), covariances (k, d, d) and masses (k,) of the labelled particles."""
    d, n = positions.shape
    means, covariances, masses = np.zeros((count, d)), np.zeros((count, d, d)), np.zeros(count)
    for i in range(n):
        j = labels[i]
        if j >= 0:
            masses[j] += weights[i]
            for a in range(d):
                means[j, a] += weights[i] * positions[a, i]
    for j in range(count):
        for a in range(d):
            means[j, a] /= max(masses[j], 1e-300)
    for i in range(n):
        j = labels[i]
        if j >= 0:
            for a in range(d):
                for b in range(a + 1):
                    covariances[j, a, b] += (
                        weights[i] * (positions[a, i] - means[j, a]) * (positions[b, i] - means[j, b])
                    )
    for j in range(count):
        for a in range(d):
            for b in range(a + 1):
                covariances[j, a, b] /= max(masses[j], 1e-300)
                covariances[j, b, a] = covariances[j, a, b]
    return means, covariances, masses


@kernel
def _apart(mean_a: FloatArray, spread_a: FloatArray, mean_b: FloatArray, spread_b: FloatArray) -> float:
    """Distance of two centres in standard deviations along the line between them, squared."""
    step = mean_b - mean_a
    length2 = np.sum(step * step)
    if length2 == 0.0:
        return 0.0
    variance = 0.0
    for a in range(step.size):
        for b in range(step.size):
            variance += step[a] * step[b] * (spread_a[a, b] + spread_b[a, b])
    variance /= length2
    return length2 / variance if variance > 0.0 else np.inf


@kernel
def _restructured(
    positions: FloatArray, weights: FloatArray, labels: IntArray, count: int, separation: float, least: float
) -> int:
    """Step 3 of the module, on labels in place; the new number of labels, some perhaps unused."""
    limit = separation * separation
    merged = True
    while merged:
        merged = False
        means, covariances, masses = _moments(positions, weights, labels, count)
        for a in range(count):
            for b in range(a + 1, count):
                if masses[a] <= 0.0 or masses[b] <= 0.0 or merged:
                    continue
                if _apart(means[a], covariances[a], means[b], covariances[b]) < limit:
                    labels[labels == b] = a
                    merged = True
    j = 0
    while j < count < 10_000:
        members = np.flatnonzero(labels == j)
        if members.size >= 4 and _split(positions, weights, members, labels, count, limit, least):
            count += 1  # and look at the first half again
        else:
            j += 1
    return count


@kernel
def _split(
    positions: FloatArray,
    weights: FloatArray,
    members: IntArray,
    labels: IntArray,
    fresh: int,
    limit: float,
    least: float,
) -> bool:
    """Give label `fresh` to one half of the members if their 2-means halves are separate."""
    d, n = positions.shape[0], members.size
    own = np.zeros(n, np.int64)
    x, w, along = np.empty((d, n)), np.empty(n), np.empty(n)
    for k in range(n):
        w[k] = weights[members[k]]
        for a in range(d):
            x[a, k] = positions[a, members[k]]
    means, covariances, masses = _moments(x, w, own, 1)
    if masses[0] < 2.0 * least:
        return False
    axis = np.ones(d)
    for _ in range(30):  # power iteration: the widest direction
        axis = covariances[0] @ axis
        length = np.sqrt(np.sum(axis * axis))
        if length == 0.0:
            return False
        axis /= length
    for k in range(n):
        along[k] = 0.0
        for a in range(d):
            along[k] += (x[a, k] - means[0, a]) * axis[a]
    if _halves_apart(along, w) < 0.5 * limit:  # a normal peak has 3.5; no need to look closer
        return False
    for k in range(n):
        own[k] = 1 if along[k] > 0.0 else 0
    for _ in range(_ITERATIONS):
        sums, totals = np.zeros((2, d)), np.zeros(2)
        for k in range(n):
            totals[own[k]] += w[k]
            for a in range(d):
                sums[own[k], a] += w[k] * x[a, k]
        if totals[0] < least or totals[1] < least:
            return False
        changed = 0
        for k in range(n):
            near, far = 0.0, 0.0
            for a in range(d):
                near += (x[a, k] - sums[0, a] / totals[0]) ** 2
                far += (x[a, k] - sums[1, a] / totals[1]) ** 2
            side = 1 if far < near else 0
            changed += side != own[k]
            own[k] = side
        if changed == 0:
            break
    means, covariances, masses = _moments(x, w, own, 2)
    if masses[0] < least or masses[1] < least:
        return False
    if _apart(means[0], covariances[0], means[1], covariances[1]) < limit:
        return False
    for k in range(n):
        if own[k] == 1:
            labels[members[k]] = fresh
    return True


@kernel
def _halves_apart(along: FloatArray, weights: FloatArray) -> float:
    """`_apart` of the numbers `along` (n,) above 0 and below, in one dimension."""
    mass, first, second = np.zeros(2), np.zeros(2), np.zeros(2)
    for k in range(along.size):
        side = 1 if along[k] > 0.0 else 0
        mass[side] += weights[k]
        first[side] += weights[k] * along[k]
        second[side] += weights[k] * along[k] * along[k]
    if mass[0] <= 0.0 or mass[1] <= 0.0:
        return 0.0
    low, high = first[0] / mass[0], first[1] / mass[1]
    variance = second[0] / mass[0] - low * low + second[1] / mass[1] - high * high
    return (high - low) ** 2 / variance if variance > 0.0 else np.inf
