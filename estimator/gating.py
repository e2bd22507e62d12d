"""Likelihoods of range-bearing(-elevation) measurements at the few points that each can touch.

Range and direction around the sensor are cut into 64 x 64 cells; a cell lists the measurements whose gate
reaches into it. Each point looks up its own cell only, so the work follows the pairs that matter and not
points times measurements. Directions use a monotone stand-in for the angle that needs one division.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray, ShortArray
from estimator.kernels import exp_negative, kernel

_RINGS = 64
_RAYS = 64
_CELLS = _RINGS * _RAYS
_SMALL = 0.25  # radians up to which the arcsine's series below is good to 1e-11


@kernel
def _diamond(x: float, y: float) -> float:
    """A number in -1..3 that grows with the direction of (x, y), counter-clockwise from -pi/2."""
    t = y / (abs(x) + abs(y) + 1e-300)
    return t if x >= 0.0 else 2.0 - t


@kernel
def _arcsine(s: float) -> float:
    """arcsin(s) for |s| <= 0.25."""
    q = s * s
    tail = 35.0 / 1152.0 + q * (63.0 / 2816.0 + q * (231.0 / 13312.0 + q * (143.0 / 10240.0)))
    return s * (1.0 + q * (1.0 / 6.0 + q * (3.0 / 40.0 + q * (5.0 / 112.0 + q * tail))))


@kernel
def _table(
    measurements: FloatArray, sigmas: FloatArray, gate: float, farthest: float
) -> tuple[IntArray, IntArray]:
    """For each cell the measurements whose gate reaches into it, as compressed rows."""
    m = measurements.shape[0]
    rings = np.empty((m, 2), np.int64)
    rays = np.empty((m, 2), np.int64)
    start = np.zeros(_CELLS + 2, np.int64)
    half = gate * sigmas[1]
    for j in range(m):
        r, width = measurements[j, 0], gate * sigmas[0]
        scale = _RINGS / farthest
        rings[j, 0] = max(0, int((r - width) * scale) - 1)
        rings[j, 1] = min(_RINGS - 1, int((r + width) * scale) + 1)
        if half >= 3.1:
            rays[j, 0], rays[j, 1] = 0, _RAYS - 1
        else:
            a, b = measurements[j, 1] - half, measurements[j, 1] + half
            first = int((_diamond(np.cos(a), np.sin(a)) + 1.0) * (0.25 * _RAYS)) - 1
            last = int((_diamond(np.cos(b), np.sin(b)) + 1.0) * (0.25 * _RAYS)) + 1
            if last < first or (half > 1.5 and last - first < _RAYS // 4):
                last += _RAYS
            rays[j, 0], rays[j, 1] = first, min(last, first + _RAYS - 1)
        for ring in range(rings[j, 0], rings[j, 1] + 1):
            for ray in range(rays[j, 0], rays[j, 1] + 1):
                start[ring * _RAYS + ray % _RAYS + 1] += 1
    for c in range(_CELLS + 1):
        start[c + 1] += start[c]
    listed = np.empty(start[_CELLS], np.int64)
    filled = start[:_CELLS].copy()
    for j in range(m):
        for ring in range(rings[j, 0], rings[j, 1] + 1):
            for ray in range(rays[j, 0], rays[j, 1] + 1):
                c = ring * _RAYS + ray % _RAYS
                listed[filled[c]] = j
                filled[c] += 1
    return start, listed


@kernel
def _cells(
    points: FloatArray, pose: FloatArray, farthest: float, ranges: FloatArray, cells: ShortArray
) -> float:
    """Range and cell of every point; beyond `farthest` the cell is the empty last one. The ranges' sum."""
    scale, turn = _RINGS / farthest, 0.25 * _RAYS
    px, py = points[0], points[1]
    x, y = pose[0], pose[1]
    total = 0.0
    if points.shape[0] == 3:
        pz, z = points[2], pose[2]
        for i in range(px.size):
            dx, dy, dz = px[i] - x, py[i] - y, pz[i] - z
            ranges[i] = np.sqrt(dx * dx + dy * dy + dz * dz)
    else:
        for i in range(px.size):
            dx, dy = px[i] - x, py[i] - y
            ranges[i] = np.sqrt(dx * dx + dy * dy)
    for i in range(px.size):
        r = ranges[i]
        total += r
        near = r < farthest  # false for NaN
        ring = (r if near else 0.0) * scale
        ray = (_diamond(px[i] - x, py[i] - y) + 1.0) * turn
        ray = ray if near else 0.0
        row, column = min(np.int32(ring), np.int32(_RINGS - 1)), np.int32(ray) & np.int32(_RAYS - 1)
        cells[i] = row * np.int32(_RAYS) + column if near else np.int32(_CELLS)
    return total


@kernel
def _densities_2d(
    points: FloatArray,
    pose: FloatArray,
    ranges: FloatArray,
    measurements: FloatArray,
    sigmas: FloatArray,
    gate: float,
    rows: ShortArray,
    found: ShortArray,
    density: FloatArray,
) -> None:
    """Gaussian densities of the pairs (rows[k], found[k]), 0 outside the gate. Without branches on data."""
    r_z, cosines, sines = measurements[:, 0].copy(), np.cos(measurements[:, 1]), np.sin(measurements[:, 1])
    px, py, x, y = points[0], points[1], pose[0], pose[1]
    width, half = gate * sigmas[0], gate * sigmas[1]
    limit = np.sin(min(half, 1.0))
    weight_r, weight_b = 0.5 / sigmas[0] ** 2, 0.5 / sigmas[1] ** 2
    norm = 1.0 / (2.0 * np.pi * sigmas[0] * sigmas[1])
    if half <= _SMALL:
        for k in range(rows.size):
            i, j = found[k], rows[k]
            r = ranges[i]
            on = r == 0.0
            inverse = 1.0 / (1.0 if on else r)
            ux, uy = (1.0 if on else px[i] - x) * inverse, (py[i] - y) * inverse
            off = r - r_z[j]
            ahead, aside = cosines[j] * ux + sines[j] * uy, cosines[j] * uy - sines[j] * ux
            inside = (abs(off) <= width) & (ahead > 0.0) & (abs(aside) <= limit)
            turn = _arcsine(aside)
            value = norm * exp_negative(-(weight_r * off * off + weight_b * turn * turn))
            density[k] = value if inside else 0.0
    else:
        for k in range(rows.size):
            i, j = found[k], rows[k]
            off = ranges[i] - r_z[j]
            dx, dy = px[i] - x, py[i] - y
            if ranges[i] == 0.0:
                dx = 1.0
            turn = np.arctan2(cosines[j] * dy - sines[j] * dx, cosines[j] * dx + sines[j] * dy)
            inside = (abs(off) <= width) & (abs(turn) <= half)
            value = norm * exp_negative(-(weight_r * off * off + weight_b * turn * turn))
            density[k] = value if inside else 0.0


@kernel
def _densities_3d(
    points: FloatArray,
    pose: FloatArray,
    ranges: FloatArray,
    measurements: FloatArray,
    sigmas: FloatArray,
    gate: float,
    rows: ShortArray,
    found: ShortArray,
    density: FloatArray,
) -> None:
    """As `_densities_2d`, with the elevation."""
    r_z, cosines, sines = measurements[:, 0].copy(), np.cos(measurements[:, 1]), np.sin(measurements[:, 1])
    high, up_cosines, up_sines = (
        measurements[:, 2].copy(),
        np.cos(measurements[:, 2]),
        np.sin(measurements[:, 2]),
    )
    px, py, pz, x, y, z = points[0], points[1], points[2], pose[0], pose[1], pose[2]
    width, half, up_half = gate * sigmas[0], gate * sigmas[1], gate * sigmas[2]
    limit, up_limit = np.sin(min(half, 1.0)), np.sin(min(up_half, 1.0))
    weight_r, weight_b, weight_e = 0.5 / sigmas[0] ** 2, 0.5 / sigmas[1] ** 2, 0.5 / sigmas[2] ** 2
    norm = 1.0 / ((2.0 * np.pi) ** 1.5 * sigmas[0] * sigmas[1] * sigmas[2])
    if half <= _SMALL and up_half <= _SMALL:
        for k in range(rows.size):
            i, j = found[k], rows[k]
            dx, dy, dz, r = px[i] - x, py[i] - y, pz[i] - z, ranges[i]
            level = np.sqrt(dx * dx + dy * dy)
            above, on = level == 0.0, r == 0.0
            inverse, up_inverse = 1.0 / (1.0 if above else level), 1.0 / (1.0 if on else r)
            ux, uy = (1.0 if above else dx) * inverse, dy * inverse
            ce, se = (1.0 if on else level) * up_inverse, dz * up_inverse
            off = r - r_z[j]
            ahead, aside = cosines[j] * ux + sines[j] * uy, cosines[j] * uy - sines[j] * ux
            along, rise = ce * up_cosines[j] + se * up_sines[j], se * up_cosines[j] - ce * up_sines[j]
            inside = (abs(off) <= width) & (ahead > 0.0) & (abs(aside) <= limit)
            inside = inside & (along > 0.0) & (abs(rise) <= up_limit)
            turn, rise = _arcsine(aside), _arcsine(rise)
            exponent = weight_r * off * off + weight_b * turn * turn + weight_e * rise * rise
            value = norm * exp_negative(-exponent)
            density[k] = value if inside else 0.0
    else:
        for k in range(rows.size):
            i, j = found[k], rows[k]
            dx, dy, dz = px[i] - x, py[i] - y, pz[i] - z
            level = np.sqrt(dx * dx + dy * dy)
            off = ranges[i] - r_z[j]
            rise = np.arctan2(dz, level) - high[j]
            if level == 0.0:
                dx = 1.0
            turn = np.arctan2(cosines[j] * dy - sines[j] * dx, cosines[j] * dx + sines[j] * dy)
            inside = (abs(off) <= width) & (abs(turn) <= half) & (abs(rise) <= up_half)
            exponent = weight_r * off * off + weight_b * turn * turn + weight_e * rise * rise
            value = norm * exp_negative(-exponent)
            density[k] = value if inside else 0.0


@kernel
def gated_likelihoods(
    points: FloatArray, pose: FloatArray, measurements: FloatArray, sigmas: FloatArray, gate: float
) -> tuple[IntArray, IntArray, FloatArray, bool]:
    """Compressed rows (offsets (m + 1,), indices, likelihood) of (MA)ASI (10) within `gate` sigmas.

    points (d, n), pose (4,), measurements (m, d) with bearings in the world frame, sigmas (d,). The last
    result is False if a point is not finite; the rest is then of no use.
    """
    n, m, solid = points.shape[1], measurements.shape[0], points.shape[0] == 3
    farthest = 1e-9
    for j in range(m):
        farthest = max(farthest, measurements[j, 0] + gate * sigmas[0])
    ranges = np.empty(n)
    cells = np.empty(n, np.int32)
    finite = np.isfinite(_cells(points, pose, farthest, ranges, cells))
    offsets = np.zeros(m + 1, np.int64)
    if m == 0 or not finite:
        return offsets, np.empty(0, np.int64), np.empty(0), finite
    start, listed = _table(measurements, sigmas, gate, farthest)

    pairs = 0
    for i in range(n):
        pairs += start[cells[i] + 1] - start[cells[i]]
    rows, found = np.empty(pairs, np.int32), np.empty(pairs, np.int32)
    count = 0
    for i in range(n):
        for k in range(start[cells[i]], start[cells[i] + 1]):
            rows[count], found[count] = listed[k], i
            count += 1

    density = np.empty(pairs)
    if solid:
        _densities_3d(points, pose, ranges, measurements, sigmas, gate, rows, found, density)
    else:
        _densities_2d(points, pose, ranges, measurements, sigmas, gate, rows, found, density)

    for k in range(pairs):
        offsets[rows[k] + 1] += density[k] > 0.0
    for j in range(m):
        offsets[j + 1] += offsets[j]
    filled = offsets[:m].copy()
    indices, likelihood = np.empty(offsets[m], np.int64), np.empty(offsets[m])
    for k in range(pairs):
        if density[k] > 0.0:
            at = filled[rows[k]]
            filled[rows[k]] = at + 1
            indices[at], likelihood[at] = found[k], density[k]
    return offsets, indices, likelihood, finite
