"""Value iteration on a grid of cells: moves to neighbours, diagonally too, each at its length."""

import itertools

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel
from planner.plan import Ground


def neighbours(shape: tuple[int, ...], centres: FloatArray, ground: Ground | None) -> IntArray:
    """(cells, 3^d - 1) numbers of the cells that can be moved to from each, -1 where that is not possible.

    Args:
        shape: cells per axis.
        centres: (d, cells) m, in C order.
        ground: centres must be clear, and so must be the straight ways between them.
    """
    d, cells = centres.shape
    index = np.stack(np.unravel_index(np.arange(cells), shape))
    free = np.ones(cells, dtype=np.bool_) if ground is None else ground.clear(centres)
    columns = []
    for move in itertools.product((-1, 0, 1), repeat=d):
        if not any(move):
            continue
        to = index + np.array(move)[:, None]
        possible = ((to >= 0) & (to < np.array(shape)[:, None])).all(axis=0) & free
        number = np.where(possible, np.ravel_multi_index(tuple(to), shape, mode="clip"), -1)
        possible &= free[number]
        if ground is not None and possible.any():
            here, there = centres[:, possible], centres[:, number[possible]]
            possible[possible] = ground.segments_clear(
                np.ascontiguousarray(here), np.ascontiguousarray(there)
            )
        columns.append(np.where(possible, number, -1))
    return np.ascontiguousarray(np.stack(columns, axis=1))


@kernel
def values(moves: IntArray, lengths: FloatArray, goal: int, sweeps: int) -> FloatArray:
    """Metres (cells,) of the least way to the goal, infinite where there is none.

    Gauss-Seidel sweeps, forwards and backwards in turn, until nothing changes.

    Args:
        moves: (cells, k) as of `neighbours`.
        lengths: (cells, k) m of each move.
        goal: its cell.
        sweeps: at most.
    """
    cells = moves.shape[0]
    v = np.full(cells, np.inf)
    v[goal] = 0.0
    for sweep in range(sweeps):
        changed = False
        for step in range(cells):
            i = step if sweep % 2 == 0 else cells - 1 - step
            for k in range(moves.shape[1]):
                to = moves[i, k]
                if to >= 0 and lengths[i, k] + v[to] < v[i] - 1e-12:
                    v[i] = lengths[i, k] + v[to]
                    changed = True
        if not changed:
            break
    return v
