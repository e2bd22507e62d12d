"""Where K-means begins: the heaviest places of a weighted set of particles."""

import numpy as np

from estimator.arrays import FloatArray
from estimator.kernels import kernel


@kernel
def _shifted(
    positions: FloatArray,
    weights: FloatArray,
    free: FloatArray,
    centre: FloatArray,
    reach2: float,
    moved: FloatArray,
) -> float:
    """The free mass within sqrt(reach2) of centre (d,), and its mean in `moved` (d,)."""
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
    scale = 1.0 / mass if mass > 0.0 else 0.0
    moved[0], moved[1] = x + sx * scale, y + sy * scale
    if d == 3:
        moved[2] = centre[2] + sz * scale
    return mass


@kernel
def _cover(positions: FloatArray, centre: FloatArray, reach2: float, free: FloatArray) -> None:
    """Set free[i] to 0 within sqrt(reach2) of centre."""
    px, py, x, y = positions[0], positions[1], centre[0], centre[1]
    if positions.shape[0] == 2:
        for i in range(free.size):
            dx, dy = px[i] - x, py[i] - y
            free[i] = 0.0 if dx * dx + dy * dy <= reach2 else free[i]
    else:
        pz, z = positions[2], centre[2]
        for i in range(free.size):
            dx, dy, dz = px[i] - x, py[i] - y, pz[i] - z
            free[i] = 0.0 if dx * dx + dy * dy + dz * dz <= reach2 else free[i]


@kernel
def _heavy_cells(positions: FloatArray, weights: FloatArray, side: float, least: float) -> FloatArray:
    """Mean positions (k, d) of the cells of a grid that hold at least `least`, by falling mass."""
    d, n = positions.shape
    low, inverse = np.empty(d), 1.0 / side
    counts = np.empty(d, np.int64)
    for a in range(d):
        bottom, top = np.inf, -np.inf
        for i in range(n):
            bottom, top = min(bottom, positions[a, i]), max(top, positions[a, i])
        low[a] = bottom
        while (top - bottom) * inverse > 1e6:  # so that a cell's number fits 64 bits
            inverse *= 0.5
        counts[a] = int((top - bottom) * inverse) + 1
    size = 16
    while size < 2 * n:
        size *= 2
    keys = np.full(size, -1, np.int64)  # a hash table with open addressing
    mass = np.zeros(size)
    sums = np.zeros((size, d))
    for i in range(n):
        code = 0
        for a in range(d):
            code = code * counts[a] + int((positions[a, i] - low[a]) * inverse)
        slot = (((code * 2654435761) & 0x7FFFFFFFFFFF) >> 11) & (size - 1)
        while keys[slot] >= 0 and keys[slot] != code:
            slot = (slot + 1) & (size - 1)
        keys[slot] = code
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
def seeded(
    positions: FloatArray, weights: FloatArray, start: FloatArray, cutoff: float, least: float
) -> FloatArray:
    """Starting centres (k, d) from earlier ones (c, d) and heavy cells: step 1 of `estimator.smc.kmeans`."""
    d, n = positions.shape
    reach2 = cutoff * cutoff
    # a cluster of `least` mass within the cut-off's radius touches at most 2^d cells of that side
    cells = _heavy_cells(positions, weights, cutoff, least / 2.0**d)
    free, moved = np.ones(n), np.empty(d)
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
        if _shifted(positions, weights, free, centre, reach2, moved) < least:
            continue
        centre[:] = moved
        if _shifted(positions, weights, free, centre, reach2, moved) < least:
            continue
        _cover(positions, centre, reach2, free)
        centre[:] = moved
        seeds[count] = centre
        count += 1
    return seeds[:count].copy()
