"""How an intensity on a grid moves with its targets, which turn back at the grid's ends and at walls.

The integral of the interpolant (`estimator.grid.node_volumes`) is kept exactly, nothing becomes negative, and
what is the same everywhere in the free space stays so. A step over a wall thinner than the step is possible.

- Random walk: the heat equation with reflecting ends, solved exactly in time on the nodes. Its operator, the
  second difference with half cells at the ends, has the eigenvectors cos(pi j k / (g - 1)).
- Nearly constant velocity: the velocity of each target is taken as -s or +s on every axis, s the standard
  deviation of a new target's velocity: the two-point rule, true to mean and variance. The 2^d parts then only
  shift, by whole cells, as soon as their targets have come that far: no numerical diffusion. Real targets
  have many speeds and lose all order within the time of a crossing; two speeds alone would come back to it,
  so targets draw a new direction with the rate at which they cross the area. Noise in the velocity is left
  out: it mixes sooner and spreads further, which about cancels (tests/estimator/test_diffusion.py simulates).
"""

from functools import lru_cache

import numpy as np

from estimator.arrays import BoolArray, FloatArray


def blurred(
    values: FloatArray, spacings: FloatArray, variance: float, free: BoolArray | None = None
) -> FloatArray:
    """Values (g1, ..., gd) after normal steps of `variance` (m^2, every axis) of everything in them.

    spacings (d,) are the distances of neighbouring nodes, metres. A step to a node that is not `free`
    (g1, ..., gd) is not taken.
    """
    later = _smoothed(values, spacings, variance)
    if free is None:
        return later
    return np.asarray(free * later + values * (1.0 - _smoothed(free.astype(np.float64), spacings, variance)))


def _smoothed(values: FloatArray, spacings: FloatArray, variance: float) -> FloatArray:
    for axis, spacing in enumerate(spacings):
        if values.shape[axis] > 1 and spacing > 0.0:
            smoothing = _smoothing(values.shape[axis], variance / spacing**2)
            values = np.moveaxis(np.tensordot(smoothing, values, axes=(1, axis)), 0, axis)
    return np.ascontiguousarray(values)


@lru_cache(maxsize=64)
def _smoothing(count: int, variance: float) -> FloatArray:
    """The matrix (count, count) of one axis, for a variance in squared distances of nodes."""
    last = count - 1
    order = np.arange(count)
    cosines = np.cos(np.pi * np.outer(order, order) / last)
    rates = 2.0 * np.sin(0.5 * np.pi * order / last) ** 2  # half the negative eigenvalue
    ends = np.ones(count)
    ends[[0, -1]] = 0.5
    inverse = (2.0 / last) * ends[:, None] * cosines * ends[None, :]
    # What is negative here is rounding.
    matrix = np.maximum((cosines * np.exp(-variance * rates)) @ inverse, 0.0)
    matrix /= (ends @ matrix / ends)[None, :]  # so that rounding does not change the mass
    matrix.flags.writeable = False
    return matrix


def parted(values: FloatArray) -> FloatArray:
    """The 2^d parts (2, ..., 2, g1, ..., gd) of values (g1, ..., gd), one per sign of each velocity.

    Index 0 moves towards the low end of its axis, 1 towards the high end.
    """
    d = values.ndim
    return np.ascontiguousarray(np.broadcast_to(values / 2.0**d, (2,) * d + values.shape))


def shifted(parts: FloatArray, cells: tuple[int, ...], free: BoolArray | None = None) -> FloatArray:
    """The parts after `cells` (d,) whole cells on every axis.

    What would end on a node that is not `free` (g1, ..., gd) stays and turns back.
    """
    d = len(cells)
    for axis, count in enumerate(cells):
        if count == 0 or parts.shape[d + axis] == 1:
            continue
        later = _turned(parts, d, axis, count)
        if free is not None:
            open_way = _turned(np.broadcast_to(free.astype(np.float64), parts.shape), d, axis, -count)
            later = free * later + np.flip(parts * (1.0 - open_way), axis)
        parts = later
    return np.ascontiguousarray(parts)


def _turned(parts: FloatArray, d: int, axis: int, count: int) -> FloatArray:
    """The parts after `count` cells along an axis. Both its directions lie on one ring: up on the way out,
    down on the way back."""
    last = parts.shape[d + axis] - 1
    pair = np.moveaxis(parts, (axis, d + axis), (0, 1))
    ring = np.roll(np.concatenate([pair[1], pair[0][last - 1 : 0 : -1]]), count, axis=0)
    down = np.concatenate([ring[:1], ring[: last - 1 : -1]])
    return np.moveaxis(np.stack([down, ring[: last + 1]]), (0, 1), (axis, d + axis))


def exchanged(parts: FloatArray, share: float) -> FloatArray:
    """The parts after a `share` of 0..1 of their targets has drawn a new velocity."""
    d = parts.ndim // 2
    mean = parts.mean(axis=tuple(range(d)))
    return np.asarray((1.0 - share) * parts + share * mean)
