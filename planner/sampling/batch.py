"""A batch of Monte Carlo paths (see `paths`), bred from earlier ones or drawn anew, and the greedy path.

Source: Olofsson et al. 2020, sections 4.2 and 5.2.
"""

import numpy as np

from estimator.arrays import IntArray
from estimator.kernels import exact_kernel
from planner.sampling.board import Board
from planner.sampling.dice import below, scrambled, shifted
from planner.sampling.paths import LEFT, STAMP, VALUE, begin, bound_path, free_path, worksheet


@exact_kernel
def bred(
    b: Board, parents: IntArray, lengths: IntArray, mutation: float, x: np.uint64, genes: IntArray
) -> tuple[int, np.uint64]:
    """Genes of a child: the beginning of one parent, the end of another, and a point drawn anew."""
    x = shifted(x)
    one = below(x, lengths.size)
    x = shifted(x)
    two = below(x, lengths.size)
    x = shifted(x)
    cut = below(x, lengths[one] + 1)
    known = cut
    genes[:cut] = parents[one, :cut]
    for k in range(cut, lengths[two]):
        genes[k] = parents[two, k]
        known = k + 1
    x = shifted(x)
    if known > 0 and np.float64(x >> np.uint64(11)) * 2.0**-53 < mutation:
        x = shifted(x)
        place = below(x, known)
        x = shifted(x)
        i = below(x, b.values.size)
        x = shifted(x)
        if np.float64(x >> np.uint64(40)) * 2.0**-24 >= b.odds[i]:
            i = b.other[i]
        genes[place] = 2 * i + np.int64(x & np.uint64(1))
    return known, x


@exact_kernel
def sample_paths(
    b: Board,
    start: int,
    seed: int,
    first: int,
    count: int,
    parents: IntArray,
    lengths: IntArray,
    mutation: float,
    cells: IntArray,
    genes: IntArray,
) -> tuple[float, int, int]:
    """The best of paths number first..first + count - 1: its reward, and how many genes and looks it has.

    Every path has a generator of its own: what path i is does not depend on how batches are cut.

    Args:
        parents: (p, g) genes of paths to breed from, with `lengths` (p,); none: all points are drawn.
        mutation: the chance that one point of a child is drawn anew.
        cells: (k + 1,) receives the best path's cells.
        genes: (g,) receives its genes, g > k.
    """
    work = worksheet(b)
    path, made = np.empty_like(cells), np.empty_like(genes)
    best, best_legs, best_looks = -1.0, 0, 0
    for i in range(count):
        x = scrambled(scrambled(np.uint64(seed)) + np.uint64(first + i))
        known = 0
        if lengths.size > 0:
            known, x = bred(b, parents, lengths, mutation, x, made)
        if b.open.size > 0:
            reward, legs, looks = bound_path(b, work, np.float64(i), start, x, made, known, path)
        else:
            reward, legs, looks = free_path(b, work, np.float64(i), start, x, made, known, path)
        if reward > best:
            best, best_legs, best_looks = reward, legs, looks
            cells[:looks] = path[:looks]
            genes[:legs] = made[:legs]
    return best, best_legs, best_looks


@exact_kernel
def greedy_path(b: Board, start: int, cells: IntArray, genes: IntArray) -> tuple[float, int, int]:
    """Always to the cell with most unobserved, section 5.2; the first in storage among equals, as there.

    Points on the way are not counted as observed until they are; arguments and results as of `sample_paths`.
    """
    work = worksheet(b)
    known, looks = 0, 1
    zero = np.uint64(1)
    steps = cells.size - 1
    here = start
    reward = begin(b, work, 0.0, start, cells)
    while known < genes.size and looks <= steps:
        top, target = -1.0, -1
        for i in range(b.values.size):
            left = work[i, LEFT] if work[i, STAMP] == np.float64(known) else work[i, VALUE]
            if i != here and left > top and (b.hops.size == 0 or b.hops[i, here] < 0xFFFFFFFF):
                top, target = left, i
        if target < 0:
            break
        genes[known] = 2 * target
        known += 1
        looks_before = looks
        if b.open.size > 0:
            reward, _, looks = bound_path(
                b, work, np.float64(known), start, zero, genes[:known], known, cells
            )
        else:
            reward, _, looks = free_path(b, work, np.float64(known), start, zero, genes[:known], known, cells)
        if looks == looks_before:
            break
        here = cells[looks - 1]
    return reward, known, looks
