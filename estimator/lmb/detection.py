"""p_D of a whole Gaussian: a field of view may end inside a wide one."""

import numpy as np

from estimator.arrays import FloatArray
from estimator.sensor import SensorModel


def mean_detection(
    means: FloatArray, covariances: FloatArray, sensor: SensorModel, pose: FloatArray
) -> FloatArray:
    """The mean of p_D (k,) over components (means (k, n_x), covariances (k, n_x, n_x)) from pose (4,).

    By the unscented rule with kappa = 3 - d (Julier & Uhlmann 2004), whose weights are none negative.

    Raises:
        ValueError: if a covariance is not positive definite.
    """
    d, k = sensor.dimension, len(means)
    try:
        factors = np.linalg.cholesky(covariances[:, :d, :d])
    except np.linalg.LinAlgError:
        raise ValueError("covariances: expected positive definite matrices") from None
    centres = np.ascontiguousarray(means[:, :d].T)  # (d, k)
    steps = np.sqrt(3.0) * factors.transpose(1, 2, 0)  # (d, d, k), one step for each column
    points = np.concatenate([centres[:, None], centres[:, None] + steps, centres[:, None] - steps], axis=1)
    values = sensor.detection(np.ascontiguousarray(points.reshape(d, -1)), pose[None, :])[0].reshape(-1, k)
    return np.asarray((1.0 - d / 3.0) * values[0] + values[1:].sum(axis=0) / 6.0)
