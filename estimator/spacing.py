"""Where targets are never nearer to each other than a spacing: at most one of them is in any small ball.

A PHD does not know this. It forgets that two measurements at one place, a second apart, were of one target:
with p_D too low for the moment its mass there grows beyond one, and with p_D too high it falls to nothing in
a few misses. Under the prior that targets keep a distance s (a hard-core point process, Matérn 1960) the
number of targets in a ball of diameter s is 0 or 1, so its mean, the intensity's integral, is at most 1. And
where a ball holds a target with probability m > 1/2, one nearer than s to it exists with at most 1 - m: else
sightings that err a little more than usual leave companions around each target. Bringing an intensity back to
these bounds lets p_D be chosen for what a miss really says.
"""

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel

WIDE = 2  # cells of half the spacing that the spacing itself spans
_SURE = 0.5  # mass of a ball from which it rather holds a target than not
_DOUBT = 1e-6  # what even a certain target leaves to its surroundings: no place is ruled out for ever


def capped(positions: FloatArray, weights: FloatArray, spacing: float) -> FloatArray:
    """Weights (n,) of points (d, n), scaled down where a ball of diameter `spacing` (m) had more than 1, and
    around balls of more than 1/2 to what these leave room for.

    Balls are laid around the heaviest places first, each point is in one of them at most.

    Raises:
        ValueError: if spacing is not positive and finite.
    """
    if not 0.0 < spacing < np.inf:
        raise ValueError(f"spacing: expected a positive finite number, got {spacing}")
    if not weights.sum() > 1.0:
        return weights
    side = 0.5 * spacing
    cells = np.floor(positions / side).astype(np.int64)
    cells -= cells.min(axis=1, keepdims=True) - WIDE  # free cells around all
    strides = np.ones(len(cells), np.int64)
    strides[1:] = np.cumprod(cells.max(axis=1) + WIDE + 1)[:-1]
    keys = strides @ cells
    order = np.argsort(keys, kind="stable")
    out = weights.copy()
    _cap(np.ascontiguousarray(positions), out, keys, order, strides, side)
    return out


@kernel
def _cap(
    positions: FloatArray,
    weights: FloatArray,
    keys: IntArray,
    order: IntArray,
    strides: IntArray,
    side: float,
) -> None:
    d, n = positions.shape
    starts, names, masses = np.empty(n + 1, np.int64), np.empty(n, np.int64), np.zeros(n)
    count = 0
    for t in range(n):
        key = keys[order[t]]
        if count == 0 or key != names[count - 1]:
            names[count], starts[count] = key, t
            count += 1
        masses[count - 1] += weights[order[t]]
    starts[count] = n
    names = names[:count]
    near, around = np.empty(3**d, np.int64), np.empty(n, np.int64)
    wide = np.empty((2 * WIDE + 1) ** d, np.int64)
    done = np.zeros(n, np.bool_)
    centre = np.empty(d)
    for seed in np.argsort(-masses[:count]):
        first = order[starts[seed]]  # its cell's place, from which those of others are counted
        _neighbours(names[seed], names, strides, near)
        size = _gathered(near, starts, order, done, around)
        total = _centred(positions, weights, around[:size], centre)
        if not total > _SURE:
            continue
        for turn in range(3):  # the ball goes to the mean of what is in it, twice
            key = names[seed]
            for a in range(d):
                key += strides[a] * np.int64(
                    np.floor(centre[a] / side) - np.floor(positions[a, first] / side)
                )
            _neighbours(key, names, strides, near)
            size = _gathered(near, starts, order, done, around)
            kept = 0
            for t in range(size):
                if _square(positions, around[t], centre) < side * side:
                    around[kept] = around[t]
                    kept += 1
            if turn < 2 and kept > 0:
                _centred(positions, weights, around[:kept], centre)
        total = 0.0
        for t in range(kept):
            total += weights[around[t]]
        for t in range(kept):
            if total > 1.0:
                weights[around[t]] /= total
            done[around[t]] = True
        if not total > _SURE:
            continue
        _neighbours(key, names, strides, wide)
        size = _gathered(wide, starts, order, done, around)
        _hold(positions, weights, around[:size], centre, 2.0 * side, max(1.0 - total, _DOUBT))


@kernel
def _hold(
    positions: FloatArray,
    weights: FloatArray,
    around: IntArray,
    centre: FloatArray,
    reach: float,
    most: float,
) -> None:
    """Scales those of some points down that are within `reach` of a centre, if they have more than `most`."""
    total = 0.0
    for i in around:
        if _square(positions, i, centre) < reach * reach:
            total += weights[i]
    if total > most:
        for i in around:
            if _square(positions, i, centre) < reach * reach:
                weights[i] *= most / total


@kernel
def _gathered(near: IntArray, starts: IntArray, order: IntArray, done: BoolArray, around: IntArray) -> int:
    """Fills in the points of some cells that are in no ball yet; how many."""
    size = 0
    for c in near:
        if c >= 0:
            for t in range(starts[c], starts[c + 1]):
                if not done[order[t]]:
                    around[size] = order[t]
                    size += 1
    return size


@kernel
def _centred(positions: FloatArray, weights: FloatArray, around: IntArray, centre: FloatArray) -> float:
    """Fills in the mean of some points; their mass."""
    total = 0.0
    for i in around:
        total += weights[i]
    if total > 0.0:
        centre[:] = 0.0
        for i in around:
            for a in range(centre.size):
                centre[a] += weights[i] / total * positions[a, i]
    return total


@kernel
def _square(positions: FloatArray, i: int, centre: FloatArray) -> float:
    square = 0.0
    for a in range(centre.size):
        square += (positions[a, i] - centre[a]) ** 2
    return square


@kernel
def _neighbours(key: int, names: IntArray, strides: IntArray, near: IntArray) -> None:
    """The indices (w^d,), w odd, in `names` of a cell and those around it, -1 where there is none."""
    width = round(near.size ** (1.0 / strides.size))
    for k in range(near.size):
        rest, wanted = k, key
        for a in range(strides.size):
            wanted += (rest % width - width // 2) * strides[a]
            rest //= width
        at = np.searchsorted(names, wanted)
        near[k] = at if at < names.size and names[at] == wanted else -1
