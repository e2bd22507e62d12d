"""One Monte Carlo path, sampled and scored in the same pass: the hot loop.

Source: Olofsson, Veibäck, Hendeby et al., "Multi-agent informed path planning using the probability
hypothesis density", 2020, sections 4.2 and 5.2. Derived from there, and where it differs:

- The reward is the number of targets that the path is expected to detect, sum over looks of
  p_D * (unobserved before the look). (15e) as printed leaves p_D out, (14c) has it.
- A cell observed n times has v * (1 - p_D)^n left, (9), (15c): a revisit rewards only what is left.
- Points are drawn from what is unobserved when they are drawn, (16): by rejection from the intensity at the
  path's start, so no distribution is ever rebuilt.

What a path left unobserved is kept in one row per cell with the number of the path that wrote it (its
stamp): nothing is cleared between paths, so a step costs the same on any grid. A path is made by its genes:
the points it heads for, in order, and for each whether it goes diagonally first.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import exact_kernel
from planner.sampling.board import MOVES, Board
from planner.sampling.dice import below, shifted

_MOVES = MOVES.copy()
_TRIES = 24  # draws of a point that are rejected before any cell is taken
LEFT, STAMP, VALUE, MISS = 0, 1, 2, 3  # columns of a worksheet


@exact_kernel
def worksheet(b: Board) -> FloatArray:
    """(n, 4) a row per cell in one piece of cache: what is left, whose that is, value, 1 - p_D."""
    work = np.empty((b.values.size, 4))
    for i in range(b.values.size):
        work[i, LEFT] = 0.0
        work[i, STAMP] = -1.0
        work[i, VALUE] = b.values[i]
        work[i, MISS] = 1.0 - b.detection[i]
    return work


@exact_kernel
def drawn(b: Board, work: FloatArray, stamp: float, here: int, x: np.uint64) -> tuple[int, np.uint64]:
    """A cell other than `here` in proportion to what is left unobserved, (16), and the generator's state."""
    n = b.values.size
    for _ in range(_TRIES):
        x = shifted(x)
        i = below(x, n)
        x = shifted(x)
        if np.float64(x >> np.uint64(40)) * 2.0**-24 >= b.odds[i]:
            i = b.other[i]
        if i == here:
            continue
        if work[i, STAMP] == stamp:
            u = np.float64((x >> np.uint64(8)) & np.uint64(0xFFFFFF)) * 2.0**-24
            if u * work[i, VALUE] >= work[i, LEFT]:
                continue
        return i, x
    x = shifted(x)
    i = below(x, n)  # next to nothing is left anywhere else: any cell is as good
    return (i if i != here else (i + 1) % n), x


@exact_kernel
def observed(b: Board, work: FloatArray, stamp: float, cell: int, heading: int) -> float:
    """Targets newly detected by a look from a cell through its footprint."""
    row = cell + (heading * b.values.size if b.headings > 1 else 0)
    gain = 0.0
    for k in range(b.offsets[row], b.offsets[row + 1]):
        i = np.uint64(b.seen[k])
        before = work[i, np.uint64(LEFT if work[i, STAMP] == stamp else VALUE)]
        after = before * (1.0 - b.seen_p[k])
        work[i, LEFT] = after
        work[i, STAMP] = stamp
        gain += before - after
    return gain


@exact_kernel
def run(
    b: Board,
    work: FloatArray,
    stamp: float,
    here: int,
    stride: int,
    count: int,
    heading: int,
    cells: IntArray,
) -> float:
    """Targets newly detected on a straight run of `count` steps from `here`, written to cells (count,)."""
    gain = 0.0
    if b.offsets.size > 1:
        for k in range(count):
            here += stride
            cells[k] = here
            gain += observed(b, work, stamp, here, heading)
        return gain
    for k in range(count):
        here += stride
        cells[k] = here
        i = np.uint64(here)  # numba asks of a signed index whether it counts from the end
        before = work[
            i, np.uint64(LEFT if work[i, STAMP] == stamp else VALUE)
        ]  # not a branch: it is a toss-up
        after = before * work[i, MISS]
        work[i, LEFT] = after
        work[i, STAMP] = stamp
        gain += before - after
    return gain


@exact_kernel
def compass(dx: int, dy: int) -> int:
    """The heading 0..7, counter-clockwise from east in eighths, of a step; 0 for one straight up or down."""
    if dx > 0:
        return 0 if dy == 0 else (1 if dy > 0 else 7)
    if dx < 0:
        return 4 if dy == 0 else (3 if dy > 0 else 5)
    return 6 if dy < 0 else (2 if dy > 0 else 0)


@exact_kernel
def begin(b: Board, work: FloatArray, stamp: float, start: int, cells: IntArray) -> float:
    """The look at the start of a path."""
    cells[0] = start
    if b.offsets.size > 1:
        first = max(b.heading, 0)
        return observed(b, work, stamp, start, compass(_MOVES[first, 0], _MOVES[first, 1]))
    gain = b.values[start] * b.detection[start]
    work[start, LEFT] = b.values[start] - gain
    work[start, STAMP] = stamp
    return float(gain)


@exact_kernel
def free_path(
    b: Board,
    work: FloatArray,
    stamp: float,
    start: int,
    x: np.uint64,
    genes: IntArray,
    known: int,
    cells: IntArray,
) -> tuple[float, int, int]:
    """A path limited by nothing but the border: its reward, how many genes it used, and its looks.

    Args:
        genes: (g,) two times the cell to head for, plus one to go straight before going diagonally. The first
            `known` are taken as they are, the others are drawn and written. After g the path ends.
        cells: (k + 1,) is filled with the cells looked from, the start first.
    """
    steps = cells.size - 1
    plane, depth = b.shape[1] * b.shape[2], b.shape[2]
    reward = begin(b, work, stamp, start, cells)
    here, done, legs = start, 0, 0
    while done < steps and legs < genes.size:
        if legs >= known:
            target, x = drawn(b, work, stamp, here, x)
            genes[legs] = 2 * target + np.int64((x >> np.uint64(5)) & np.uint64(1))
        target, straight_first = genes[legs] >> 1, genes[legs] & 1
        legs += 1
        if target == here:
            continue
        dx = target // plane - here // plane
        dy = target % plane // depth - here % plane // depth
        dz = target % depth - here % depth
        ax, ay, az = abs(dx), abs(dy), abs(dz)
        most = max(ax, ay, az)
        least = min(ax, ay, az)
        middle = ax + ay + az - most - least
        for part in range(3):
            which = 2 - part if straight_first else part
            low = 0 if which == 0 else (least if which == 1 else middle)
            high = least if which == 0 else (middle if which == 1 else most)
            count = min(high - low, steps - done)
            if count <= 0:
                continue
            mx = (1 if dx > 0 else -1) if ax > low else 0
            my = (1 if dy > 0 else -1) if ay > low else 0
            mz = (1 if dz > 0 else -1) if az > low else 0
            stride = mx * plane + my * depth + mz
            reward += run(
                b, work, stamp, here, stride, count, compass(mx, my), cells[done + 1 : done + 1 + count]
            )
            here += stride * count
            done += count
    return reward, legs, done + 1


@exact_kernel
def gap(b: Board, cell: int, target: int) -> float:
    """Steps to the target; among equals the nearer in metres counts for less."""
    plane, depth = b.shape[1] * b.shape[2], b.shape[2]
    dx = abs(cell // plane - target // plane)
    dy = abs(cell % plane // depth - target % plane // depth)
    dz = abs(cell % depth - target % depth)
    hops = np.float64(max(dx, dy, dz))
    if b.hops.size > 0:
        hops = np.float64(b.hops[target, cell])
    return float(hops + 1e-4 * np.sqrt(np.float64(dx * dx + dy * dy + dz * dz)))


@exact_kernel
def onward(b: Board, cell: int, move: int) -> bool:
    """Whether any move may follow `move` from a cell."""
    for m in range(26):  # noqa: SIM110 - a kernel
        if (b.open[cell] >> np.uint32(m)) & np.uint32(1) and b.turns[move, m]:
            return True
    return False


@exact_kernel
def bound_path(
    b: Board,
    work: FloatArray,
    stamp: float,
    start: int,
    x: np.uint64,
    genes: IntArray,
    known: int,
    cells: IntArray,
) -> tuple[float, int, int]:
    """As `free_path`, where moves are forbidden by obstacles, fences and turn limits.

    Each step is the allowed one that comes nearest to the point; a step from which none is allowed is the
    last choice. A point that cannot be reached, or is circled, is given up. Where no step is allowed the path
    ends: fewer looks than cells.
    """
    steps = cells.size - 1
    plane, depth = b.shape[1] * b.shape[2], b.shape[2]
    reward = begin(b, work, stamp, start, cells)
    here, done, legs, heading = start, 0, 0, b.heading
    while done < steps and legs < genes.size:
        if legs >= known:
            target, x = drawn(b, work, stamp, here, x)
            genes[legs] = 2 * target
        target = genes[legs] >> 1
        legs += 1
        patience = 2.0 * gap(b, here, target) + 4.0
        if target == here or patience > 2.0**32:  # a target that there is no way to
            continue
        walked = 0
        while here != target and done < steps and walked < patience:
            best, least = -1, np.inf
            for m in range(26):
                if not ((b.open[here] >> np.uint32(m)) & np.uint32(1)):
                    continue
                if heading >= 0 and not b.turns[heading, m]:
                    continue
                near = here + _MOVES[m, 0] * plane + _MOVES[m, 1] * depth + _MOVES[m, 2]
                far = gap(b, near, target)
                if not onward(b, near, m):
                    far += 1e12
                if far < least:
                    best, least = m, far
            if best < 0:
                return reward, legs, done + 1
            here += _MOVES[best, 0] * plane + _MOVES[best, 1] * depth + _MOVES[best, 2]
            heading = best
            done += 1
            walked += 1
            cells[done] = here
            if b.offsets.size > 1:
                reward += observed(b, work, stamp, here, compass(_MOVES[best, 0], _MOVES[best, 1]))
            else:
                before = work[here, LEFT] if work[here, STAMP] == stamp else work[here, VALUE]
                after = before * work[here, MISS]
                work[here, LEFT] = after
                work[here, STAMP] = stamp
                reward += before - after
    return reward, legs, done + 1
