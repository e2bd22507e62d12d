"""Kalman updates of every component with every measurement inside its gate, EKF and UKF.

A component's posterior covariance does not depend on the measurement, so it is shared by all of its pairs:
work per pair is one small triangular solve. Extended: Bar-Shalom, Li & Kirubarajan (2001), section 10.3, with
the covariance in Joseph's form, which stays positive definite under rounding. Unscented: Julier & Uhlmann,
"Unscented filtering and nonlinear estimation", Proceedings of the IEEE, 2004, on the positions only (a sensor
sees nothing else), with kappa = 3 - d; the rest of the state follows by its correlation with them.
"""

from math import pi
from typing import Literal

import numpy as np

from estimator.arrays import BoolArray, FloatArray
from estimator.gaussian.components import factorise, sigma_points
from estimator.gaussian.pairs import Innovations, Pairs, gated
from estimator.kernels import kernel
from estimator.sensor import GaussianSensor

__all__ = ["Pairs", "Rule", "innovations", "kalman_pairs"]

Rule = Literal["ekf", "ukf"]

# A bearing to a target at the sensor's very feet would, linearised, fix it to less than the rounding error of
# its covariance. No measurement narrows a component by more than this share of its variance.
_SHARPEST = 1e-13


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
    cross, spread, blunt = np.empty((n, s)), np.empty((s, s)), noise.copy()
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
                total = 0.0
                for c in range(d):
                    total += h[a, c] * cross[c, b]
                spread[a, b] = total
            blunt[a, a] = max(noise[a, a], _SHARPEST * spread[a, a])
        for a in range(s):
            for b in range(s):
                spread[a, b] += blunt[a, b]
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
                        total += gain[a, c] * blunt[c, e] * gain[b, e]
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
