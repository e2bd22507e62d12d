"""Fields of view that can be differentiated: values and derivatives by the pose, for gradient-based planning.

Liu & Hedrick, "Model predictive control-based target search and tracking using autonomous mobile robot with
limited sensing domain", 2017, (7).
"""

import numpy as np

from estimator.arrays import FloatArray
from estimator.kernels import exp_negative, kernel


@kernel
def _sigmoid(x: float) -> float:
    tail = exp_negative(-abs(x))
    return (1.0 if x >= 0.0 else tail) / (1.0 + tail)


@kernel
def smooth_sector(
    points: FloatArray, poses: FloatArray, gain: float, size: FloatArray, out: FloatArray
) -> None:
    """(7) of points (d, n) from poses (k, 4) into out (k, n); size (alpha_1, alpha_2, full opening).

    The yaw direction is meant in the horizontal plane; on the sensor and above it, its cosine is 1.
    """
    edge = np.cos(0.5 * size[2])
    for k in range(poses.shape[0]):
        c, s = np.cos(poses[k, 3]), np.sin(poses[k, 3])
        for i in range(points.shape[1]):
            dx, dy = points[0, i] - poses[k, 0], points[1, i] - poses[k, 1]
            dz = points[2, i] - poses[k, 2] if points.shape[0] == 3 else 0.0
            level2 = dx * dx + dy * dy
            cosine = (c * dx + s * dy) / np.sqrt(level2) if level2 > 0.0 else 1.0
            near = 1.0 / (1.0 + size[0] * (level2 + dz * dz))
            out[k, i] = gain * near * _sigmoid(size[1] * (cosine - edge))


@kernel
def smooth_sector_slopes(
    points: FloatArray, poses: FloatArray, gain: float, size: FloatArray, out: FloatArray
) -> None:
    """Derivatives (k, n, 4) of `smooth_sector` by x, y, z and yaw of the pose."""
    edge = np.cos(0.5 * size[2])
    for k in range(poses.shape[0]):
        c, s = np.cos(poses[k, 3]), np.sin(poses[k, 3])
        for i in range(points.shape[1]):
            dx, dy = points[0, i] - poses[k, 0], points[1, i] - poses[k, 1]
            dz = points[2, i] - poses[k, 2] if points.shape[0] == 3 else 0.0
            level2 = dx * dx + dy * dy
            level = np.sqrt(level2)
            cosine = (c * dx + s * dy) / level if level2 > 0.0 else 1.0
            near = 1.0 / (1.0 + size[0] * (level2 + dz * dz))
            ahead = _sigmoid(size[1] * (cosine - edge))
            by_square = -gain * size[0] * near * near * ahead
            by_cosine = gain * near * size[1] * ahead * (1.0 - ahead)
            out[k, i, 0] = -2.0 * dx * by_square
            out[k, i, 1] = -2.0 * dy * by_square
            out[k, i, 2] = -2.0 * dz * by_square
            if level2 > 0.0:
                out[k, i, 0] -= by_cosine * (c - cosine * dx / level) / level
                out[k, i, 1] -= by_cosine * (s - cosine * dy / level) / level
                out[k, i, 3] = by_cosine * (c * dy - s * dx) / level


@kernel
def exponential_slopes(
    points: FloatArray, poses: FloatArray, gain: float, reach: FloatArray, out: FloatArray
) -> None:
    """Derivatives (k, n, 4) of the exponential field of view, (MA)ASI (3)-(4), by x, y, z and yaw."""
    d = points.shape[0]
    for k in range(poses.shape[0]):
        for i in range(points.shape[1]):
            square = 0.0
            for a in range(d):
                square += ((points[a, i] - poses[k, a]) / reach[a]) ** 2
            if square > 0.0:
                scaled = np.sqrt(square)
                factor = 0.5 * gain * exp_negative(-0.5 * scaled) / scaled
                for a in range(d):
                    out[k, i, a] = factor * (points[a, i] - poses[k, a]) / (reach[a] * reach[a])
