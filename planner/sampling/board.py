"""What paths are sampled on: a grid of cells with the targets unobserved in each, and what a look observes.

Olofsson et al. (2020), section 5.1: "unobserved" is the intensity that no committed look has observed yet.
"""

from typing import NamedTuple

import numpy as np

from estimator.arrays import FlagArray, FloatArray, IndexArray, IntArray
from estimator.kernels import exact_kernel

MOVES = np.array(
    [(x, y, z) for z in (0, 1, -1) for x in (-1, 0, 1) for y in (-1, 0, 1) if (x, y, z) != (0, 0, 0)]
)  # (26, 3) steps to neighbours; the first 8 stay at their altitude


class Board(NamedTuple):
    """A grid of n cells and what may be done on it. Cell (x, y, z) is number (x * ny + y) * nz + z.

    A look from a cell observes that cell alone with `detection`, unless there are footprints: then row
    `cell`, or `heading * n + cell` with eight headings, of a sparse matrix says what it observes.
    """

    shape: IntArray  # (3,) cells along x, y, z
    values: FloatArray  # (n,) targets expected and unobserved in each cell, finite and not negative
    detection: FloatArray  # (n,) p_D of a cell observed from itself; unused with footprints
    odds: FloatArray  # (n,) of the alias method: keep cell i if a uniform draw is below odds[i],
    other: IntArray  # (n,) otherwise take this cell
    offsets: IntArray  # (rows + 1,) row r observes seen[offsets[r]:offsets[r + 1]]; (1,) without footprints
    seen: IntArray  # cells
    seen_p: FloatArray  # p_D of each
    headings: int  # 1 or 8
    open: IndexArray  # (n,) bit m: move m may be made from there; (0,) if only the border limits moves
    turns: FlagArray  # (26, 26) whether move b may follow move a
    hops: IndexArray  # (n, n) steps from each cell (column) to each target (row); (0, 0): as a king moves
    heading: int  # move before the first, for its turn; -1: none


def board(
    shape: tuple[int, ...],
    values: FloatArray,
    detection: FloatArray | float = 1.0,
    *,
    footprints: tuple[IntArray, IntArray, FloatArray] | None = None,
    headings: int = 1,
    open_moves: IndexArray | None = None,
    turns: FlagArray | None = None,
    hops: IndexArray | None = None,
    heading: int = -1,
) -> Board:
    """A board of a 2D or 3D grid.

    Args:
        shape: cells per axis, 2 or 3 of them.
        values: (n,) or of that shape; what is not finite or negative counts as nothing.
        detection: p_D of a cell observed from itself, one number or (n,).
        footprints: offsets, cells and p_D of what is observed from each cell; None: the cell itself.
        open_moves: (n,) bits of the moves that may be made; None: the border alone limits moves.
        turns: (26, 26) which move may follow which; None: any.
        hops: (n, n) steps between cells where obstacles stand; None: as a king moves.

    Raises:
        ValueError: naming the argument with a wrong shape.
    """
    size = np.ones(3, dtype=np.int64)
    if len(shape) not in (2, 3) or min(shape) < 1:
        raise ValueError(f"shape: expected 2 or 3 positive numbers of cells, got {shape}")
    size[: len(shape)] = shape
    n = int(size.prod())
    flat = np.array(values, dtype=np.float64).reshape(-1)
    if flat.size != n:
        raise ValueError(f"values: expected {n} numbers, got {flat.size}")
    flat[~(np.isfinite(flat) & (flat > 0))] = 0.0
    p = np.array(np.broadcast_to(np.asarray(detection, dtype=np.float64), (n,)))
    if not ((p >= 0) & (p <= 1)).all():
        raise ValueError("detection: expected probabilities between 0 and 1")
    odds, other = np.empty(n), np.empty(n, dtype=np.int64)
    alias(flat, odds, other)
    constrained = open_moves is not None or turns is not None
    if constrained and open_moves is None:
        open_moves = inside_moves(size)
    rows = footprints or (np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
    return Board(
        size,
        flat,
        p,
        odds,
        other,
        *rows,
        headings,
        np.zeros(0, dtype=np.uint32) if open_moves is None else open_moves,
        np.ones((26, 26), dtype=np.uint8) if turns is None else turns,
        np.zeros((0, 0), dtype=np.uint32) if hops is None else hops,
        heading,
    )


def inside_moves(size: IntArray) -> IndexArray:
    """(n,) bit m says that move m from a cell stays on the grid."""
    places = np.stack(np.unravel_index(np.arange(int(size.prod())), tuple(size)))
    bits = np.zeros(places.shape[1], dtype=np.uint32)
    for m, move in enumerate(MOVES):
        after = places + move[:, None]
        inside = ((after >= 0) & (after < size[:, None])).all(axis=0)
        bits |= inside.astype(np.uint32) << np.uint32(m)
    return bits


def turn_table(limit_deg: float) -> FlagArray:
    """(26, 26) whether the angle between two moves is at most `limit_deg`."""
    unit = MOVES / np.linalg.norm(MOVES, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip(unit @ unit.T, -1.0, 1.0)))
    return np.asarray(angles <= limit_deg + 1e-6, dtype=np.uint8)


@exact_kernel
def alias(weights: FloatArray, odds: FloatArray, other: IntArray) -> None:
    """Vose's tables for draws in proportion to weights (n,); for equal chances if they sum to nothing."""
    n = weights.size
    total = 0.0
    for i in range(n):
        total += weights[i]
    small, large = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    s = l = 0
    for i in range(n):
        odds[i] = weights[i] * n / total if total > 0 else 1.0
        other[i] = i
        if odds[i] < 1.0:
            small[s] = i
            s += 1
        else:
            large[l] = i
            l += 1
    while s > 0 and l > 0:
        s -= 1
        i, j = small[s], large[l - 1]
        other[i] = j
        odds[j] -= 1.0 - odds[i]
        if odds[j] < 1.0:
            l -= 1
            small[s] = j
            s += 1
    for k in range(s):  # left over by rounding, unless they weigh nothing
        if weights[small[k]] > 0:
            odds[small[k]] = 1.0
    for k in range(l):
        odds[large[k]] = 1.0


@exact_kernel
def fill_hops(open_moves: IndexArray, strides: IntArray, first: int, last: int, hops: IndexArray) -> None:
    """Rows first..last of `hops`: fewest moves from every cell to each target; 2^32 - 1 where no way is.

    Moves are taken to be open both ways.
    """
    n = open_moves.size
    queue = np.empty(n, dtype=np.int64)
    nowhere = np.uint32(0xFFFFFFFF)
    for target in range(first, last):
        row = hops[target]
        row[:] = nowhere
        row[target] = 0
        queue[0] = target
        head, tail = 0, 1
        while head < tail:
            cell = queue[head]
            head += 1
            for m in range(strides.size):
                if (open_moves[cell] >> np.uint32(m)) & np.uint32(1):
                    near = cell + strides[m]
                    if row[near] == nowhere:
                        row[near] = row[cell] + np.uint32(1)
                        queue[tail] = near
                        tail += 1


def move_strides(size: IntArray) -> IntArray:
    """(26,) by how much each move changes a cell's number."""
    return np.asarray(MOVES @ np.array([size[1] * size[2], size[2], 1]), dtype=np.int64)
