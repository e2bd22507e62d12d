"""What planned measurements leave unexplored at the grid points that matter, (MA)ASI (21), (32)."""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.exploration import Exploration
from estimator.kernels import kernel
from estimator.sensor import SensorModel
from planner.commitments import SAME_INSTANT, Looks

BATCH = 1_000_000  # detection probabilities held at once: 8 MB
CALL = 30_000  # detection probabilities worth a call of their own; fewer measurements a call touch less


def cell_corners(exploration: Exploration, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The corners (d, n * 2^d) of the cells around points (n, d), and the share (n * 2^d,) of each.

    The shares of a point add up to e there, by multilinear interpolation; outside the grid, to e at the
    nearest place inside.
    """
    values = exploration.values
    count = points.shape[0] << values.ndim
    corners, weights, index = np.empty((values.ndim, count)), np.empty(count), np.empty(count, dtype=np.int64)
    shape = np.array(values.shape, dtype=np.int64)
    low, high = np.array(exploration.low), np.array(exploration.high)
    _cell_corners(shape, low, high, np.ascontiguousarray(points), corners, weights, index)
    return corners, weights * values.ravel()[index]


@kernel
def _cell_corners(
    shape: IntArray,
    low: FloatArray,
    high: FloatArray,
    points: FloatArray,
    corners: FloatArray,
    weights: FloatArray,
    index: IntArray,
) -> None:
    d = shape.size
    node = np.zeros(d, dtype=np.int64)
    share = np.zeros(d)
    for i in range(points.shape[0]):
        for a in range(d):
            node[a], share[a] = 0, 0.0
            if shape[a] > 1 and high[a] > low[a]:
                u = (points[i, a] - low[a]) / (high[a] - low[a]) * (shape[a] - 1)
                u = min(max(u, 0.0), shape[a] - 1.0)
                node[a] = min(int(u), shape[a] - 2)
                share[a] = u - node[a]
        for corner in range(1 << d):
            column = (i << d) + corner
            index[column] = 0
            weights[column] = 1.0
            for a in range(d):
                up = (corner >> a) & 1
                n = min(node[a] + up, shape[a] - 1)
                index[column] = index[column] * shape[a] + n
                weights[column] *= share[a] if up else 1.0 - share[a]
                corners[a, column] = low[a]
                if shape[a] > 1:
                    corners[a, column] += (high[a] - low[a]) * n / (shape[a] - 1)


def explore(
    sensor: SensorModel, looks: Looks, times: FloatArray, corners: FloatArray, shares: FloatArray
) -> None:
    """Take from the shares what one robot's measurements explore, in place, (32).

    Args:
        sensor: of the robot that measures.
        looks: its measurements; each counts at corners of the same time or later.
        times: (n,) when each corner is looked at, in growing order.
        corners: (d, n).
        shares: (n,).
    """
    together = min(max(CALL // max(shares.size, 1), 8), 64)
    wide = BATCH // together
    for first in range(0, looks.times.size, together):
        some = slice(first, first + together)
        begin = int(np.searchsorted(times, looks.times[first] - SAME_INSTANT))
        for left in range(begin, shares.size, wide):
            part = slice(left, min(left + wide, shares.size))
            detection = sensor.detection(np.ascontiguousarray(corners[:, part]), looks.poses[some])
            _undetected(shares[part], detection, looks.times[some], times[part])
    begin = int(np.searchsorted(times, looks.stand_time - SAME_INSTANT))
    for left in range(begin, shares.size, BATCH):
        part = slice(left, min(left + BATCH, shares.size))
        detection = sensor.detection(np.ascontiguousarray(corners[:, part]), looks.stand_pose[None])
        _undetected_standing(shares[part], detection[0], looks.stand_time, looks.period, times[part])


@kernel
def _undetected(shares: FloatArray, detection: FloatArray, look_times: FloatArray, times: FloatArray) -> None:
    """shares (n,) times prod (1 - detection (k, n)) over the measurements not after the time of each."""
    for k in range(detection.shape[0]):
        for i in range(shares.size):
            if look_times[k] <= times[i] + SAME_INSTANT:
                shares[i] *= 1.0 - detection[k, i]


@kernel
def _undetected_standing(
    shares: FloatArray, detection: FloatArray, first: float, period: float, times: FloatArray
) -> None:
    """shares (n,) times (1 - detection (n,)) for each of the instants first + j period up to its time."""
    for i in range(shares.size):
        count = int((times[i] + SAME_INSTANT - first) / period) + 1
        shares[i] *= (1.0 - detection[i]) ** count
