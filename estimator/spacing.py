"""Where targets are never nearer to each other than a spacing: at most one of them is in any small ball.

A PHD does not know this. It forgets that two measurements at one place, a second apart, were of one target:
with p_D too low for the moment its mass there grows beyond one, and with p_D too high it falls to nothing in
a few misses. Under the prior that targets keep a distance s (a hard-core point process, Matérn 1960) the
number of targets in a ball of diameter s is 0 or 1, so its mean, the intensity's integral, is at most 1.
Bringing an intensity back to this bound lets p_D be chosen for what a miss really says.
"""

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel


def capped(positions: FloatArray, weights: FloatArray, spacing: float) -> FloatArray:
    """Weights (n,) of points (d, n), scaled down where a ball of diameter `spacing` (m) had more than 1.

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
    cells -= cells.min(axis=1, keepdims=True) - 1  # a free cell around all
    strides = np.ones(len(cells), np.int64)
    strides[1:] = np.cumprod(cells.max(axis=1) + 2)[:-1]
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
    done = np.zeros(n, np.bool_)
    centre = np.empty(d)
    for seed in np.argsort(-masses[:count]):
        first = order[starts[seed]]  # its cell's place, from which those of others are counted
        _neighbours(names[seed], names, strides, near)
        size = _gathered(near, starts, order, done, around)
        total = _centred(positions, weights, around[:size], centre)
        if not total > 1.0:
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
    """The indices (3^d,) in `names` of a cell and those around it, -1 where there is none."""
    for k in range(near.size):
        rest, wanted = k, key
        for a in range(strides.size):
            wanted += (rest % 3 - 1) * strides[a]
            rest //= 3
        at = np.searchsorted(names, wanted)
        near[k] = at if at < names.size and names[at] == wanted else -1
