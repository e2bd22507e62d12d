"""Which measurements each Gaussian component may have caused, and what each makes of it.

A component's posterior covariance does not depend on the measurement, so it is shared by all of its pairs:
work per pair is one small triangular solve. Measurements are sorted along one axis, and a component looks at
those within its gate's reach there.
"""

from dataclasses import dataclass
from math import log, pi

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel


@dataclass(frozen=True, slots=True, eq=False)
class Innovations:
    """What k components expect of a sensor's measurements, and what one would make of each component."""

    predicted: FloatArray  # (k, s) expected measurements
    factors: FloatArray  # (k, s, s) lower Cholesky factors L of the innovations' covariances S
    gains: FloatArray  # (k, n_x, s) W = K L: posterior mean = mean + W L^-1 innovation
    covariances: FloatArray  # (k, n_x, n_x) posterior, whatever the measurement


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Component-measurement pairs inside the gates, as compressed rows: one row per component.

    Component i has the pairs `offsets[i]:offsets[i + 1]`. Within a row the order follows the measurements'
    values, not their numbers, so permuted measurements give the same pairs in the same order.
    """

    offsets: IntArray  # (k + 1,)
    measurements: IntArray  # (p,) j of each pair
    log_likelihood: FloatArray  # (p,) log N(z_j; h, S) in 1 / unit of z
    means: FloatArray  # (p, n_x) posterior means
    covariances: FloatArray  # (k, n_x, n_x) posterior covariances, one per component

    def owners(self) -> IntArray:
        """(p,) the component of each pair."""
        return np.repeat(np.arange(self.offsets.size - 1), np.diff(self.offsets))


def summed(values: FloatArray, measurements: IntArray, count: int) -> FloatArray:
    """Sums (count,) of the pairs' values (p,) by measurement."""
    return np.asarray(np.bincount(measurements, values, minlength=count), dtype=np.float64)


def gated(
    means: FloatArray, expected: Innovations, measurements: FloatArray, angular: BoolArray, gate: float
) -> Pairs:
    """The pairs of components (means (k, n_x)) and measurements (m, s) inside the gates."""
    straight = np.flatnonzero(~angular)
    axis = int(straight[0]) if straight.size else 0
    keys = measurements[:, axis]
    if angular[axis]:
        keys = keys - 2.0 * pi * np.round(keys / (2.0 * pi))
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    offsets = np.zeros(len(means) + 1, np.int64)
    found, posterior = _collect(
        means,
        expected.predicted,
        expected.factors,
        expected.gains,
        measurements,
        angular,
        gate,
        axis,
        keys,
        order,
        offsets,
    )
    index, value = found[:, 0].astype(np.int64), np.ascontiguousarray(found[:, 1])
    return Pairs(offsets, index, value, posterior, expected.covariances)


@kernel
def _solve(
    z: FloatArray, predicted: FloatArray, lower: FloatArray, angular: BoolArray, limit: float, y: FloatArray
) -> float:
    """|L^-1 (z - predicted)|^2 with y = L^-1 (z - predicted); stops early once it is beyond the limit."""
    square = 0.0
    for a in range(z.size):
        step = z[a] - predicted[a]
        if angular[a]:
            step -= 2.0 * pi * np.round(step / (2.0 * pi))
        for b in range(a):
            step -= lower[a, b] * y[b]
        y[a] = step / lower[a, a]
        square += y[a] * y[a]
        if square > limit:
            break
    return square


@kernel
def _windows(
    centre: float, reach: float, turning: bool, keys: FloatArray, begins: IntArray, ends: IntArray
) -> None:
    """Up to three stretches of the sorted keys within `reach` of the centre: an angle's may wrap round."""
    if not turning or reach >= pi:
        everything = turning
        begins[0] = 0 if everything else np.searchsorted(keys, centre - reach)
        ends[0] = keys.size if everything else np.searchsorted(keys, centre + reach, side="right")
        begins[1:] = 0
        ends[1:] = 0
        return
    middle = centre - 2.0 * pi * np.round(centre / (2.0 * pi))
    for q in range(3):
        low = middle + 2.0 * pi * (q - 1) - reach
        begins[q] = np.searchsorted(keys, low)
        ends[q] = np.searchsorted(keys, low + 2.0 * reach, side="right")


@kernel
def _doubled(old: FloatArray) -> FloatArray:
    """The same rows with room for as many again."""
    new = np.empty((2 * old.shape[0], old.shape[1]))
    new[: old.shape[0]] = old
    return new


@kernel
def _collect(
    means: FloatArray,
    predicted: FloatArray,
    factors: FloatArray,
    gains: FloatArray,
    measurements: FloatArray,
    angular: BoolArray,
    gate: float,
    axis: int,
    keys: FloatArray,
    order: IntArray,
    offsets: IntArray,
) -> tuple[FloatArray, FloatArray]:
    """Fills the offsets (k + 1,); measurement and log-likelihood (p, 2), posterior means (p, n_x).

    One pass into rows that grow: to count first would need the same rounding twice.
    """
    s, n = measurements.shape[1], means.shape[1]
    y, begins, ends = np.empty(s), np.empty(3, np.int64), np.empty(3, np.int64)
    room = 2 * means.shape[0] + measurements.shape[0] + 8
    found, posterior = np.empty((room, 2)), np.empty((room, n))
    at, limit = 0, gate * gate
    for i in range(predicted.shape[0]):
        variance, level = 0.0, -0.5 * s * log(2.0 * pi)
        for c in range(axis + 1):
            variance += factors[i, axis, c] ** 2
        for c in range(s):
            level -= np.log(factors[i, c, c])
        _windows(predicted[i, axis], gate * np.sqrt(variance), angular[axis], keys, begins, ends)
        for q in range(3):
            for t in range(begins[q], ends[q]):
                j = order[t]
                square = _solve(measurements[j], predicted[i], factors[i], angular, limit, y)
                if not square <= limit:
                    continue
                if at == found.shape[0]:
                    found, posterior = _doubled(found), _doubled(posterior)
                found[at, 0] = j
                found[at, 1] = level - 0.5 * square
                for a in range(n):
                    total = means[i, a]
                    for c in range(s):
                        total += gains[i, a, c] * y[c]
                    posterior[at, a] = total
                at += 1
        offsets[i + 1] = at
    return found[:at], posterior[:at]
