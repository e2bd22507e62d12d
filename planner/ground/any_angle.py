"""Shortest ways over a grid at any angle: Lazy Theta* from one place, to one goal or to everywhere.

A cell is reached straight from the corner before it where the line between them is open, not by steps to its
neighbours (Nash, Koenig, Tovey, "Lazy Theta*: Any-Angle Path Planning and Path Length Analysis in 3D", AAAI
2010); one line is asked about per cell that is expanded. With a goal the search is A* with the straight
distance ahead as its guide; without one it goes on, as a wave, as far as it is told to.

What makes it fast, none of which changes the result:

* Open cells wait in buckets of half a cell's width of estimated length rather than in a heap, each at most
  once: a bucket's order is within what the grid can tell apart, and lists need no search.
* A neighbour that is already reached from the same corner is not looked at again: the length is the same.
* On one layer, a line to a cell is open if those from the same corner to the two cells that it passes
  between just before are (`_between_open`); most lines need not be followed.
"""

import numpy as np

from estimator.arrays import BoolArray, FlagArray, FloatArray, IntArray, ShortArray
from estimator.kernels import exact_kernel
from planner.ground.walk import open_way

BUCKETS = 64
SOURCE = -1  # a cell's corner before it is the place where the ways begin
UNREACHED = -2
CURRENT, WAITING, ARRIVED = 0, 1, 2  # of `marks`: the bucket that is worked on, cells in buckets, at the goal


def moves_of(layers: int) -> ShortArray:
    """Steps (m, 3) to the neighbours, along columns, rows and layers: 8 of them, or 26."""
    up = (-1, 0, 1) if layers > 1 else (0,)
    return np.array(
        [(i, j, k) for k in up for j in (-1, 0, 1) for i in (-1, 0, 1) if (i, j, k) != (0, 0, 0)], np.int32
    )


@exact_kernel
def allowed_steps(clearance: FlagArray, moves: ShortArray, out: ShortArray) -> None:
    """Bits of `out` (cells,): the moves from each cell of clearance (l, r, c) that touch free cells only."""
    _, rows, columns = clearance.shape
    for cell in range(out.size):
        i, j, k = cell % columns, (cell // columns) % rows, cell // (columns * rows)
        bits = 0
        if clearance[k, j, i] > 0:
            for m in range(len(moves)):
                if _step(clearance, i, j, k, moves[m, 0], moves[m, 1], moves[m, 2]):
                    bits |= 1 << m
        out[cell] = bits


@exact_kernel
def _step(clearance: FlagArray, i: int, j: int, k: int, di: int, dj: int, dk: int) -> bool:
    """Whether one may step from a free cell to this neighbour: it and all cells that the step touches are."""
    layers, rows, columns = clearance.shape
    if not (0 <= i + di < columns and 0 <= j + dj < rows and 0 <= k + dk < layers):
        return False
    if clearance[k, j, i] > 1:  # nothing near is blocked
        return True
    for c in range(2 if dk != 0 else 1):
        for b in range(2 if dj != 0 else 1):
            for a in range(2 if di != 0 else 1):
                if clearance[k + c * dk, j + b * dj, i + a * di] == 0:
                    return False
    return True


@exact_kernel
def spread(
    clearance: FlagArray,
    sides: FloatArray,
    moves: ShortArray,
    steps: ShortArray,
    source: FloatArray,
    goal: FloatArray,
    directed: bool,
    until: float,
    most: int,
    lengths: FloatArray,
    corners: ShortArray,
    closed: BoolArray,
    after: ShortArray,
    before: ShortArray,
    heads: ShortArray,
    marks: IntArray,
) -> None:
    """Begin a search or go on with it, in place: until cells are `until` metres away, `most` cells at a time.

    Args:
        clearance: (l, r, c), 0 where blocked.
        sides: (2,) metres of a cell along rows and columns, and of a layer.
        moves, steps: of `moves_of` and `allowed_steps`.
        source, goal: (3,) cell coordinates (column, row, layer) in free cells; a goal only if `directed`.
        lengths: (cells,) metres, infinite at first.
        corners: (cells,) the cell before, or SOURCE; UNREACHED at first.
        closed: (cells,) whether the cell's length is final; False at first.
        after, before: (cells,) its neighbours in its bucket; below 0 no cell, `before` then says the bucket.
        heads: (BUCKETS,) the first cell of each, -1 where it is empty, as at first.
        marks: (3,), 0 at first.
    """
    layers, rows, columns = clearance.shape
    flat, side, high = layers == 1, sides[0], sides[1]
    free = clearance.reshape(-1)
    width = 0.5 * side if flat else 0.5 * min(side, high)
    current, waiting = marks[CURRENT], marks[WAITING]
    us, vs, ws = source[0], source[1], source[2]
    ug, vg, wg = goal[0], goal[1], goal[2]
    jumps, shifts = np.empty(len(moves), np.int64), np.empty((len(moves), 3))
    for m in range(len(moves)):
        jumps[m] = (moves[m, 2] * rows + moves[m, 1]) * columns + moves[m, 0]
        shifts[m] = moves[m]
    last = (int(wg) * rows + int(vg)) * columns + int(ug) if directed else -1
    first = (int(ws) * rows + int(vs)) * columns + int(us)
    if corners[first] == UNREACHED:
        u, v, w = int(us) + 0.5, int(vs) + 0.5, int(ws) + 0.5
        lengths[first] = gap(side, high, us, vs, ws, u, v, w)
        corners[first] = SOURCE
        ahead = gap(side, high, ug, vg, wg, u, v, w) if directed else 0.0
        current = int((lengths[first] + ahead) / width)
        slot = current % BUCKETS
        heads[slot], after[first], before[first] = first, -1, -1 - slot
        waiting = 1
    while waiting > 0 and most > 0:
        slot = current % BUCKETS
        cell = heads[slot]
        if cell < 0:
            current += 1
            if current * width > until:
                break
            continue
        following = after[cell]
        heads[slot] = following
        if following >= 0:
            before[following] = -1 - slot
        waiting -= 1
        most -= 1
        closed[cell] = True
        line, i = cell // columns, cell % columns
        k, j = (0, line) if flat else (line // rows, line % rows)
        corner = corners[cell]
        u, v, w = us, vs, ws
        if corner >= 0:
            line = corner // columns
            u, v, w = corner % columns + 0.5, (line if flat else line % rows) + 0.5, line // rows + 0.5
        known = False
        if flat:
            # The line passes between the middles of two cells that share a side, one step nearer to the
            # corner. If the lines from the corner to both are open, so is it: what is blocked is made of
            # squares of a cell's width, and the two lines are nowhere farther apart than that.
            du, dv = i + 0.5 - u, j + 0.5 - v
            su, sv = (1 if du > 0.0 else -1), (columns if dv > 0.0 else -columns)
            wide = abs(du) >= abs(dv)
            straight, aside = cell - (su if wide else sv), cell - su - sv
            if max(abs(du), abs(dv)) >= 1.0 and closed[straight] and corners[straight] == corner:
                if du == 0.0 or dv == 0.0:
                    known = True
                elif closed[aside] and corners[aside] == corner:
                    known = abs(du) != abs(dv) or (free[cell - su] > 0 and free[cell - sv] > 0)
        if not known and not open_way(clearance, u, v, w, i + 0.5, j + 0.5, k + 0.5):
            # The lazy guess was wrong: go by the best neighbour instead.
            best, corner = np.inf, UNREACHED
            for m in range(len(moves)):
                other = cell + jumps[m]
                if steps[cell] >> m & 1 and closed[other]:
                    along = gap(side, high, 0.0, 0.0, 0.0, moves[m, 0], moves[m, 1], moves[m, 2])
                    if lengths[other] + along < best:
                        best, corner = lengths[other] + along, other
            lengths[cell], corners[cell] = best, corner
            if corner == UNREACHED:
                continue
            line = corner // columns
            u, v, w = corner % columns + 0.5, (line if flat else line % rows) + 0.5, line // rows + 0.5
        if cell == last:
            marks[ARRIVED] = 1
            break
        base = lengths[corner] if corner >= 0 else 0.0
        allowed = steps[cell]
        for m in range(len(moves)):
            if not allowed >> m & 1:
                continue
            other = cell + jumps[m]
            if corners[other] == corner or closed[other]:
                continue
            x, y, z = i + 0.5 + shifts[m, 0], j + 0.5 + shifts[m, 1], k + 0.5 + shifts[m, 2]
            length = base + gap(side, high, u, v, w, x, y, z)
            if length < lengths[other] - 1e-12:
                if corners[other] == UNREACHED:
                    waiting += 1
                else:  # it waits in another bucket
                    following, previous = after[other], before[other]
                    if previous >= 0:
                        after[previous] = following
                    else:
                        heads[-1 - previous] = following
                    if following >= 0:
                        before[following] = previous
                lengths[other], corners[other] = length, corner
                ahead = gap(side, high, ug, vg, wg, x, y, z) if directed else 0.0
                slot = min(max(int((length + ahead) / width), current), current + BUCKETS - 1) % BUCKETS
                following = heads[slot]
                if following >= 0:
                    before[following] = other
                heads[slot], after[other], before[other] = other, following, -1 - slot
    marks[CURRENT], marks[WAITING] = current, waiting


@exact_kernel
def gap(side: float, high: float, u: float, v: float, w: float, x: float, y: float, z: float) -> float:
    """Metres between two places in cell coordinates."""
    a, b, c = (x - u) * side, (y - v) * side, (z - w) * high
    return float(np.sqrt(a * a + b * b + c * c))
