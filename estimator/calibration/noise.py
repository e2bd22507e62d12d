"""A sensor's noise from its errors, some of which are no noise at all.

An error is either Gaussian, with independent components, or it is an outlier, uniform within the gate. The
expectation-maximisation algorithm weighs every error by how probably it is the former (Dempster, Laird &
Rubin 1977; the uniform class as in Banfield & Raftery, Biometrics 49(3), 1993).
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray

_ROUNDS = 200
_SETTLED = 1e-6  # relative change of a standard deviation per round


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """Gaussian noise with a share of outliers."""

    sigmas: FloatArray  # (s,) standard deviations, in the measurement's units
    biases: FloatArray  # (s,) means
    inliers: float  # share of the errors that are noise


def responsibilities(noise: Noise, errors: FloatArray, gate: FloatArray) -> FloatArray:
    """(k,) how probably each of the errors (k, s) is noise; 0 outside +-gate (s,)."""
    scaled = (errors - noise.biases) / noise.sigmas
    density = np.exp(-0.5 * (scaled**2).sum(axis=1)) / np.prod(np.sqrt(2.0 * np.pi) * noise.sigmas)
    inlier = noise.inliers * density
    total = inlier + (1.0 - noise.inliers) / np.prod(2.0 * gate)
    inside = (np.abs(errors) <= gate).all(axis=1)
    return np.where(inside & (total > 0.0), inlier / np.where(total > 0.0, total, 1.0), 0.0)


def fit_noise(
    errors: FloatArray,
    gate: FloatArray,
    weights: FloatArray | None = None,
    start: Noise | None = None,
    rounds: int = _ROUNDS,
) -> Noise:
    """The maximum-likelihood noise of errors (k, s) within +-gate (s,), each counted weights (k,) times.

    Raises:
        ValueError: if fewer than 10 errors lie within the gate.
    """
    inside = (np.abs(errors) <= gate).all(axis=1)
    errors = errors[inside]
    w = np.ones(len(errors)) if weights is None else weights[inside]
    if len(errors) < 10 or w.sum() <= 0.0:
        raise ValueError(
            f"errors: {len(errors)} within the gate are too few to estimate noise; widen the gate"
        )
    noise = start
    if noise is None:
        middle = np.median(errors, axis=0)
        spread = 1.4826 * np.median(np.abs(errors - middle), axis=0)
        noise = Noise(np.maximum(spread, 1e-6 * gate), middle, 0.9)
    for _ in range(rounds):
        share = w * responsibilities(noise, errors, gate)
        total = share.sum()
        if total <= 0.0:
            break
        mean = share @ errors / total
        sigmas = np.maximum(np.sqrt(share @ (errors - mean) ** 2 / total), 1e-6 * gate)
        settled = np.all(np.abs(sigmas - noise.sigmas) <= _SETTLED * sigmas)
        noise = Noise(sigmas, mean, float(total / w.sum()))
        if settled:
            break
    return noise
