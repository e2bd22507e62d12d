"""Super-particles: all particles of a cell as one, in their middle and with their weight.

Dames & Kumar, "Autonomous localization of an unknown number of targets without data association using teams
of mobile sensors", IEEE Transactions on Automation Science and Engineering, 2015, section IV-B.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray

DENSE = 64  # cells per point, up to which ticking them off is faster than telling them apart


def super_particles(points: FloatArray, weights: FloatArray, side: float) -> tuple[FloatArray, FloatArray]:
    """One particle (d, k), (k,) for each cell of side `side` (m) that holds any of points (d, n) with weight.

    Its weight is the sum of the cell's weights (n,), its position their weighted mean: mass and mean of the
    whole are kept.

    Raises:
        ValueError: if side is not positive, or there is not one weight per point.
    """
    if not 0.0 < side < np.inf:
        raise ValueError(f"side: expected a positive number, got {side}")
    if points.ndim != 2 or weights.shape != (points.shape[1],):
        raise ValueError(f"weights: expected one per column of {points.shape}, got {weights.shape}")
    heavy = weights > 0.0
    points, weights = points[:, heavy], weights[heavy]
    if weights.size == 0:
        return np.zeros((points.shape[0], 0)), np.zeros(0)
    cells = _cells(points, side)
    order = np.argsort(cells, kind="stable")
    cells = cells[order]
    starts = np.flatnonzero(np.append(True, cells[1:] != cells[:-1]))
    totals = np.add.reduceat(weights[order], starts)
    means = np.add.reduceat((points * weights)[:, order], starts, axis=1) / totals
    return means, totals


def at_most(points: FloatArray, weights: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    """Super-particles of the smallest cells, in steps of the root of 2, that make at most `size` of them."""
    heavy = weights > 0.0
    points, weights = np.ascontiguousarray(points[:, heavy]), weights[heavy]
    if size < 1 or weights.size == 0:
        return np.zeros((points.shape[0], 0)), np.zeros(0)
    if weights.size <= size:
        return points, weights
    extent = float(np.ptp(points, axis=1).max())
    if extent == 0.0:
        return super_particles(points, weights, 1.0)
    finest = extent / 2.0**20
    low, high = 0, 43  # powers of sqrt(2): `high` makes one cell, or is known to make few enough
    while low < high:
        middle = (low + high) // 2
        if _distinct(_cells(points, finest * 2.0 ** (0.5 * middle))) <= size:
            high = middle
        else:
            low = middle + 1
    return super_particles(points, weights, finest * 2.0 ** (0.5 * high))


def _distinct(cells: IntArray) -> int:
    """How many different numbers, none below 0, there are: of small ones by ticking them off."""
    last = int(cells.max())
    if last > DENSE * cells.size:
        return int(np.unique(cells).size)
    seen = np.zeros(last + 1, dtype=np.bool_)
    seen[cells] = True
    return int(np.count_nonzero(seen))


def _cells(points: FloatArray, side: float) -> IntArray:
    """A number per cell for each of points (d, n); counted from the least coordinates."""
    steps = np.floor((points - points.min(axis=1, keepdims=True)) / side).astype(np.int64)
    number = np.zeros(points.shape[1], np.int64)
    for row in steps:
        number = number * (row.max() + 1) + row
    return number
