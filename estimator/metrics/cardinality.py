"""How far the estimated number of targets is from the true one, over time."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class CardinalityError:
    """Errors of the estimated number of targets."""

    bias: float  # mean of estimated - true
    absolute: float  # mean of |estimated - true|
    rms: float
    worst: float  # greatest |estimated - true|


def cardinality_error(true: FloatArray, estimated: FloatArray) -> CardinalityError:
    """Errors of `estimated` (t,) numbers of targets, whole or expected, for the true ones (t,).

    Raises:
        ValueError: if there is no instant, the shapes differ, or a number is not finite.
    """
    true, estimated = np.asarray(true, dtype=np.float64), np.asarray(estimated, dtype=np.float64)
    if true.ndim != 1 or true.size == 0 or true.shape != estimated.shape:
        raise ValueError(f"estimated: expected (t,) as true, t > 0, got {estimated.shape} and {true.shape}")
    if not (np.isfinite(true).all() and np.isfinite(estimated).all()):
        raise ValueError("true, estimated: every number must be finite")
    errors = estimated - true
    return CardinalityError(
        bias=float(errors.mean()),
        absolute=float(np.abs(errors).mean()),
        rms=float(np.sqrt(np.mean(errors**2))),
        worst=float(np.abs(errors).max()),
    )
