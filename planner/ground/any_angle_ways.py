"""What a search over the grid found out (`any_angle`): the ways back from goals, and how long ways are."""

import numpy as np

from estimator.arrays import BoolArray, FlagArray, FloatArray, IntArray, ShortArray
from estimator.kernels import exact_kernel
from planner.ground.any_angle import SOURCE, UNREACHED, gap
from planner.ground.walk import open_way

NEIGHBOURS = 2.0  # cells, by which one next to a place may be farther than it and still count


@exact_kernel
def place_of(cell: int, source: FloatArray, rows: int, columns: int) -> tuple[float, float, float]:
    """Where the corner `cell` (or SOURCE) is, in cell coordinates."""
    if cell == SOURCE:
        return source[0], source[1], source[2]
    return cell % columns + 0.5, (cell // columns) % rows + 0.5, cell // (columns * rows) + 0.5


@exact_kernel
def ways_back(
    clearance: FlagArray,
    source: FloatArray,
    goals: FloatArray,
    straight: BoolArray,
    corners: ShortArray,
    closed: BoolArray,
    offsets: IntArray,
) -> FloatArray:
    """The corners (3, m) of the ways from the source to goals (3, n), in cell coordinates, one after another.

    Way i is at offsets[i]:offsets[i + 1] (n + 1,), which is filled here: source and goal among its corners,
    without those that a straight line may skip; these two only where it is known that the line between
    them is open, and nothing where neither that is so nor the goal's cell is closed.
    """
    _, rows, columns = clearance.shape
    out, count = np.empty((3, 64)), 0
    offsets[0] = 0
    for g in range(goals.shape[1]):
        offsets[g + 1] = count
        x, y, z = goals[0, g], goals[1, g], goals[2, g]
        cell = (int(z) * rows + int(y)) * columns + int(x)
        many, at = 2, cell  # corners: the cells passed, source and goal
        if not straight[g]:
            if not closed[cell] or corners[cell] == UNREACHED:
                continue
            while at >= 0:
                many += 1
                at = corners[at]
        while count + many > out.shape[1]:
            more = np.empty((3, 2 * out.shape[1]))
            more[:, :count] = out[:, :count]
            out = more
        way = out[:, count : count + many]
        way[:, 0] = source
        way[0, many - 1], way[1, many - 1], way[2, many - 1] = x, y, z
        at = cell
        for n in range(many - 2, 0, -1):
            way[0, n], way[1, n], way[2, n] = place_of(at, source, rows, columns)
            at = corners[at]
        count += _tightened(clearance, way)
        offsets[g + 1] = count
    return out[:, :count].copy()


@exact_kernel
def _tightened(clearance: FlagArray, way: FloatArray) -> int:
    """Move the corners of a way (3, m) that a straight line may not skip to its front; how many they are."""
    m, kept, here = way.shape[1], 1, 0
    while here < m - 1:
        there = m - 1
        while there > here + 1 and not open_way(
            clearance,
            way[0, kept - 1],
            way[1, kept - 1],
            way[2, kept - 1],
            way[0, there],
            way[1, there],
            way[2, there],
        ):
            there -= 1
        way[:, kept] = way[:, there]
        kept += 1
        here = there
    return kept


@exact_kernel
def lengths_at(
    clearance: FlagArray,
    sides: FloatArray,
    source: FloatArray,
    lengths: FloatArray,
    corners: ShortArray,
    closed: BoolArray,
    places: FloatArray,
    good: BoolArray,
    out: FloatArray,
) -> None:
    """Metres from the source to places (3, n) in cell coordinates that are `good`; to others infinite.

    The last leg is drawn to the place itself, from the corner before its cell or before a neighbour of it.
    Cells more than NEIGHBOURS farther than the place's own do not count: a wave may have ended there.
    """
    _, rows, columns = clearance.shape
    side, high = sides[0], sides[1]
    us, vs, ws = source[0], source[1], source[2]
    for n in range(out.size):
        out[n] = np.inf
        if not good[n]:
            continue
        u, v, w = places[0, n], places[1, n], places[2, n]
        i, j, k = int(u), int(v), int(w)
        own = (k * rows + j) * columns + i
        if not closed[own] or corners[own] == UNREACHED:
            continue
        if open_way(clearance, us, vs, ws, u, v, w):
            out[n] = gap(side, high, us, vs, ws, u, v, w)
            continue
        best = lengths[own] + gap(side, high, i + 0.5, j + 0.5, k + 0.5, u, v, w)
        for dj in range(-1, 2):
            for di in range(-1, 2):
                if not (0 <= i + di < columns and 0 <= j + dj < rows):
                    continue
                other = (k * rows + j + dj) * columns + i + di
                before = corners[other]
                if not closed[other] or before < 0 or lengths[other] > lengths[own] + NEIGHBOURS * side:
                    continue
                a, b, c = place_of(before, source, rows, columns)
                length = lengths[before] + gap(side, high, a, b, c, u, v, w)
                if length < best and open_way(clearance, a, b, c, u, v, w):
                    best = length
        out[n] = best
