"""The PHD corrector on weighted points: (MA)ASI (13), (16), with clutter in the denominator.

Vo, Singh & Doucet, "Sequential Monte Carlo methods for multi-target filtering with random finite sets", IEEE
Transactions on Aerospace and Electronic Systems, 2005, eq. 20.
"""

from collections.abc import Iterator

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel
from estimator.sensor import Look

_PAIRS = 20_000_000  # of particles and measurements looked at together: bounds the memory of large sets
_NOTHING = 1e-290  # a denominator up to this is 0 to working precision


def explained(weights: FloatArray, look: Look) -> FloatArray:
    """What the points explain of each measurement (m,): sum_i w_i p_D(x_i) g(z_j | x_i).

    Raises:
        ValueError: if there is not one weight per point of the look.
    """
    _check(weights, look)
    totals = np.empty(look.clutter.size)
    _explain(weights, look.detection, look.offsets, look.indices, look.likelihood, totals)
    return totals


def corrected(weights: FloatArray, look: Look, denominators: FloatArray | None = None) -> FloatArray:
    """Posterior weights (n,) of points with prior weights (n,).

    w_i' = w_i (1 - p_D(x_i)) + sum_j w_i p_D(x_i) g(z_j | x_i) / D_j, by default with
    D_j = c(z_j) + sum_i w_i p_D(x_i) g(z_j | x_i); a part of the intensity that is not in the points adds its
    own to `denominators` (m,). A measurement whose denominator is 0 changes nothing: under the model it
    cannot have happened.

    Raises:
        ValueError: if there is not one weight per point of the look.
    """
    _check(weights, look)
    if denominators is None:
        denominators = look.clutter + explained(weights, look)
    posterior = np.empty_like(weights)
    _correct(weights, look.detection, look.offsets, look.indices, look.likelihood, denominators, posterior)
    return posterior


def _check(weights: FloatArray, look: Look) -> None:
    if weights.shape != look.detection.shape:
        raise ValueError(f"weights: expected shape {look.detection.shape}, got {weights.shape}")


@kernel
def _explain(
    weights: FloatArray,
    detection: FloatArray,
    offsets: IntArray,
    indices: IntArray,
    likelihood: FloatArray,
    totals: FloatArray,
) -> None:
    for j in range(totals.size):
        total = 0.0
        for k in range(offsets[j], offsets[j + 1]):
            total += weights[indices[k]] * detection[indices[k]] * likelihood[k]
        totals[j] = total


@kernel
def _correct(
    weights: FloatArray,
    detection: FloatArray,
    offsets: IntArray,
    indices: IntArray,
    likelihood: FloatArray,
    denominators: FloatArray,
    posterior: FloatArray,
) -> None:
    for i in range(weights.size):
        posterior[i] = weights[i] * (1.0 - detection[i])
    for j in range(denominators.size):
        if denominators[j] <= _NOTHING:
            continue
        inverse = 1.0 / denominators[j]
        for k in range(offsets[j], offsets[j + 1]):
            i = indices[k]
            posterior[i] += weights[i] * detection[i] * likelihood[k] * inverse


def blocks_of(measurements: FloatArray, particles: int) -> Iterator[FloatArray]:
    """The set in parts of so many measurements that particles times measurements stay in memory."""
    rows = min(max(_PAIRS // max(particles, 1), 16), 128)
    for begin in range(0, max(len(measurements), 1), rows):
        yield measurements[begin : begin + rows]
