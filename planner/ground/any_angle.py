"""Shortest ways over a grid at any angle: Lazy Theta* from one place, to one goal or to everywhere.

A cell is reached straight from the corner before it where the line between them is open, not by steps to its
neighbours (Nash, Koenig, Tovey, "Lazy Theta*: Any-Angle Path Planning and Path Length Analysis in 3D", AAAI
2010); one line is asked about per cell that is expanded. With a goal the search is A* with the straight
distance ahead as its guide; without one it goes on until every cell that can be reached has its distance.

Open cells wait in buckets of half a cell's width of estimated length rather than in a heap: a bucket's order
is within what the grid can tell apart, and putting in and taking out take no search.
"""

import numpy as np

from estimator.arrays import BoolArray, FlagArray, FloatArray, ShortArray
from estimator.kernels import exact_kernel
from planner.ground.walk import open_way

BUCKETS = 64
SOURCE = -1  # a cell's corner before it is the place where the ways begin
UNREACHED = -2


@exact_kernel
def search(
    clearance: FlagArray,
    sides: FloatArray,
    source: FloatArray,
    goal: FloatArray,
    directed: bool,
    lengths: FloatArray,
    corners: ShortArray,
) -> int:
    """Fill `lengths` (metres) and `corners` (the cell before, or SOURCE) of flat cells, in place.

    Args:
        clearance: (l, r, c), 0 where blocked.
        sides: (2,) metres of a cell along rows and columns, and of a layer.
        source, goal: (3,) cell coordinates (column, row, layer) in free cells.
        directed: stop as soon as the goal's cell is reached.

    Returns the goal's flat cell, or -1 if it was not reached.
    """
    layers, rows, columns = clearance.shape
    flat_goal = (int(goal[2]) * rows + int(goal[1])) * columns + int(goal[0])
    lengths[:] = np.inf
    corners[:] = UNREACHED
    closed = np.zeros(lengths.size, np.bool_)
    head = np.full(BUCKETS, -1, np.int32)
    entries = np.empty((1024, 2), np.int32)  # a cell, the next entry of its bucket
    used, spare, waiting = 0, -1, 0
    width = 0.5 * min(sides[0], sides[1]) if layers > 1 else 0.5 * sides[0]
    zs = 1 if layers > 1 else 0

    i, j, k = int(source[0]), int(source[1]), int(source[2])
    first = (k * rows + j) * columns + i
    lengths[first] = _gap(sides, source, i + 0.5, j + 0.5, k + 0.5)
    corners[first] = SOURCE
    ahead = _gap(sides, goal, i + 0.5, j + 0.5, k + 0.5) if directed else 0.0
    current = int((lengths[first] + ahead) / width)
    entries[0, 0], entries[0, 1] = first, -1
    head[current % BUCKETS] = 0
    used, waiting = 1, 1
    at = np.empty(3)
    while waiting > 0:
        slot = current % BUCKETS
        entry = head[slot]
        if entry < 0:
            current += 1
            continue
        head[slot] = entries[entry, 1]
        cell = entries[entry, 0]
        entries[entry, 1] = spare
        spare = entry
        waiting -= 1
        if closed[cell]:
            continue
        closed[cell] = True
        i, j, k = cell % columns, (cell // columns) % rows, cell // (columns * rows)
        _corner(corners[cell], source, rows, columns, at)
        if not open_way(clearance, at[0], at[1], at[2], i + 0.5, j + 0.5, k + 0.5):
            # The lazy guess was wrong: go by the best neighbour instead.
            best, before = np.inf, UNREACHED
            for dk in range(-zs, zs + 1):
                for dj in range(-1, 2):
                    for di in range(-1, 2):
                        if not _step(clearance, i, j, k, di, dj, dk):
                            continue
                        other = ((k + dk) * rows + j + dj) * columns + i + di
                        if closed[other] and other != cell:
                            length = lengths[other] + _long(sides, di, dj, dk)
                            if length < best:
                                best, before = length, other
            lengths[cell], corners[cell] = best, before
            if before == UNREACHED:
                continue
            _corner(before, source, rows, columns, at)
        if directed and cell == flat_goal:
            return int(flat_goal)
        base = lengths[cell] - _gap(sides, at, i + 0.5, j + 0.5, k + 0.5)
        for dk in range(-zs, zs + 1):
            for dj in range(-1, 2):
                for di in range(-1, 2):
                    if not _step(clearance, i, j, k, di, dj, dk):
                        continue
                    other = ((k + dk) * rows + j + dj) * columns + i + di
                    if closed[other]:
                        continue
                    x, y, z = i + di + 0.5, j + dj + 0.5, k + dk + 0.5
                    length = base + _gap(sides, at, x, y, z)
                    if length < lengths[other] - 1e-12:
                        lengths[other], corners[other] = length, corners[cell]
                        ahead = _gap(sides, goal, x, y, z) if directed else 0.0
                        bucket = int((length + ahead) / width)
                        bucket = min(max(bucket, current), current + BUCKETS - 1) % BUCKETS
                        if spare >= 0:
                            entry, spare = spare, entries[spare, 1]
                        else:
                            if used == entries.shape[0]:
                                more = np.empty((2 * used, 2), np.int32)
                                more[:used] = entries
                                entries = more
                            entry = used
                            used += 1
                        entries[entry, 0], entries[entry, 1] = other, head[bucket]
                        head[bucket] = entry
                        waiting += 1
    if not directed:
        return int(flat_goal) if closed[flat_goal] else -1
    return -1


@exact_kernel
def _gap(sides: FloatArray, place: FloatArray, u: float, v: float, w: float) -> float:
    """Metres between two places in cell coordinates."""
    a, b, c = (u - place[0]) * sides[0], (v - place[1]) * sides[0], (w - place[2]) * sides[1]
    return float(np.sqrt(a * a + b * b + c * c))


@exact_kernel
def _long(sides: FloatArray, di: int, dj: int, dk: int) -> float:
    a, c = sides[0], sides[1]
    return float(np.sqrt((di * di + dj * dj) * a * a + dk * dk * c * c))


@exact_kernel
def _corner(cell: int, source: FloatArray, rows: int, columns: int, out: FloatArray) -> None:
    """Where the corner `cell` (or SOURCE) is, in cell coordinates."""
    if cell == SOURCE:
        out[:] = source
    else:
        out[0], out[1] = cell % columns + 0.5, (cell // columns) % rows + 0.5
        out[2] = cell // (columns * rows) + 0.5


@exact_kernel
def _step(clearance: FlagArray, i: int, j: int, k: int, di: int, dj: int, dk: int) -> bool:
    """Whether one may step to this neighbour: it and all cells that the step touches are free."""
    layers, rows, columns = clearance.shape
    if di == 0 and dj == 0 and dk == 0:
        return False
    if not (0 <= i + di < columns and 0 <= j + dj < rows and 0 <= k + dk < layers):
        return False
    if clearance[k, j, i] > 1:  # nothing near is blocked
        return True
    if clearance[k + dk, j + dj, i + di] == 0:
        return False
    if clearance[k + dk, j + dj, i] == 0 or clearance[k + dk, j, i + di] == 0:
        return False
    if clearance[k, j + dj, i + di] == 0:
        return False
    return bool(clearance[k + dk, j, i] > 0 and clearance[k, j + dj, i] > 0 and clearance[k, j, i + di] > 0)


@exact_kernel
def way_back(
    corners: ShortArray, cell: int, source: FloatArray, shape: tuple[int, int, int], most: int
) -> FloatArray:
    """The corners (3, m) in cell coordinates from the source to a reached cell, its middle included."""
    _, rows, columns = shape
    backwards = np.empty((most, 3))
    count = 0
    while cell >= 0 and count < most - 1:
        _corner(cell, source, rows, columns, backwards[count])
        cell = corners[cell]
        count += 1
    backwards[count] = source
    return backwards[: count + 1][::-1].T.copy()


@exact_kernel
def tightened(clearance: FlagArray, way: FloatArray) -> FloatArray:
    """The way (3, m) without the corners that a straight line may skip."""
    m = way.shape[1]
    keep = np.zeros(m, np.bool_)
    keep[0] = True
    here = 0
    while here < m - 1:
        there = m - 1
        while there > here + 1 and not open_way(
            clearance, way[0, here], way[1, here], way[2, here], way[0, there], way[1, there], way[2, there]
        ):
            there -= 1
        keep[there] = True
        here = there
    out = np.empty((3, np.count_nonzero(keep)))
    n = 0
    for c in range(m):
        if keep[c]:
            out[:, n] = way[:, c]
            n += 1
    return out


@exact_kernel
def lengths_at(
    clearance: FlagArray,
    sides: FloatArray,
    source: FloatArray,
    lengths: FloatArray,
    corners: ShortArray,
    places: FloatArray,
    good: BoolArray,
    out: FloatArray,
) -> None:
    """Metres from the source to places (3, n) in cell coordinates that are `good`; to others infinite.

    The last leg is drawn to the place itself, from the corner before its cell or before a neighbour of it.
    """
    _, rows, columns = clearance.shape
    at = np.empty(3)
    for n in range(out.size):
        out[n] = np.inf
        if not good[n]:
            continue
        u, v, w = places[0, n], places[1, n], places[2, n]
        i, j, k = int(u), int(v), int(w)
        own = (k * rows + j) * columns + i
        if corners[own] == UNREACHED:
            continue
        at[0], at[1], at[2] = i + 0.5, j + 0.5, k + 0.5
        best = lengths[own] + _gap(sides, at, u, v, w)
        if open_way(clearance, source[0], source[1], source[2], u, v, w):
            out[n] = _gap(sides, source, u, v, w)
            continue
        for dj in range(-1, 2):
            for di in range(-1, 2):
                if not (0 <= i + di < columns and 0 <= j + dj < rows):
                    continue
                other = (k * rows + j + dj) * columns + i + di
                before = corners[other]
                if before < 0:
                    continue
                _corner(before, source, rows, columns, at)
                length = lengths[before] + _gap(sides, at, u, v, w)
                if length < best and open_way(clearance, at[0], at[1], at[2], u, v, w):
                    best = length
        out[n] = best
