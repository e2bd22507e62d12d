"""What a sensor's measurement set says about Gaussian mixtures: measured, and not detected.

A measurement is often much narrower than a component, and then the component's mean is a poor place to
linearise at. The update is an iterated extended Kalman filter (Bell & Cathey 1993) that starts where the
measurement itself points, weighed against the component. "No detection" squashes a component by 1 - p_D with
importance sampling and the component itself as proposal, as Ponda et al. 2012, Algorithm 3, do for robots. A
component that this bends much is cut through its new mean along each principal axis, which keeps all moments:
the halves can leave a hole where the sensor looked, one Gaussian cannot.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.gaussian.components import Components
from estimator.sensor import GaussianSensor, SensorModel

_GATE = 6.0  # standard deviations
_STEPS = 2  # of linearisation
_BENT = 0.75  # effective share of the samples below which a component is cut
_PARTS = 4  # samples per dimension that a part needs to have a covariance


@dataclass(frozen=True, slots=True, eq=False)
class Explained:
    """Pairs of a component and a measurement inside its gate, by component, then measurement."""

    components: IntArray  # (p,)
    measurements: IntArray  # (p,)
    likelihoods: FloatArray  # (p,) p_D N(z; h, S), without the component's weight
    means: FloatArray  # (p, n_x)
    covariances: FloatArray  # (p, n_x, n_x)


def explained(
    mixture: Components, sensor: GaussianSensor, pose: FloatArray, measurements: FloatArray
) -> Explained:
    """What measurements (m, s) from pose (4,) would make of each component."""
    d = sensor.dimension
    places = sensor.locate(measurements, pose).T
    spreads = sensor.location_covariance(measurements, pose)
    steps = places[None, :, :] - mixture.means[:, None, :d]
    totals = mixture.covariances[:, None, :d, :d] + spreads[None]
    solved = np.linalg.solve(totals, steps[..., None])[..., 0]
    i, j = np.nonzero(np.sum(steps * solved, axis=2) < _GATE**2)
    mean, cov = mixture.means[i], mixture.covariances[i]
    at = mean[:, :d] + np.einsum("pab,pb->pa", cov[:, :d, :d], solved[i, j])
    noise, size = sensor.noise, sensor.measurement_size
    new, gain, h, log = mean, cov, cov, mean[:, 0]  # of the last step
    for _ in range(_STEPS):
        points = np.ascontiguousarray(at.T)
        h = sensor.jacobian(points, pose)
        off = measurements[j] - sensor.measure(points, pose)
        off[:, sensor.angular] = (off[:, sensor.angular] + np.pi) % (2.0 * np.pi) - np.pi
        off += np.einsum("psd,pd->ps", h, at - mean[:, :d])
        cross = cov[:, :, :d] @ np.swapaxes(h, 1, 2)
        spread = h @ cross[:, :d] + noise
        lower = np.linalg.cholesky(spread)
        gain = np.swapaxes(np.linalg.solve(spread, np.swapaxes(cross, 1, 2)), 1, 2)
        new = mean + np.einsum("pns,ps->pn", gain, off)
        white = np.linalg.solve(lower, off[..., None])[..., 0]
        log = -0.5 * np.sum(white**2, axis=1) - np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=1)
        at = new[:, :d]
    log -= 0.5 * size * np.log(2.0 * np.pi)
    left = np.tile(np.eye(mixture.state_size), (i.size, 1, 1))
    left[:, :, :d] -= gain @ h
    posterior = left @ cov @ np.swapaxes(left, 1, 2) + gain @ noise @ np.swapaxes(gain, 1, 2)
    rates = sensor.detection(np.ascontiguousarray(at.T), pose[None, :])[0]
    return Explained(i, j, rates * np.exp(log), new, 0.5 * (posterior + np.swapaxes(posterior, 1, 2)))


def undetected(
    mixture: Components, sensor: SensorModel, pose: FloatArray, units: FloatArray
) -> tuple[Components, IntArray]:
    """The mixture times 1 - p_D, not normalised, and the component that each of its components came from.

    units (d, b) are normal points of mean 0 and covariance 1. A component where p_D is 0 is not touched.
    """
    d, count = units.shape
    n = mixture.count
    lower = np.linalg.cholesky(mixture.covariances[:, :d, :d])
    points = mixture.means[:, :d, None] + lower @ units
    flat = np.ascontiguousarray(points.transpose(1, 0, 2).reshape(d, n * count))
    values = 1.0 - sensor.detection(flat, pose[None, :])[0].reshape(n, count)
    total = values.sum(axis=1)
    share = total**2 / np.maximum(count * np.sum(values**2, axis=1), 1e-300)
    touched = (values < 1.0).any(axis=1)
    weights, means, covariances, sources = [], [], [], []
    for m in range(n):
        if total[m] <= 0.0 or not touched[m]:
            parts = [(1.0 if not touched[m] else 0.0, mixture.means[m], mixture.covariances[m])]
        else:
            parts = [
                (rate, *conditioned(mixture.means[m], mixture.covariances[m], mean, covariance))
                for rate, mean, covariance in _parts(points[m], values[m], bool(share[m] < _BENT))
            ]
        for rate, mean, covariance in parts:
            weights.append(rate * mixture.weights[m])
            means.append(mean)
            covariances.append(covariance)
            sources.append(m)
    return Components(np.array(weights), np.array(means), np.array(covariances)), np.array(sources)


def _parts(points: FloatArray, values: FloatArray, cut: bool) -> list[tuple[float, FloatArray, FloatArray]]:
    """Weight, mean and covariance of weighted samples (d, b); of the parts between the axes, if `cut`."""
    whole = _moments(points, values)
    if not cut:
        return [whole]
    d = len(points)
    axes = np.linalg.eigh(whole[2])[1]
    sides = (axes.T @ (points - whole[1][:, None]) > 0.0).astype(np.int64)
    label = np.sum(sides * (1 << np.arange(d))[:, None], axis=0)
    parts = []
    for k in range(1 << d):
        inside = label == k
        effective = values[inside].sum() ** 2 / max(np.sum(values[inside] ** 2), 1e-300)
        if effective < _PARTS * d:
            if values[inside].sum() > 0.0:
                return [whole]
            continue
        rate, mean, covariance = _moments(points[:, inside], values[inside])
        parts.append((rate * inside.mean(), mean, covariance))
    return parts


def _moments(points: FloatArray, values: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    total = float(values.sum())
    mean = points @ values / total
    off = points - mean[:, None]
    covariance = (off * values) @ off.T / total
    effective = total**2 / float(np.sum(values**2))
    if effective < _PARTS * len(points):  # so few samples have no covariance of their own
        off = points - points.mean(axis=1)[:, None]
        covariance = off @ off.T / values.size
    return total / values.size, mean, covariance


def conditioned(
    mean: FloatArray, covariance: FloatArray, place: FloatArray, spread: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A state's Gaussian (n_x,), (n_x, n_x) after its position became `place` (d,), `spread` (d, d).

    The rest of the state follows by its regression on the position.
    """
    d, n = place.size, mean.size
    if n == d:
        return place, spread
    regression = np.linalg.solve(covariance[:d, :d], covariance[:d, d:]).T
    new, out = mean.copy(), covariance.copy()
    new[:d] = place
    new[d:] += regression @ (place - mean[:d])
    out[:d, :d] = spread
    out[d:, :d] = regression @ spread
    out[:d, d:] = out[d:, :d].T
    out[d:, d:] += regression @ (spread - covariance[:d, :d]) @ regression.T
    return new, 0.5 * (out + out.T)
