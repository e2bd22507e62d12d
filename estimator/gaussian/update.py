"""Kalman updates of every component with every measurement inside its gate, EKF and UKF.

A component's posterior covariance does not depend on the measurement, so it is shared by all of its pairs:
work per pair is one small triangular solve. Extended: Bar-Shalom, Li & Kirubarajan (2001), section 10.3, with
the covariance in Joseph's form, which stays positive definite under rounding. Unscented: Julier & Uhlmann,
"Unscented filtering and nonlinear estimation", Proceedings of the IEEE, 2004, on the positions only (a sensor
sees nothing else), with kappa = 3 - d; the rest of the state follows by its correlation with them.
"""

from dataclasses import dataclass
from math import log, pi
from typing import Literal

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.gaussian.components import factorise, sigma_points
from estimator.kernels import kernel
from estimator.sensor import GaussianSensor

Rule = Literal["ekf", "ukf"]


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


def kalman_pairs(
    means: FloatArray,
    covariances: FloatArray,
    sensor: GaussianSensor,
    pose: FloatArray,
    measurements: FloatArray,
    *,
    rule: Rule = "ekf",
    gate: float = 6.0,
) -> Pairs:
    """All pairs of components (means (k, n_x), covariances (k, n_x, n_x)) and measurements (m, s).

    A pair is one whose innovation is at most `gate` standard deviations (Mahalanobis) long.

    Raises:
        ValueError: if an innovation's covariance is not positive definite.
    """
    expected = innovations(means, covariances, sensor, pose, rule)
    return gated(means, expected, measurements, sensor.angular, gate)


def summed(values: FloatArray, measurements: IntArray, count: int) -> FloatArray:
    """Sums (count,) of the pairs' values (p,) by measurement."""
    return np.asarray(np.bincount(measurements, values, minlength=count), dtype=np.float64)


def innovations(
    means: FloatArray, covariances: FloatArray, sensor: GaussianSensor, pose: FloatArray, rule: Rule
) -> Innovations:
    """What each component expects of the sensor at pose (4,), by the extended or the unscented rule.

    Raises:
        ValueError: if an innovation's covariance is not positive definite.
    """
    k, n = means.shape
    d, s = sensor.dimension, sensor.measurement_size
    predicted, factors, gains = np.empty((k, s)), np.empty((k, s, s)), np.empty((k, n, s))
    posterior = np.empty((k, n, n))
    if rule == "ekf":
        points = np.ascontiguousarray(means[:, :d].T)
        predicted = np.ascontiguousarray(sensor.measure(points, pose))
        jacobians = np.ascontiguousarray(sensor.jacobian(points, pose))
        bad = _extended(covariances, jacobians, sensor.noise, factors, gains, posterior)
    else:
        points = np.empty((d, k * (2 * d + 1)))
        bad = sigma_points(means, covariances, np.arange(k), points)
        if bad < 0:
            seen = np.ascontiguousarray(sensor.measure(points, pose))
            bad = _unscented(
                means,
                covariances,
                points,
                seen,
                sensor.noise,
                sensor.angular,
                predicted,
                factors,
                gains,
                posterior,
            )
    if bad >= 0:
        raise ValueError(f"covariances: number {bad} is not positive definite")
    return Innovations(predicted, factors, gains, posterior)


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
def _extended(
    covariances: FloatArray,
    jacobians: FloatArray,
    noise: FloatArray,
    factors: FloatArray,
    gains: FloatArray,
    posterior: FloatArray,
) -> int:
    """Fills L, W and the posterior covariances; the index of a component that is not regular, or -1."""
    k, n = covariances.shape[0], covariances.shape[1]
    s, d = jacobians.shape[1], jacobians.shape[2]
    cross, spread = np.empty((n, s)), np.empty((s, s))
    gain, left, half = np.empty((n, s)), np.empty((n, n)), np.empty((n, n))
    for i in range(k):
        p, h, lower, w = covariances[i], jacobians[i], factors[i], gains[i]
        for a in range(n):
            for b in range(s):
                total = 0.0
                for c in range(d):
                    total += p[a, c] * h[b, c]
                cross[a, b] = total
        for a in range(s):
            for b in range(s):
                total = noise[a, b]
                for c in range(d):
                    total += h[a, c] * cross[c, b]
                spread[a, b] = total
        if not factorise(spread, lower):
            return i
        _whiten(cross, lower, w)
        for a in range(n):  # K = W L^-1
            for b in range(s - 1, -1, -1):
                total = w[a, b]
                for c in range(b + 1, s):
                    total -= gain[a, c] * lower[c, b]
                gain[a, b] = total / lower[b, b]
        for a in range(n):
            for b in range(n):
                total = 1.0 if a == b else 0.0
                if b < d:
                    for c in range(s):
                        total -= gain[a, c] * h[c, b]
                left[a, b] = total
        for a in range(n):
            for b in range(n):
                total = 0.0
                for c in range(n):
                    total += left[a, c] * p[c, b]
                half[a, b] = total
        for a in range(n):
            for b in range(a + 1):
                total = 0.0
                for c in range(n):
                    total += half[a, c] * left[b, c]
                for c in range(s):
                    for e in range(s):
                        total += gain[a, c] * noise[c, e] * gain[b, e]
                posterior[i, a, b] = total
                posterior[i, b, a] = total
    return -1


@kernel
def _whiten(cross: FloatArray, lower: FloatArray, out: FloatArray) -> None:
    """W (n, s) with W L' = cross (n, s)."""
    n, s = cross.shape
    for a in range(n):
        for b in range(s):
            total = cross[a, b]
            for c in range(b):
                total -= out[a, c] * lower[b, c]
            out[a, b] = total / lower[b, b]


@kernel
def _unscented(
    means: FloatArray,
    covariances: FloatArray,
    points: FloatArray,
    seen: FloatArray,
    noise: FloatArray,
    angular: BoolArray,
    predicted: FloatArray,
    factors: FloatArray,
    gains: FloatArray,
    posterior: FloatArray,
) -> int:
    """As `_extended`, from sigma points (d, k (2 d + 1)) and their measurements (k (2 d + 1), s)."""
    k, n = means.shape
    d, s, each = points.shape[0], seen.shape[1], 2 * points.shape[0] + 1
    off, spread = np.empty((each, s)), np.empty((s, s))
    cross, factor, back = np.empty((n, s)), np.empty((d, d)), np.empty((n, d))
    for i in range(k):
        first = i * each
        for b in range(s):
            mean = 0.0
            for e in range(each):  # about the mean's own measurement: differences of angles are small there
                step = seen[first + e, b] - seen[first, b]
                if angular[b]:
                    step -= 2.0 * pi * np.round(step / (2.0 * pi))
                off[e, b] = step
                mean += step * (1.0 - d / 3.0 if e == 0 else 1.0 / 6.0)
            predicted[i, b] = seen[first, b] + mean
            for e in range(each):
                off[e, b] -= mean
        for a in range(s):
            for b in range(s):
                total = noise[a, b]
                for e in range(each):
                    total += (1.0 - d / 3.0 if e == 0 else 1.0 / 6.0) * off[e, a] * off[e, b]
                spread[a, b] = total
        if not factorise(spread, factors[i]) or not factorise(covariances[i, :d, :d], factor):
            return i
        _whiten(covariances[i, :, :d], factor, back)  # (n, d): x's rows in units of the sigma points' axes
        for a in range(n):
            for b in range(s):
                total = 0.0
                for e in range(d):
                    total += back[a, e] * (off[1 + 2 * e, b] - off[2 + 2 * e, b])
                cross[a, b] = total * (np.sqrt(3.0) / 6.0)
        w = gains[i]
        _whiten(cross, factors[i], w)
        for a in range(n):
            for b in range(a + 1):
                total = covariances[i, a, b]
                for e in range(s):
                    total -= w[a, e] * w[b, e]
                posterior[i, a, b] = total
                posterior[i, b, a] = total
    return -1


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
