"""How far estimated targets are from true ones: GOSPA and root mean square error. Robots need none of it."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray


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
        ValueError: if c <= 0, p < 1, or the dimensions differ.
    """
    if not c > 0 or not p >= 1:
        raise ValueError(f"c, p: expected c > 0 and p >= 1, got {c} and {p}")
    rows, columns, distances = _assigned(truth, estimates, c, p)
    penalty = c**p / 2
    near = float(np.sum(distances**p))
    missed = penalty * (truth.shape[1] - rows.size)
    false = penalty * (estimates.shape[1] - rows.size)
    pairs = tuple(zip(rows.tolist(), columns.tolist(), strict=True))
    total, *parts = ((x ** (1 / p)) for x in (near + missed + false, near, missed, false))
    return Gospa(total, parts[0], parts[1], parts[2], pairs)


def matched(truth: FloatArray, estimates: FloatArray, within: float) -> tuple[tuple[int, int], ...]:
    """Pairs (true, estimated) nearer than `within` metres, as many as can be and then as close as can be."""
    truth, estimates, distances = _distances(truth, estimates)
    if distances.size == 0:
        return ()
    # one more pair is worth more than any closeness
    cost = np.where(distances < within, (distances / within) ** 2 / (2 * min(distances.shape)), 1.0)
    rows, columns = _assignment(cost)
    near = distances[rows, columns] < within
    return tuple(zip(rows[near].tolist(), columns[near].tolist(), strict=True))


def rmse(truth: FloatArray, estimates: FloatArray, within: float) -> float | None:
    """Root mean square error in metres of the matched; None if nothing matches."""
    pairs = matched(truth, estimates, within)
    if not pairs:
        return None
    errors = [np.sum((truth[:, i] - estimates[:, j]) ** 2) for i, j in pairs]
    return float(np.sqrt(np.mean(errors)))


def _distances(truth: FloatArray, estimates: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    truth, estimates = np.asarray(truth, dtype=np.float64), np.asarray(estimates, dtype=np.float64)
    if truth.ndim != 2 or estimates.ndim != 2 or truth.shape[0] != estimates.shape[0]:
        raise ValueError(f"estimates: expected (d, k) with d as in {truth.shape}, got {estimates.shape}")
    if not (np.isfinite(truth).all() and np.isfinite(estimates).all()):
        raise ValueError("truth, estimates: every number must be finite")
    return truth, estimates, np.linalg.norm(truth[:, :, None] - estimates[:, None, :], axis=0)


def _assigned(
    truth: FloatArray, estimates: FloatArray, c: float, p: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows, columns and distances of the optimal partial assignment."""
    truth, estimates, distances = _distances(truth, estimates)
    if distances.size == 0:
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros(0)
    rows, columns = _assignment(np.minimum(distances, c) ** p)
    near = distances[rows, columns] < c
    return rows[near], columns[near], distances[rows, columns][near]


def _assignment(cost: FloatArray) -> tuple[IntArray, IntArray]:
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - 0.4 s that robots need not wait

    rows, columns = linear_sum_assignment(cost)
    return rows.astype(np.int64), columns.astype(np.int64)
