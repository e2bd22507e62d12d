"""How far estimated targets are from true ones: GOSPA and root mean square error. Robots need none of it."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from estimator.metrics.assignment import assigned, nearest_pairs


@dataclass(frozen=True, slots=True)
class Gospa:
    """The GOSPA metric and its parts, alpha = 2; total^p = localisation^p + missed^p + false^p."""

    total: float  # metres
    localisation: float
    missed: float
    false: float
    pairs: tuple[tuple[int, int], ...]  # (true, estimated) assigned to each other


def gospa(truth: FloatArray, estimates: FloatArray, *, c: float, p: float = 2.0) -> Gospa:
    """GOSPA of estimates (d, k) for truth (d, n) with cut-off c (metres) and order p, alpha = 2.

    Rahmathullah, García-Fernández & Svensson, "Generalized optimal sub-pattern assignment metric", 2017,
    proposition 1: the minimum over partial assignments of sum d^p + c^p / 2 (missed + false).

    Raises:
        ValueError: if c <= 0, p < 1, a number is not finite, or the dimensions differ.
    """
    check_order(c, p)
    truth, estimates = checked_sets(truth, estimates)
    finite, partners, distances = nearest_pairs(truth, estimates, c, p)
    if not finite:
        raise ValueError("truth, estimates: every number must be finite")
    rows = np.flatnonzero(partners >= 0)
    penalty = c**p / 2
    near = float(np.sum(distances[rows] ** p))
    missed = penalty * (truth.shape[1] - rows.size)
    false = penalty * (estimates.shape[1] - rows.size)
    pairs = tuple(zip(rows.tolist(), partners[rows].tolist(), strict=True))
    q = 1 / p
    return Gospa((near + missed + false) ** q, near**q, missed**q, false**q, pairs)


def matched(truth: FloatArray, estimates: FloatArray, within: float) -> tuple[tuple[int, int], ...]:
    """Pairs (true, estimated) nearer than `within` metres, as many as can be and then as close as can be."""
    truth, estimates = checked_sets(truth, estimates)
    d = distances(truth, estimates)
    if d.size == 0:
        return ()
    # one more pair is worth more than any closeness
    gains = np.where(d < within, 1.0 - (d / within) ** 2 / (2 * min(d.shape)), 0.0)
    rows, columns = assigned(gains)
    return tuple(zip(rows.tolist(), columns.tolist(), strict=True))


def rmse(truth: FloatArray, estimates: FloatArray, within: float) -> float | None:
    """Root mean square error in metres of the matched; None if nothing matches."""
    pairs = matched(truth, estimates, within)
    if not pairs:
        return None
    errors = [np.sum((truth[:, i] - estimates[:, j]) ** 2) for i, j in pairs]
    return float(np.sqrt(np.mean(errors)))


def check_order(c: float, p: float) -> None:
    """That the cut-off and the order make a metric.

    Raises:
        ValueError: if they do not.
    """
    if not 0 < c < np.inf or not 1 <= p < np.inf:
        raise ValueError(f"c, p: expected finite c > 0 and p >= 1, got {c} and {p}")


def checked_sets(truth: FloatArray, estimates: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two sets (d, n) and (d, k) as contiguous arrays.

    Raises:
        ValueError: if the dimensions differ.
    """
    truth = np.ascontiguousarray(truth, dtype=np.float64)
    estimates = np.ascontiguousarray(estimates, dtype=np.float64)
    if truth.ndim != 2 or estimates.ndim != 2 or truth.shape[0] != estimates.shape[0]:
        raise ValueError(f"estimates: expected (d, k) with d as in {truth.shape}, got {estimates.shape}")
    return truth, estimates


def distances(truth: FloatArray, estimates: FloatArray) -> FloatArray:
    """Distances (n, k) of all pairs.

    Raises:
        ValueError: if a number is not finite.
    """
    if not (np.isfinite(truth).all() and np.isfinite(estimates).all()):
        raise ValueError("truth, estimates: every number must be finite")
    return np.asarray(np.linalg.norm(truth[:, :, None] - estimates[:, None, :], axis=0))
