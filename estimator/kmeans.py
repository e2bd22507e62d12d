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
    seeds = _seeds(positions, weights, centres, cutoff, least)
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
    radii = np.sqrt(np.trace(covariances, axis1=1, axis2=2))
    return Clusters(np.ascontiguousarray(means[order].T), covariances, masses[order], radii), labels


@kernel
def _shifted(
    positions: FloatArray, weights: FloatArray, free: FloatArray, centre: FloatArray, reach2: float
) -> float:
    """Move `centre` (d,) to the mean of the free mass within sqrt(reach2) of it; that mass."""
    d, n = positions.shape
    mass, sx, sy, sz = 0.0, 0.0, 0.0, 0.0
    x, y = centre[0], centre[1]
    px, py = positions[0], positions[1]
    if d == 2:
        for i in range(n):
            dx, dy = px[i] - x, py[i] - y
            w = weights[i] * free[i] if dx * dx + dy * dy <= reach2 else 0.0
            mass += w
            sx += w * dx
            sy += w * dy
    else:
        z, pz = centre[2], positions[2]
        for i in range(n):
            dx, dy, dz = px[i] - x, py[i] - y, pz[i] - z
            w = weights[i] * free[i] if dx * dx + dy * dy + dz * dz <= reach2 else 0.0
            mass += w
            sx += w * dx
            sy += w * dy
            sz += w * dz
    if mass > 0.0:
        centre[0] += sx / mass
        centre[1] += sy / mass
        if d == 3:
            centre[2] += sz / mass
    return mass


@kernel
def _cover(positions: FloatArray, centre: FloatArray, reach2: float, free: FloatArray) -> None:
    """Set free[i] to 0 within sqrt(reach2) of centre."""
    d, n = positions.shape
    for i in range(n):
        far = 0.0
        for a in range(d):
            far += (positions[a, i] - centre[a]) ** 2
        if far <= reach2:
            free[i] = 0.0


@kernel
def _heavy_cells(positions: FloatArray, weights: FloatArray, side: float, least: float) -> FloatArray:
    """Mean positions (k, d) of the cells of a grid that hold at least `least`, by falling mass."""
    d, n = positions.shape
    size = 16
    while size < 2 * n:
        size *= 2
    keys = np.full(size, -1, np.int64)  # open addressing; a cell's key is the first particle in it
    mass = np.zeros(size)
    sums = np.zeros((size, d))
    inverse = 1.0 / side
    cell = np.empty(d, np.int64)
    for i in range(n):
        if weights[i] <= 0.0:
            continue
        code = 0
        for a in range(d):
            cell[a] = int(np.floor(positions[a, i] * inverse))
            code = code * 1000003 + cell[a]
        slot = ((code * 2654435761) >> 7) & (size - 1)
        while keys[slot] >= 0:
            same = True
            for a in range(d):
                same = same and int(np.floor(positions[a, keys[slot]] * inverse)) == cell[a]
            if same:
                break
            slot = (slot + 1) & (size - 1)
        if keys[slot] < 0:
            keys[slot] = i
        mass[slot] += weights[i]
        for a in range(d):
            sums[slot, a] += weights[i] * positions[a, i]
    heavy = np.flatnonzero((mass >= least) & (mass > 0.0))
    heavy = heavy[np.argsort(-mass[heavy], kind="mergesort")]
    means = np.empty((heavy.size, d))
    for k in range(heavy.size):
        for a in range(d):
            means[k, a] = sums[heavy[k], a] / mass[heavy[k]]
    return means


@kernel
def _seeds(
    positions: FloatArray, weights: FloatArray, start: FloatArray, cutoff: float, least: float
) -> FloatArray:
    """Starting centres (k, d): step 1 of the module."""
    d, n = positions.shape
    reach2 = cutoff * cutoff
    # a cluster of `least` mass within the cut-off's radius touches at most 2^d cells of that side
    cells = _heavy_cells(positions, weights, cutoff, least / 2.0**d)
    free = np.ones(n)
    seeds = np.empty((start.shape[0] + cells.shape[0], d))
    count = 0
    for k in range(start.shape[0] + cells.shape[0]):
        warm = k < start.shape[0]
        centre = start[k].copy() if warm else cells[k - start.shape[0]].copy()
        if not warm:
            taken = False
            for j in range(count):
                far = 0.0
                for a in range(d):
                    far += (seeds[j, a] - centre[a]) ** 2
                taken = taken or far <= reach2
            if taken:
                continue
        mass = _shifted(positions, weights, free, centre, reach2)
        if mass >= least:
            mass = _shifted(positions, weights, free, centre, reach2)
        if mass < least:
            continue
        _cover(positions, centre, reach2, free)
        seeds[count] = centre
        count += 1
    return seeds[:count].copy()


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
    x, w = np.empty((d, n)), np.empty(n)
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
    centre = means[0].copy()
    for k in range(n):
        along = 0.0
        for a in range(d):
            along += (x[a, k] - centre[a]) * axis[a]
        own[k] = 1 if along > 0.0 else 0
    for _ in range(_ITERATIONS):
        means, covariances, masses = _moments(x, w, own, 2)
        if masses[0] < least or masses[1] < least:
            return False
        changed = 0
        for k in range(n):
            near, far = 0.0, 0.0
            for a in range(d):
                near += (x[a, k] - means[0, a]) ** 2
                far += (x[a, k] - means[1, a]) ** 2
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
