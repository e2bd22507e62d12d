"""What sensors share whose measurements are h(x; q) plus Gaussian noise."""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.sensor import GaussianSensor, Look, checked_points
from estimator.sensors.bands import GATE_SIGMAS, gated_gaussian


def finite_points(points: FloatArray, dimension: int) -> FloatArray:
    """`points` as a contiguous (dimension, n) array of finite numbers.

    Raises:
        ValueError: if the shape is another or a number is not finite.
    """
    points = checked_points(points, dimension)
    if not np.isfinite(points).all():
        raise ValueError("points: every number must be finite")
    return points


def detectable(detection: FloatArray) -> IntArray:
    """The numbers of the points with p_D > 0: a measurement says nothing about the others."""
    return np.flatnonzero(detection)


def gated_look(
    detection: FloatArray,
    coordinates: FloatArray,
    kept: IntArray,
    measurements: FloatArray,
    sigmas: FloatArray,
    clutter: FloatArray,
    circular: bool,
) -> Look:
    """The look of measurements (m, s) at points of which those `kept` (k,) have h = coordinates (s, k).

    `circular`: the first component is an angle.
    """
    rows = gated_gaussian(coordinates, kept, measurements, sigmas, GATE_SIGMAS, circular)
    return Look(detection, *rows, clutter)


def sampled(
    sensor: GaussianSensor,
    targets: FloatArray,
    pose: FloatArray,
    sigmas: FloatArray,
    false: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """A measurement set (m, s): noisy detections of targets (d, n) and the false ones (f, s), shuffled."""
    targets = checked_points(targets, sensor.dimension)
    seen = rng.random(targets.shape[1]) < sensor.detection(targets, pose)[0]
    z = sensor.measure(np.ascontiguousarray(targets[:, seen]), pose)
    z += rng.standard_normal(z.shape) * sigmas
    return rng.permutation(np.concatenate([z, false]), axis=0)
