"""Fisher information of looks at targets, and its A-optimality: Ponda et al. (2012), (8)-(13).

A look from pose mu at target mode i adds p_D(x_i; mu) H^T R^-1 H, (11), with H the Jacobian of the sensor's
measurement function (10). Where the paper has a binary nu for whether a measurement succeeds, the detection
probability stands here, its expected value; a sensor that cannot see through walls says so itself.

The Jacobians are asked for at relative places, all in one call. That is right for sensors whose Jacobian
depends on where the target is relative to the sensor and not on its yaw: ranges, bearings, elevations in the
robot's axes or the world's, and positions in the world's axes.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel
from estimator.sensor import SensorModel, gaussian


def information(sensor: SensorModel, poses: FloatArray, means: FloatArray) -> FloatArray:
    """p_D H^T R^-1 H of looks from poses (k, 4) at targets (d, n), shape (k, n, d, d), 1/m^2.

    Raises:
        ValueError: if the sensor's noise is not Gaussian, its noise is singular, or a shape is another.
    """
    model = gaussian(sensor)
    k, (d, n) = len(poses), means.shape
    if k == 0 or n == 0:
        return np.zeros((k, n, d, d))
    detection = np.ascontiguousarray(sensor.detection(means, poses))
    relative = (means[:, None, :] - poses[:, :d].T[:, :, None]).reshape(d, k * n)
    altitude = float(poses[0, 2]) if d == 2 else 0.0
    jacobian = model.jacobian(np.ascontiguousarray(relative), np.array([0.0, 0.0, altitude, 0.0]))
    try:
        precision = np.linalg.inv(model.noise).astype(np.float64)
    except np.linalg.LinAlgError as error:
        raise ValueError("sensor: the covariance of its noise is singular") from error
    out = np.empty((k, n, d, d))
    _squares(np.ascontiguousarray(jacobian), precision, detection, out)
    return out


@kernel
def _squares(jacobian: FloatArray, precision: FloatArray, detection: FloatArray, out: FloatArray) -> None:
    """p_D H^T W H of the Jacobians (k n, s, d) and weight (s, s) into out (k, n, d, d)."""
    s, d = jacobian.shape[1], jacobian.shape[2]
    half = np.empty((s, d))
    for k in range(out.shape[0]):
        for i in range(out.shape[1]):
            h = jacobian[k * out.shape[1] + i]
            for r in range(s):
                for a in range(d):
                    total = 0.0
                    for q in range(s):
                        total += precision[r, q] * h[q, a]
                    half[r, a] = total
            for a in range(d):
                for b in range(d):
                    total = 0.0
                    for r in range(s):
                        total += h[r, a] * half[r, b]
                    out[k, i, a, b] = detection[k, i] * total


@kernel
def a_optimality(information: FloatArray) -> float:
    """The trace of the inverse of a symmetric positive definite matrix (d, d), d = 2 or 3, in closed form."""
    j = information
    if j.shape[0] == 2:
        return float((j[0, 0] + j[1, 1]) / (j[0, 0] * j[1, 1] - j[0, 1] * j[1, 0]))
    c00 = j[1, 1] * j[2, 2] - j[1, 2] * j[2, 1]
    c11 = j[0, 0] * j[2, 2] - j[0, 2] * j[2, 0]
    c22 = j[0, 0] * j[1, 1] - j[0, 1] * j[1, 0]
    determinant = (
        j[0, 0] * c00
        - j[0, 1] * (j[1, 0] * j[2, 2] - j[1, 2] * j[2, 0])
        + j[0, 2] * (j[1, 0] * j[2, 1] - j[1, 1] * j[2, 0])
    )
    return float((c00 + c11 + c22) / determinant)


@kernel
def accumulate(
    parents: IntArray,
    gains: FloatArray,
    weights: FloatArray,
    first: int,
    last: int,
    fisher: FloatArray,
    cost: FloatArray,
) -> None:
    """(11)-(13) of nodes first..last-1, whose parents come before them.

    Args:
        parents: (m,) node number of each node's parent.
        gains: (last - first, looks, n, d, d) what each look of each node adds.
        weights: (n,) q_i w_i,m of each mode.
        first, last: which nodes.
        fisher: (m, n, d, d) of the nodes, filled in.
        cost: (m,) I of (13) in m^2, filled in.
    """
    for node in range(first, last):
        parent = parents[node]
        total = 0.0
        for i in range(weights.size):
            for a in range(fisher.shape[2]):
                for b in range(fisher.shape[2]):
                    value = fisher[parent, i, a, b]
                    for look in range(gains.shape[1]):
                        value += gains[node - first, look, i, a, b]
                    fisher[node, i, a, b] = value
            total += weights[i] * a_optimality(fisher[node, i])
        cost[node] = total
