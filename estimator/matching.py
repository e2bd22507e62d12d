"""Two estimates of places: how far they are apart, what they say together, and which belong to each other."""

import numpy as np

from estimator.arrays import FloatArray, IntArray


def apart(mean: FloatArray, spread: FloatArray, other: FloatArray, other_spread: FloatArray) -> float:
    """How many standard deviations two estimates (d,) with covariances (d, d) are apart (Mahalanobis)."""
    step = other - mean
    return float(np.sqrt(step @ np.linalg.solve(_total(spread, other_spread), step)))


def together(
    mean: FloatArray, spread: FloatArray, other: FloatArray, other_spread: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of one place of which there are two independent estimates."""
    gain = np.linalg.solve(_total(spread, other_spread), spread).T
    rest = spread - gain @ spread
    return mean + gain @ (other - mean), 0.5 * (rest + rest.T)


def closest(found: FloatArray, places: FloatArray, gate: float) -> tuple[IntArray, IntArray]:
    """Found targets and the measurement each takes: nearest pairs first, each target and measurement once."""
    distances = np.linalg.norm(found[:, :, None] - places[:, None, :], axis=0)
    targets, taken = [], []
    order = np.argsort(distances, axis=None, kind="stable")
    for flat in order[: np.count_nonzero(distances < gate)]:
        i, j = divmod(int(flat), distances.shape[1])
        if i not in targets and j not in taken:
            targets.append(i)
            taken.append(j)
    return np.array(targets, dtype=np.int64), np.array(taken, dtype=np.int64)


def _total(spread: FloatArray, other: FloatArray) -> FloatArray:
    """The sum of two covariances (d, d), made regular: those of a few particles may be flat."""
    total = spread + other
    total.ravel()[:: len(total) + 1] += 1e-9 * float(total.trace()) + 1e-300
    return total
