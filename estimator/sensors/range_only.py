"""Range-only sensors: a radio that gives distances, Dames & Kumar 2015 section V-E.

Dames & Kumar, "Autonomous localization of an unknown number of targets without data association using teams
of mobile sensors", IEEE Transactions on Automation Science and Engineering 12(3), 2015. The paper draws the
detection probability (fig. 13a) and says that it decays steadily with distance; here it falls linearly from
the gain at the sensor to 0 at r_max, unless a table says otherwise.
"""

from dataclasses import dataclass, replace
from math import pi
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from estimator.arrays import BoolArray, FloatArray, IntArray, NonNegative, Positive
from estimator.filter import Area
from estimator.kernels import kernel
from estimator.sensor import Look, checked_points, checked_poses, validated
from estimator.sensors.additive import detectable, finite_points, gated_look, sampled
from estimator.sensors.field_config import FieldConfig, field_of
from estimator.sensors.field_of_view import FieldOfView
from estimator.sensors.range_bearing import differentiate

_CHUNK = 4096  # measurements located at once, so that a million of them need no more memory


class RangeOnlyConfig(FieldConfig, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A range-only sensor in a mission file, by default that of Dames & Kumar section V-E."""

    period_s: Positive
    range_sigma_m: Positive = 1.0
    field_of_view: Literal["exponential", "box", "sector", "smooth_sector"] = "sector"
    range_m: Positive | None = 5.0
    angle_deg: Annotated[float, Meta(gt=0, le=360)] | None = 360.0
    clutter: NonNegative = 0.1  # mu, expected false measurements in a set
    max_range_m: Positive | None = (
        None  # other fields of view: clutter lies within it; default: area's diagonal
    )


@dataclass(frozen=True, slots=True, eq=False)
class RangeOnly:
    """Measurements (range m,) of targets in 2D or 3D.

    A measurement says that a target is on a circle or sphere. `locate` therefore gives the mean place, and
    `location_covariance` the covariance of the place, of a target that could be anywhere there as far as it
    is detected. All around the sensor that is a poor summary: the mean is the sensor's own place. In 2D the
    heights of robot and target are ignored.
    """

    field: FieldOfView
    sigma: float  # m
    clutter: float  # expected false measurements in a set
    clutter_low: float  # m
    clutter_high: float  # m

    Config = RangeOnlyConfig

    @staticmethod
    def of(config: RangeOnlyConfig, area: Area) -> "RangeOnly":
        """The model that a mission's table describes.

        Raises:
            ValueError: if a key is missing or does not fit the area's dimension; names the key.
        """
        field = field_of(config, area.dimension)
        low, high = 0.0, config.max_range_m or float(np.linalg.norm(area.high - area.low))
        if field.shape == "sector":
            low, high = float(field.size[0]), float(field.size[1])
            if field.breaks.size == 0:
                field = replace(field, breaks=np.array([0.0, high]), gains=np.array([1.0, 0.0]))
        return RangeOnly(field, config.range_sigma_m, config.clutter, low, high)

    @property
    def dimension(self) -> int:
        return self.field.dimension

    @property
    def measurement_size(self) -> int:
        return 1

    @property
    def noise(self) -> FloatArray:
        """sigma^2, (1, 1)."""
        return np.array([[self.sigma**2]])

    @property
    def angular(self) -> BoolArray:
        """A range is no angle."""
        return np.zeros(1, dtype=np.bool_)

    def detection(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        """p_D of points (d, n) from poses (k, 4), shape (k, n)."""
        return self.field.detection(points, poses)

    def look(self, points: FloatArray, pose: FloatArray, measurements: FloatArray) -> Look:
        """All that a measurement set (m, 1) taken at pose (4,) says about points (d, n).

        Points with p_D = 0 are in no measurement's row.

        Raises:
            ValueError: if a shape is another, or a number of any argument is not finite.
        """
        z = validated(measurements, 1)
        points = finite_points(points, self.dimension)
        detection = self.field.detection(points, pose)[0]
        kept = detectable(detection)
        ranges = np.empty((1, kept.size))
        _ranges(points, kept, checked_poses(pose)[0], ranges[0])
        clutter = self.clutter_intensity(z, pose)
        return gated_look(detection, ranges, kept, z, np.array([self.sigma]), clutter, circular=False)

    def clutter_intensity(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """c(z; q) (m,), false measurements per m: uniform within the sensor's reach, 0 outside."""
        z = validated(measurements, 1)[:, 0]
        inside = (z >= self.clutter_low) & (z <= self.clutter_high)
        return np.asarray(self.clutter / (self.clutter_high - self.clutter_low) * inside)

    def locate(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """The mean place (d, m) of the targets that each measurement (m, 1) may come from.

        A negative range counts as 0.
        """
        return self._located(measurements, pose)[0]

    def location_covariance(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """Covariance (m, d, d) in m^2 of the places that each measurement may come from."""
        return self._located(measurements, pose)[1]

    def _located(self, measurements: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        pose = checked_poses(pose)[0]
        z = np.maximum(validated(measurements, 1)[:, 0], 0.0)
        d, m = self.dimension, len(z)
        places, covariances = np.empty((d, m)), np.empty((m, d, d))
        for begin in range(0, m, _CHUNK):
            part = slice(begin, begin + _CHUNK)
            places[:, part], covariances[part] = self._around(z[part], pose)
        return places, covariances

    def _around(self, z: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Moments of the places, whose density over directions is p_D."""
        d = self.dimension
        units = _UNITS[d].copy()
        c, s = np.cos(pose[3]), np.sin(pose[3])  # turned with the field's edges, where it has some that turn
        units[:2] = np.stack([c * units[0] - s * units[1], s * units[0] + c * units[1]])
        nodes = pose[:d, None, None] + z[:, None] * units[:, None, :]
        weights = self.field.detection(nodes.reshape(d, -1), pose)[0].reshape(len(z), -1)
        weights[weights.sum(axis=1) <= 0.0] = 1.0  # where nothing is detected, all around
        weights /= weights.sum(axis=1, keepdims=True)
        mean, square = units @ weights.T, np.einsum("ak,bk,mk->mab", units, units, weights, optimize=True)
        ring = square - mean.T[:, :, None] * mean.T[:, None, :]
        return pose[:d, None] + z * mean, z[:, None, None] ** 2 * ring + self.sigma**2 * square

    def measure(self, targets: FloatArray, pose: FloatArray) -> FloatArray:
        """Noiseless measurements (n, 1) of targets (d, n)."""
        targets = checked_points(targets, self.dimension)
        offsets = targets - checked_poses(pose)[0, : self.dimension, None]
        return np.asarray(np.sqrt((offsets**2).sum(axis=0))[:, None])

    def jacobian(self, targets: FloatArray, pose: FloatArray) -> FloatArray:
        """Derivatives (n, 1, d) of the range at targets (d, n); 0 on the sensor."""
        targets = checked_points(targets, self.dimension)
        out = np.zeros((targets.shape[1], self.dimension, self.dimension))
        differentiate(targets, checked_poses(pose)[0], out)
        return np.ascontiguousarray(out[:, :1])

    def sample(self, targets: FloatArray, pose: FloatArray, rng: np.random.Generator) -> FloatArray:
        """One random measurement set (m, 1) of targets (d, n): detections, noise and clutter, shuffled."""
        false = rng.uniform(self.clutter_low, self.clutter_high, (rng.poisson(self.clutter), 1))
        return sampled(self, targets, checked_poses(pose)[0], np.array([self.sigma]), false, rng)

    def outline(self, pose: FloatArray) -> FloatArray:
        """A closed polyline (k, 3) that shows the field of view at pose, for people."""
        return self.field.outline(checked_poses(pose)[0])


def _sphere(count: int) -> FloatArray:
    """`count` unit vectors (3, count) spread evenly, on a spiral of the golden angle."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = pi * (3.0 - 5.0**0.5) * np.arange(count)
    level = np.sqrt(1.0 - z * z)
    return np.stack([level * np.cos(turn), level * np.sin(turn), z])


def _circle(count: int) -> FloatArray:
    """`count` unit vectors (2, count) spread evenly."""
    turn = 2.0 * pi * np.arange(count) / count
    return np.stack([np.cos(turn), np.sin(turn)])


_UNITS = {2: _circle(96), 3: _sphere(384)}


@kernel
def _ranges(points: FloatArray, kept: IntArray, pose: FloatArray, out: FloatArray) -> None:
    """Distances (k,) of the points with the numbers kept (k,)."""
    for i in range(kept.size):
        square = 0.0
        for a in range(points.shape[0]):
            square += (points[a, kept[i]] - pose[a]) ** 2
        out[i] = np.sqrt(square)
