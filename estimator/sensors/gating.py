"""Likelihoods of range-bearing(-elevation) measurements at the few points that each can touch.

Range and direction around the sensor are cut into 64 x 64 cells. Those that some gate reaches into get
numbers, slots, and the points in them are sorted by slot; each measurement looks at its own cells only, so
the work follows the pairs that matter and not points times measurements. Directions use a monotone stand-in
for the angle that needs one division.
"""

import numpy as np

from estimator.arrays import FlagArray, FloatArray, IndexArray, IntArray, ShortArray
from estimator.kernels import kernel
from estimator.sensors.densities import BLOCK, densities_2d, densities_3d

_RINGS = 64
_RAYS = 64
_CELLS = _RINGS * _RAYS


@kernel
def _diamond(x: float, y: float) -> float:
    """A number in -1..3 that grows with the direction of (x, y), counter-clockwise from -pi/2."""
    t = y / (abs(x) + abs(y) + 1e-300)
    return t if x >= 0.0 else 2.0 - t


@kernel
def _gates(
    measurements: FloatArray, sigmas: FloatArray, gate: float, farthest: float, used: FlagArray
) -> ShortArray:
    """First and last ring, first and last ray (m, 4) of each measurement's gate; marks its cells in `used`.

    A last ray beyond the number of rays goes on from ray 0.
    """
    m = measurements.shape[0]
    gates = np.empty((m, 4), np.int32)
    half, width, scale = gate * sigmas[1], gate * sigmas[0], _RINGS / farthest
    for j in range(m):
        r = measurements[j, 0]
        gates[j, 0] = max(0, int((r - width) * scale) - 1)
        gates[j, 1] = min(_RINGS - 1, max(-1, int((r + width) * scale) + 1))  # -1: of a range below 0
        if half >= 3.1:
            gates[j, 2], gates[j, 3] = 0, _RAYS - 1
        else:
            a, b = measurements[j, 1] - half, measurements[j, 1] + half
            first = int((_diamond(np.cos(a), np.sin(a)) + 1.0) * (0.25 * _RAYS)) - 1
            last = int((_diamond(np.cos(b), np.sin(b)) + 1.0) * (0.25 * _RAYS)) + 1
            if last < first or (half > 1.5 and last - first < _RAYS // 4):
                last += _RAYS
            gates[j, 2], gates[j, 3] = first, min(last, first + _RAYS - 1)
        for ring in range(gates[j, 0], gates[j, 1] + 1):
            for ray in range(gates[j, 2], gates[j, 3] + 1):
                used[ring * _RAYS + ray % _RAYS] = 1
    return gates


@kernel
def _slots(used: FlagArray) -> tuple[ShortArray, int]:
    """Used cells numbered from 1 in their order (cells + 1,), 0 for the others; how many there are."""
    slots = np.zeros(_CELLS + 1, np.int32)
    count = 0
    for begin in range(0, _CELLS, _RAYS):
        any_used = 0
        for cell in range(begin, begin + _RAYS):
            any_used |= used[cell]
        if any_used:
            for cell in range(begin, begin + _RAYS):
                count += used[cell]
                slots[cell] = count * used[cell]
    return slots, count


@kernel
def _near(
    points: FloatArray, pose: FloatArray, farthest: float, slots: ShortArray
) -> tuple[IndexArray, ShortArray, bool]:
    """Indices and slots of the points in used cells; whether all points are finite."""
    n = points.shape[1]
    near, near_slots = np.empty(n, np.uint32), np.empty(n, np.int32)
    ranges, rays, cells = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK, np.uint32)
    scale, turn = _RINGS / farthest, 0.25 * _RAYS
    x, y = pose[0], pose[1]
    total, count = 0.0, np.uint64(0)
    for begin in range(0, n, BLOCK):
        size = min(BLOCK, n - begin)
        px, py = points[0, begin : begin + size], points[1, begin : begin + size]
        if points.shape[0] == 3:
            pz, z = points[2, begin : begin + size], pose[2]
            for i in range(size):
                dx, dy, dz = px[i] - x, py[i] - y, pz[i] - z
                ranges[i] = np.sqrt(dx * dx + dy * dy + dz * dz)
                rays[i] = (_diamond(dx, dy) + 1.0) * turn
        else:
            for i in range(size):
                dx, dy = px[i] - x, py[i] - y
                ranges[i] = np.sqrt(dx * dx + dy * dy)
                rays[i] = (_diamond(dx, dy) + 1.0) * turn
        for i in range(size):
            r = ranges[i]
            total += r
            inside = r < farthest  # false for NaN
            ring, ray = np.int32((r if inside else 0.0) * scale), np.int32(rays[i] if inside else 0.0)
            row, column = min(ring, np.int32(_RINGS - 1)), ray & np.int32(_RAYS - 1)
            cells[i] = np.uint32(row * np.int32(_RAYS) + column if inside else np.int32(_CELLS))
        for i in range(size):  # without a branch, as nothing tells beforehand which points are near
            slot = slots[cells[i]]
            near[count] = begin + i
            near_slots[count] = slot
            count += np.uint64(slot > 0)
    return near[:count], near_slots[:count], np.isfinite(total)


@kernel
def _by_slot(near: IndexArray, slots: ShortArray, count: int) -> tuple[IntArray, IndexArray]:
    """The points slot by slot: offsets (count + 2,), s has `indices[offsets[s]:offsets[s + 1]]`; indices.

    Counting sort.
    """
    offsets = np.zeros(count + 2, np.int64)
    for q in range(near.size):
        offsets[slots[q] + 1] += 1
    for s in range(count + 1):
        offsets[s + 1] += offsets[s]
    filled = offsets.copy()
    indices = np.empty(near.size, np.uint32)
    for q in range(near.size):
        at = filled[slots[q]]
        indices[at] = near[q]
        filled[slots[q]] = at + 1
    return offsets, indices


@kernel
def _candidates(
    gates: ShortArray, slots: ShortArray, offsets: IntArray, indices: IndexArray
) -> tuple[IntArray, IndexArray]:
    """Points in the cells of each measurement's gate, as compressed rows.

    All cells of a gate have slots, and those that lie side by side have slots in a row: a ring of a gate is
    one piece of `indices`, or two where it goes across ray 0.
    """
    m = gates.shape[0]
    rows = np.zeros(m + 1, np.int64)
    candidates = np.empty(0, np.uint32)
    for filling in range(2):
        at = 0
        for j in range(m):
            first, width = gates[j, 2] % _RAYS, gates[j, 3] - gates[j, 2] + 1
            over = first + width - _RAYS
            for ring in range(gates[j, 0], gates[j, 1] + 1):
                base = ring * _RAYS
                begin = offsets[slots[base + first]]
                end = offsets[slots[base + (_RAYS if over > 0 else first + width) - 1] + 1]
                again = offsets[slots[base + over - 1] + 1] if over > 0 else np.int64(0)
                again_from = offsets[slots[base]] if over > 0 else np.int64(0)
                if filling:
                    for k in range(begin, end):
                        candidates[at + k - begin] = indices[k]
                    for k in range(again_from, again):
                        candidates[at + end - begin + k - again_from] = indices[k]
                at += end - begin + again - again_from
            rows[j + 1] = at
        if not filling:
            candidates = np.empty(at, np.uint32)
    return rows, candidates


@kernel
def gated_likelihoods(
    points: FloatArray, pose: FloatArray, measurements: FloatArray, sigmas: FloatArray, gate: float
) -> tuple[IntArray, IntArray, FloatArray, bool]:
    """Compressed rows (offsets (m + 1,), indices, likelihood) of (MA)ASI (10) within `gate` sigmas.

    points (d, n), pose (4,), measurements (m, d) with bearings in the world frame, sigmas (d,). The last
    result is False if a point is not finite; the rest is then of no use.
    """
    m = measurements.shape[0]
    farthest = 1e-9
    for j in range(m):
        farthest = max(farthest, measurements[j, 0] + gate * sigmas[0])
    used = np.zeros(_CELLS + 1, np.uint8)
    gates = _gates(measurements, sigmas, gate, farthest, used)
    slots, count = _slots(used)
    near, near_slots, finite = _near(points, pose, farthest, slots)
    by_slot, sorted_points = _by_slot(near, near_slots, count)
    rows, candidates = _candidates(gates, slots, by_slot, sorted_points)
    offsets = np.zeros(m + 1, np.int64)
    indices, likelihood = np.empty(rows[m], np.int64), np.empty(rows[m])
    buffer, density = np.empty((5, BLOCK)), np.empty(BLOCK)
    kept = 0
    for j in range(m):
        for begin in range(rows[j], rows[j + 1], BLOCK):
            block = candidates[begin : min(begin + BLOCK, rows[j + 1])]
            if points.shape[0] == 3:
                densities_3d(points, pose, block, measurements[j], sigmas, gate, buffer, density)
            else:
                densities_2d(points, pose, block, measurements[j], sigmas, gate, buffer, density)
            for k in range(block.size):
                indices[kept] = block[k]
                likelihood[kept] = density[k]
                kept += density[k] > 0.0
        offsets[j + 1] = kept
    return offsets, indices[:kept], likelihood[:kept], finite
