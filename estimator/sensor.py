"""The seam between sensors and everything that reasons about them.

A sensor model answers three questions about n points x and one pose q: would a target there be detected
(p_D), how well does each measurement fit it (g), and how often does each measurement come from nothing (c).
Filters and planners know only this, so a new sensor works with all of them at once.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, cast

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel


@dataclass(frozen=True, slots=True)
class Look:
    """What one measurement set of m measurements says about n points.

    The likelihoods are sparse: measurement j touches the points `indices[offsets[j]:offsets[j + 1]]`,
    those inside its gate, and no others.
    """

    detection: FloatArray  # (n,) p_D(x; q)
    offsets: IntArray  # (m + 1,)
    indices: IntArray  # (offsets[m],)
    likelihood: FloatArray  # (offsets[m],) g(z | x; q), in 1 / unit of z
    clutter: FloatArray  # (m,) c(z; q), false measurements per unit of z


class SensorModel(Protocol):
    """p_D, g and c of one kind of sensor, on a target space of dimension d = 2 or 3."""

    @property
    def dimension(self) -> int:
        """d, of the target space."""

    @property
    def measurement_size(self) -> int:
        """s, how many numbers one measurement has."""

    def detection(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        """p_D of points (d, n) from poses (k, 4), shape (k, n)."""

    def look(self, points: FloatArray, pose: FloatArray, measurements: FloatArray) -> Look:
        """All that a measurement set (m, s) taken at pose (4,) says about points (d, n)."""

    def locate(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """The point (d, m) that each measurement (m, s) would come from without noise."""

    def location_covariance(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """Covariance (m, d, d) in m^2 of `locate` under the sensor's noise."""

    def clutter_intensity(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """c(z; q) (m,) of measurements (m, s), false measurements per unit of z."""

    def sample(self, targets: FloatArray, pose: FloatArray, rng: np.random.Generator) -> FloatArray:
        """One random measurement set (m, s) of targets (d, n): detections, noise and clutter, shuffled."""

    def outline(self, pose: FloatArray) -> FloatArray:
        """A closed polyline (k, 3) that shows the field of view at pose, for people."""


class OwnLook(Protocol):
    """A sensor that can answer, quicker than by a look at all pairs, what is asked of proposals."""

    def own_look(
        self, points: FloatArray, pose: FloatArray, measurements: FloatArray, owners: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """p_D (n,) of points (d, n), and g (n,) of each under its own measurement, row owners (n,)."""

    def located(self, measurements: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`locate` (d, m) and `location_covariance` (m, d, d) at once."""


class GaussianSensor(SensorModel, Protocol):
    """A sensor with z = h(x; q) + Gaussian noise, as Kalman updates need it."""

    @property
    def noise(self) -> FloatArray:
        """Covariance (s, s) of a measurement's noise."""

    @property
    def angular(self) -> BoolArray:
        """(s,) which numbers of a measurement are angles, whose differences wrap into -pi..pi."""

    def measure(self, targets: FloatArray, pose: FloatArray) -> FloatArray:
        """h: noiseless measurements (n, s) of targets (d, n) from pose (4,)."""

    def jacobian(self, targets: FloatArray, pose: FloatArray) -> FloatArray:
        """dh/dx (n, s, d) at targets (d, n); finite everywhere, also on the sensor itself."""


Sensors = Mapping[str, SensorModel]


def gaussian(sensor: SensorModel) -> GaussianSensor:
    """The sensor, if its noise is Gaussian.

    Raises:
        ValueError: if it is not: what uses Kalman updates cannot use this sensor.
    """
    inner: object = sensor
    while hasattr(inner, "sensor"):  # what wraps a sensor forwards a Jacobian whether there is one or not
        inner = inner.sensor
    if not hasattr(inner, "jacobian"):
        raise ValueError(
            f"sensor: a Kalman update needs Gaussian noise and a Jacobian, {type(inner).__name__} has none; "
            "use a particle filter with it"
        )
    return cast(GaussianSensor, sensor)


def own_look(sensor: SensorModel) -> OwnLook | None:
    """The sensor, if it has an `own_look`. (A Protocol's isinstance takes ten times as long as this.)"""
    return cast(OwnLook, sensor) if hasattr(sensor, "own_look") else None


@kernel
def _all_finite(numbers: FloatArray) -> bool:
    finite = True
    for i in range(numbers.size):
        finite &= np.isfinite(numbers[i])
    return finite


def _finite(array: FloatArray) -> bool:
    """Whether all numbers of a contiguous array are finite; np.isfinite(array).all() takes thrice as long."""
    return bool(_all_finite(array.reshape(-1)))


def validated(measurements: FloatArray, size: int) -> FloatArray:
    """`measurements` as a contiguous (m, size) array.

    Raises:
        ValueError: if the shape is another or a number is not finite.
    """
    array = np.ascontiguousarray(measurements, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != size:
        raise ValueError(f"measurements: expected shape (m, {size}), got {array.shape}")
    if not _finite(array):
        raise ValueError("measurements: every number must be finite")
    return array


def checked_points(points: FloatArray, dimension: int) -> FloatArray:
    """`points` as a contiguous (dimension, n) array.

    Raises:
        ValueError: if the shape is another.
    """
    array = np.ascontiguousarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[0] != dimension:
        raise ValueError(f"points: expected shape ({dimension}, n), got {array.shape}")
    return array


def checked_poses(poses: FloatArray) -> FloatArray:
    """`poses` as a contiguous (k, 4) array; one pose (4,) becomes (1, 4).

    Raises:
        ValueError: if the shape is another or a number is not finite.
    """
    array = np.ascontiguousarray(poses, dtype=np.float64)
    if array.ndim == 1:
        array = array[None, :]
    if array.ndim != 2 or array.shape[1] != 4:
        raise ValueError(f"pose: expected shape (4,) or (k, 4), got {array.shape}")
    if not _finite(array):
        raise ValueError("pose: every number must be finite")
    return array
