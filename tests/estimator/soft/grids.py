"""Posteriors by brute force on a fine grid in 2D, as the reference for every update."""

import numpy as np

from estimator.arrays import FloatArray
from estimator.gaussian.components import Components
from estimator.sensors.softmax import Softmax

STEP = 0.12
_AXIS = np.arange(-11.0, 17.0, STEP)
POINTS: FloatArray = np.stack([x.ravel() for x in np.meshgrid(_AXIS, _AXIS, indexing="ij")])


def density(mixture: Components) -> FloatArray:
    """The mixture's density at the grid's points, its first two numbers if it has more."""
    out = np.zeros(POINTS.shape[1])
    for w, m, p in zip(mixture.weights, mixture.means, mixture.covariances, strict=True):
        off = np.linalg.solve(np.linalg.cholesky(p[:2, :2]), POINTS - m[:2, None])
        scale = 2.0 * np.pi * np.sqrt(np.linalg.det(p[:2, :2]))
        out += w / scale * np.exp(-0.5 * (off[0] ** 2 + off[1] ** 2))
    return out


def agreement(softmax: Softmax, own: list[int]) -> FloatArray:
    """p(own | x) at the grid's points, by the plain formula."""
    y = softmax.weights @ POINTS + softmax.biases[:, None]
    e = np.exp(y - y.max(axis=0))
    return np.asarray(e[own].sum(axis=0) / e.sum(axis=0))


def posterior(mixture: Components, likelihood: FloatArray) -> tuple[FloatArray, float]:
    """The normalised posterior on the grid, and the evidence."""
    values = density(mixture) * likelihood
    evidence = float(values.sum() * STEP**2)
    return values / evidence, evidence


def moments(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of a density on the grid."""
    w = values / values.sum()
    mean = POINTS @ w
    off = POINTS - mean[:, None]
    return mean, (off * w) @ off.T


def apart(values: FloatArray, mixture: Components) -> float:
    """Total variation distance, 0..1, between a density on the grid and a mixture."""
    return float(0.5 * np.abs(values - density(mixture)).sum() * STEP**2)
