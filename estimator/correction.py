"""The PHD corrector on weighted points: (MA)ASI (13), (16), with clutter in the denominator.

Vo, Singh & Doucet, "Sequential Monte Carlo methods for multi-target filtering with random finite sets", IEEE
Transactions on Aerospace and Electronic Systems, 2005, eq. 20.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel
from estimator.sensor import Look

_NOTHING = 1e-290  # a denominator up to this is 0 to working precision


def corrected(
    weights: FloatArray, look: Look, elsewhere: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Posterior weights (n,) and each measurement's denominator (m,).

    w_i' = w_i (1 - p_D(x_i)) + sum_j w_i p_D(x_i) g(z_j | x_i) / D_j, with
    D_j = c(z_j) + e_j + sum_i w_i p_D(x_i) g(z_j | x_i), where `elsewhere` e_j (m,) is what a part of the
    intensity that is not in the points adds; none by default. A measurement whose denominator is 0 says
    nothing: under the model it cannot have happened.

    Raises:
        ValueError: if there is not one weight per point of the look.
    """
    if weights.shape != look.detection.shape:
        raise ValueError(f"weights: expected shape {look.detection.shape}, got {weights.shape}")
    background = look.clutter if elsewhere is None else look.clutter + elsewhere
    posterior = np.empty_like(weights)
    denominators = np.empty(look.clutter.size)
    _correct(
        weights,
        look.detection,
        look.offsets,
        look.indices,
        look.likelihood,
        background,
        posterior,
        denominators,
    )
    return posterior, denominators


@kernel
def _correct(
    weights: FloatArray,
    detection: FloatArray,
    offsets: IntArray,
    indices: IntArray,
    likelihood: FloatArray,
    background: FloatArray,
    posterior: FloatArray,
    denominators: FloatArray,
) -> None:
    for i in range(weights.size):
        posterior[i] = weights[i] * (1.0 - detection[i])
    for j in range(background.size):
        total = background[j]
        for k in range(offsets[j], offsets[j + 1]):
            i = indices[k]
            total += weights[i] * detection[i] * likelihood[k]
        denominators[j] = total
        if total <= _NOTHING:
            continue
        for k in range(offsets[j], offsets[j + 1]):
            i = indices[k]
            posterior[i] += weights[i] * detection[i] * likelihood[k] / total
