"""Straight ways through a grid: does every cell that one touches leave room for the robot?

As a sensor's ray (estimator/maps/sight.py; Amanatides & Woo 1987), a way leaps over the cube of cells around
it that is known to be free. Unlike a ray it may not slip between two blocked cells that share only a corner
or an edge: where a way meets a corner, all cells around it count. On one layer it is followed column by
column (or row by row, whichever is more), which is several times as fast.
"""

import numpy as np

from estimator.arrays import BoolArray, FlagArray, FloatArray
from estimator.kernels import exact_kernel

TIE = 1e-9  # shares of a way nearer than this are one
EDGE = 1e-7  # cells: nearer than this to a border a way touches both sides of it


@exact_kernel
def chebyshev3(blocked: FlagArray) -> FlagArray:
    """Distance of each cell (l, r, c) to the nearest blocked one in king's moves, 0 on one, at most 255.

    Blocked is what is above 0. Two sweeps over the 26 neighbours are exact for this distance (Rosenfeld &
    Pfaltz 1968, in three dimensions).
    """
    layers, rows, columns = blocked.shape
    out = np.empty(blocked.shape, np.uint8)
    for sweep in range(2):
        for kk in range(layers):
            k = layers - 1 - kk if sweep else kk
            for jj in range(rows):
                j = rows - 1 - jj if sweep else jj
                for ii in range(columns):
                    i = columns - 1 - ii if sweep else ii
                    if blocked[k, j, i]:
                        out[k, j, i] = 0
                        continue
                    best = int(out[k, j, i]) - 1 if sweep else 254
                    side = 1 if sweep else -1
                    if 0 <= i + side < columns:
                        best = min(best, int(out[k, j, i + side]))
                    if 0 <= j + side < rows:
                        for n in range(max(i - 1, 0), min(i + 2, columns)):
                            best = min(best, int(out[k, j + side, n]))
                    if 0 <= k + side < layers:
                        for m in range(max(j - 1, 0), min(j + 2, rows)):
                            for n in range(max(i - 1, 0), min(i + 2, columns)):
                                best = min(best, int(out[k + side, m, n]))
                    out[k, j, i] = best + 1
    return out


@exact_kernel
def _blocked(clearance: FlagArray, i: int, j: int, k: int) -> bool:
    layers, rows, columns = clearance.shape
    return not (0 <= i < columns and 0 <= j < rows and 0 <= k < layers and clearance[k, j, i] > 0)


@exact_kernel
def _touched(place: float, cell: int, step: int, slope: float) -> tuple[int, int]:
    """The first and last cell along one axis that a place belongs to, when the way steps from `cell`."""
    if step != 0:
        return min(cell, cell + step), max(cell, cell + step)
    border = int(np.floor(place + 0.5))
    if slope != 0.0 and abs(place - border) < EDGE:
        return min(cell, border - 1), max(cell, border)
    return cell, cell


@exact_kernel
def open_way(clearance: FlagArray, u0: float, v0: float, w0: float, u1: float, v1: float, w1: float) -> bool:
    """Whether the straight way between two places in cell coordinates (column, row, layer) is open."""
    if clearance.shape[0] == 1:
        return _open_flat(clearance, u0, v0, u1, v1)
    layers, rows, columns = clearance.shape
    i, j, k = int(np.floor(u0)), int(np.floor(v0)), int(np.floor(w0))
    gi, gj, gk = int(np.floor(u1)), int(np.floor(v1)), int(np.floor(w1))
    if _blocked(clearance, i, j, k) or _blocked(clearance, gi, gj, gk):
        return False
    du, dv, dw = u1 - u0, v1 - v0, w1 - w0
    while True:
        leap = int(clearance[k, j, i])
        if abs(gi - i) < leap and abs(gj - j) < leap and abs(gk - k) < leap:
            return True
        tu = ((i + leap if du > 0.0 else i + 1 - leap) - u0) / du if du != 0.0 else np.inf
        tv = ((j + leap if dv > 0.0 else j + 1 - leap) - v0) / dv if dv != 0.0 else np.inf
        tw = ((k + leap if dw > 0.0 else k + 1 - leap) - w0) / dw if dw != 0.0 else np.inf
        t = min(tu, tv, tw)
        if not t < 1.0:
            return True
        # Rounding must not carry the coordinates that stay out of the cube.
        i2 = min(max(int(np.floor(u0 + t * du)), i + 1 - leap), i - 1 + leap)
        j2 = min(max(int(np.floor(v0 + t * dv)), j + 1 - leap), j - 1 + leap)
        k2 = min(max(int(np.floor(w0 + t * dw)), k + 1 - leap), k - 1 + leap)
        su = (1 if du > 0.0 else -1) if tu - t <= TIE else 0
        sv = (1 if dv > 0.0 else -1) if tv - t <= TIE else 0
        sw = (1 if dw > 0.0 else -1) if tw - t <= TIE else 0
        if su:
            i2 = i + (leap - 1) * su
        if sv:
            j2 = j + (leap - 1) * sv
        if sw:
            k2 = k + (leap - 1) * sw
        # All cells that the place where the way leaves the cube is a part of, be it their side or corner.
        ilow, ihigh = _touched(u0 + t * du, i2, su, du)
        jlow, jhigh = _touched(v0 + t * dv, j2, sv, dv)
        klow, khigh = _touched(w0 + t * dw, k2, sw, dw)
        for c in range(max(klow, 0), min(khigh + 1, layers)):
            for b in range(max(jlow, 0), min(jhigh + 1, rows)):
                for a in range(max(ilow, 0), min(ihigh + 1, columns)):
                    if clearance[c, b, a] == 0:
                        return False
        i, j, k = i2 + su, j2 + sv, k2 + sw
        if _blocked(clearance, i, j, k):
            return False


@exact_kernel
def _open_flat(clearance: FlagArray, u0: float, v0: float, u1: float, v1: float) -> bool:
    """`open_way` on one layer. Along the longer axis, strip by strip of cells; the way rises by one at most.

    If the cells that it touches in a strip are `least` moves from the next blocked one or more, so many
    strips are free.
    """
    _, rows, columns = clearance.shape
    if not (0.0 <= u0 < columns and 0.0 <= v0 < rows and 0.0 <= u1 < columns and 0.0 <= v1 < rows):
        return False
    wide = abs(u1 - u0) >= abs(v1 - v0)
    if not wide:
        u0, v0, u1, v1 = v0, u0, v1, u1
    if u0 > u1:
        u0, v0, u1, v1 = u1, v1, u0, v0
    slope = (v1 - v0) / (u1 - u0) if u1 > u0 else 0.0
    strips, across = (columns, rows) if wide else (rows, columns)
    strip = max(int(np.floor(u0 - EDGE)), 0)
    last = min(int(np.floor(u1 + EDGE)), strips - 1)
    while strip <= last:
        a = v0 + (max(float(strip), u0) - u0) * slope
        b = v0 + (min(strip + 1.0, u1) - u0) * slope
        least = 255
        for j in range(
            max(int(np.floor(min(a, b) - EDGE)), 0), min(int(np.floor(max(a, b) + EDGE)), across - 1) + 1
        ):
            free = int(clearance[0, j, strip] if wide else clearance[0, strip, j])
            if free == 0:
                return False
            least = min(least, free)
        strip += least
    return True


@exact_kernel
def open_ways(clearance: FlagArray, starts: FloatArray, ends: FloatArray, out: BoolArray) -> None:
    """`open_way` of places (3, n) in cell coordinates, which may be anything."""
    for n in range(out.size):
        good = True
        for a in range(3):
            good = good and np.isfinite(starts[a, n]) and np.isfinite(ends[a, n])
            good = good and abs(starts[a, n]) < 2.0**30 and abs(ends[a, n]) < 2.0**30
        out[n] = good and open_way(
            clearance, starts[0, n], starts[1, n], starts[2, n], ends[0, n], ends[1, n], ends[2, n]
        )


@exact_kernel
def squared_distances(free: BoolArray) -> FloatArray:
    """Square of the distance (r, c) in cells between middles to the nearest cell that is not free.

    Felzenszwalb & Huttenlocher, "Distance Transforms of Sampled Functions" (2012): lower envelopes of
    parabolas, along columns and then along rows; exact. Infinite where there is none.
    """
    rows, columns = free.shape
    out = np.where(free, np.inf, 0.0)
    most = max(rows, columns)
    value, where = np.empty(most), np.empty(most, np.int64)
    edge = np.empty(most + 1)
    for axis in range(2):
        lines, length = (columns, rows) if axis == 0 else (rows, columns)
        for line in range(lines):
            for q in range(length):
                value[q] = out[q, line] if axis == 0 else out[line, q]
            top = -1
            for q in range(length):
                if value[q] == np.inf:
                    continue
                s = -np.inf
                while top >= 0:
                    p = where[top]
                    s = ((value[q] + q * q) - (value[p] + p * p)) / (2.0 * (q - p))
                    if s > edge[top]:
                        break
                    top -= 1
                    s = -np.inf
                top += 1
                where[top] = q
                edge[top] = s
                edge[top + 1] = np.inf
            k = 0
            for q in range(length):
                if top < 0:
                    far = np.inf
                else:
                    while edge[k + 1] < q:
                        k += 1
                    far = (q - where[k]) ** 2 + value[where[k]]
                if axis == 0:
                    out[q, line] = far
                else:
                    out[line, q] = far
    return out
