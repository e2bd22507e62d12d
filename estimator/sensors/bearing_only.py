"""Bearing-only sensors: a laser scanner or a camera that gives directions, Dames & Kumar 2015 (29)-(31).

Dames & Kumar, "Autonomous localization of an unknown number of targets without data association using teams
of mobile sensors", IEEE Transactions on Automation Science and Engineering 12(3), 2015. The paper does not
print the angle between two beams; 0.25 degrees is that of scanners with its opening of 270 degrees.
"""

from dataclasses import dataclass
from math import pi
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from estimator.arrays import BoolArray, FloatArray, Fraction, IntArray, NonNegative, Positive
from estimator.filter import Area
from estimator.kernels import kernel
from estimator.sensor import Look, checked_points, checked_poses, validated
from estimator.sensors.additive import detectable, finite_points, gated_look, sampled
from estimator.sensors.bands import arctangent
from estimator.sensors.field_config import FieldConfig, field_of
from estimator.sensors.field_of_view import FieldOfView
from estimator.sensors.range_bearing import differentiate, wrapped

Sigma = Annotated[float, Meta(gt=0, le=30)]  # degrees; wider ones would meet themselves behind the sensor

_NODES = 48  # along a ray
_CHUNK = 4096  # measurements located at once, so that a million of them need no more memory


class BearingOnlyConfig(FieldConfig, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A bearing-only sensor in a mission file, by default that of Dames & Kumar. 3D areas need elevations."""

    period_s: Positive
    bearing_sigma_deg: Sigma = 2.25
    elevation_sigma_deg: Sigma | None = None
    bearing_frame: Literal["world", "body"] = "body"
    gain: Fraction = 0.79  # 1 - p_fn
    field_of_view: Literal["exponential", "box", "sector", "smooth_sector"] = "sector"
    range_m: Positive | None = 5.0
    angle_deg: Annotated[float, Meta(gt=0, le=360)] | None = 270.0
    target_diameter_m: Positive = 0.0325  # d_t
    beam_separation_deg: NonNegative = 0.25  # theta_sep; 0 is a sensor without gaps between beams
    clutter: NonNegative = 0.532  # mu, expected false measurements in a set
    clutter_uniform: Fraction = (
        0.725  # p_u; the rest of the clutter lies in peaks at +-90 degrees off the yaw
    )
    clutter_peak_deg: Annotated[float, Meta(gt=0, le=180)] = 36.0  # theta_c, width of each peak
    max_range_m: Positive | None = (
        None  # other fields of view: targets are within it; default: area's diagonal
    )


@dataclass(frozen=True, slots=True, eq=False)
class BearingOnly:
    """Measurements (bearing rad(, elevation rad)) of targets in 2D (3D).

    A measurement says which way a target is and not how far. `locate` therefore gives the mean place, and
    `location_covariance` the covariance of the place, of a target that could be anywhere along the ray as far
    as it is detected there. Bearings are in the frame of the robot if `body_frame`, else in the world's.
    Elevation is the angle above the horizontal plane; clutter is uniform over -pi/2..pi/2 of it. A target
    exactly above the sensor, or on it, has bearing 0 in the world's frame, and on it elevation 0.
    """

    field: FieldOfView
    sigmas: FloatArray  # (s,) rad
    clutter: float  # expected false measurements in a set
    clutter_uniform: float  # share of it that is uniform over the opening
    clutter_peak: float  # rad, width of each of the two peaks
    opening: float  # rad, of the clutter about the yaw
    reach: float  # m, no target is expected further away
    body_frame: bool = True

    Config = BearingOnlyConfig

    @staticmethod
    def of(config: BearingOnlyConfig, area: Area) -> "BearingOnly":
        """The model that a mission's table describes.

        Raises:
            ValueError: if a key is missing or does not fit the rest; names the key.
        """
        d = area.dimension
        if (d == 3) != (config.elevation_sigma_deg is not None):
            raise ValueError(f"elevation_sigma_deg: needed in 3D and only there, the area is {d}D")
        sigmas = [np.radians(config.bearing_sigma_deg)]
        if config.elevation_sigma_deg is not None:
            sigmas.append(np.radians(config.elevation_sigma_deg))
        separation = float(np.radians(config.beam_separation_deg))
        field = field_of(config, d, config.target_diameter_m / separation if separation > 0.0 else np.inf)
        opening, reach = 2 * pi, config.max_range_m or float(np.linalg.norm(area.high - area.low))
        if field.shape == "sector":
            opening, reach = float(field.size[2]), float(field.size[1])
        peak = float(np.radians(config.clutter_peak_deg))
        if config.clutter_uniform < 1.0 and pi + peak > opening + 1e-9:
            raise ValueError(
                "clutter_uniform: must be 1 where angle_deg does not reach the clutter's peaks at 90 degrees"
            )
        body = config.bearing_frame == "body"
        return BearingOnly(
            field, np.array(sigmas), config.clutter, config.clutter_uniform, peak, opening, reach, body
        )

    @property
    def dimension(self) -> int:
        return self.field.dimension

    @property
    def measurement_size(self) -> int:
        return self.field.dimension - 1

    @property
    def noise(self) -> FloatArray:
        """diag(sigma^2), (s, s)."""
        return np.diag(self.sigmas**2)

    @property
    def angular(self) -> BoolArray:
        """All components."""
        return np.ones(self.measurement_size, dtype=np.bool_)

    def detection(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        """p_D (29) of points (d, n) from poses (k, 4), shape (k, n)."""
        return self.field.detection(points, poses)

    def look(self, points: FloatArray, pose: FloatArray, measurements: FloatArray) -> Look:
        """All that a measurement set (m, s) taken at pose (4,) says about points (d, n), (30).

        Points with p_D = 0 are in no measurement's row.

        Raises:
            ValueError: if a shape is another, or a number of any argument is not finite.
        """
        z = validated(measurements, self.measurement_size)
        points = finite_points(points, self.dimension)
        detection = self.field.detection(points, pose)[0]
        pose = checked_poses(pose)[0]
        kept = detectable(detection)
        directions = np.empty((self.measurement_size, kept.size))
        _directions(points, kept, pose, directions)
        clutter = self.clutter_intensity(z, pose)
        return gated_look(
            detection, directions, kept, self._in_world(z, pose), self.sigmas, clutter, circular=True
        )

    def clutter_intensity(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """c(z; q) (31) (m,), false measurements per rad(^2)."""
        z = validated(measurements, self.measurement_size)
        off = np.abs(wrapped(z[:, 0] - (0.0 if self.body_frame else float(pose[3]))))
        even, peaked = self.clutter_uniform, 1.0 - self.clutter_uniform
        density = even / self.opening * (off <= self.opening / 2)
        density += peaked / (2 * self.clutter_peak) * (np.abs(off - pi / 2) <= self.clutter_peak / 2)
        if self.dimension == 3:
            density = density / pi * (np.abs(z[:, 1]) <= pi / 2)
        return np.asarray(self.clutter * density)

    def locate(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """The mean place (d, m) of the targets that each measurement (m, s) may come from."""
        return self._located(measurements, pose)[0]

    def location_covariance(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """Covariance (m, d, d) in m^2 of the places that each measurement may come from: long, narrow."""
        return self._located(measurements, pose)[1]

    def _located(self, measurements: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        pose = checked_poses(pose)[0]
        z = self._in_world(validated(measurements, self.measurement_size), pose)
        d, m = self.dimension, len(z)
        places, covariances = np.empty((d, m)), np.empty((m, d, d))
        for begin in range(0, m, _CHUNK):
            part = slice(begin, begin + _CHUNK)
            places[:, part], covariances[part] = self._along_rays(z[part], pose)
        return places, covariances

    def _along_rays(self, z: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Moments of the places, whose density over the range is r^(d-1) p_D."""
        d = self.dimension
        axes, tilt = _axes(z)
        step = self.reach / _NODES
        ranges = step * (np.arange(_NODES) + 0.5)
        nodes = pose[:d, None, None] + axes[0][:, :, None] * ranges
        even = ranges ** (d - 1)
        weights = even * self.field.detection(nodes.reshape(d, -1), pose)[0].reshape(len(z), _NODES)
        weights[weights.sum(axis=1) <= 0.0] = even  # where nothing is detected, anywhere in reach
        weights /= weights.sum(axis=1, keepdims=True)
        mean, square = weights @ ranges, weights @ ranges**2
        scales = [square - mean**2 + step**2 / 12, square * self.sigmas[0] ** 2]
        if d == 3:
            scales[1] = scales[1] * np.maximum(tilt**2, self.sigmas[1] ** 2)
            scales.append(square * self.sigmas[1] ** 2)
        covariance = sum(
            s[:, None, None] * np.einsum("am,bm->mab", a, a) for s, a in zip(scales, axes, strict=True)
        )
        return pose[:d, None] + axes[0] * mean, np.asarray(covariance)

    def measure(self, targets: FloatArray, pose: FloatArray) -> FloatArray:
        """Noiseless measurements (n, s) of targets (d, n)."""
        targets = checked_points(targets, self.dimension)
        pose = checked_poses(pose)[0]
        dx, dy = targets[0] - pose[0], targets[1] - pose[1]
        columns = [wrapped(np.arctan2(dy, dx) - (pose[3] if self.body_frame else 0.0))]
        if self.dimension == 3:
            columns.append(np.arctan2(targets[2] - pose[2], np.hypot(dx, dy)))
        return np.stack(columns, axis=1)

    def jacobian(self, targets: FloatArray, pose: FloatArray) -> FloatArray:
        """Derivatives (n, s, d) of the angles at targets (d, n); 0 where a direction is not defined."""
        targets = checked_points(targets, self.dimension)
        pose = checked_poses(pose)[0]
        out = np.zeros((targets.shape[1], self.dimension, self.dimension))
        differentiate(targets, pose, out)
        return np.ascontiguousarray(out[:, 1:])

    def sample(self, targets: FloatArray, pose: FloatArray, rng: np.random.Generator) -> FloatArray:
        """One random measurement set (m, s) of targets (d, n): detections, noise and clutter, shuffled."""
        pose = checked_poses(pose)[0]
        count = rng.poisson(self.clutter)
        even, side, place = rng.random((3, count))
        peak = np.where(side < 0.5, -pi / 2, pi / 2) + (place - 0.5) * self.clutter_peak
        false = [np.where(even < self.clutter_uniform, (place - 0.5) * self.opening, peak)]
        false[0] += 0.0 if self.body_frame else pose[3]
        if self.dimension == 3:
            false.append(rng.uniform(-pi / 2, pi / 2, count))
        z = sampled(self, targets, pose, self.sigmas, np.stack(false, axis=1), rng)
        z[:, 0] = wrapped(z[:, 0])
        return z

    def outline(self, pose: FloatArray) -> FloatArray:
        """A closed polyline (k, 3) that shows the field of view at pose, for people."""
        return self.field.outline(checked_poses(pose)[0])

    def _in_world(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        if not self.body_frame:
            return measurements
        turned = measurements.copy()
        turned[:, 0] += pose[3]
        return turned


def _axes(z: FloatArray) -> tuple[list[FloatArray], FloatArray]:
    """Unit vectors (d, m) along each direction z (m, s), across it(, and up); the elevations' cosines."""
    c, s = np.cos(z[:, 0]), np.sin(z[:, 0])
    if z.shape[1] == 1:
        return [np.stack([c, s]), np.stack([-s, c])], np.ones_like(c)
    ce, se, none = np.cos(z[:, 1]), np.sin(z[:, 1]), np.zeros_like(c)
    return [np.stack([ce * c, ce * s, se]), np.stack([-s, c, none]), np.stack([-se * c, -se * s, ce])], ce


@kernel
def _directions(points: FloatArray, kept: IntArray, pose: FloatArray, out: FloatArray) -> None:
    """Bearing in the world's frame (and elevation), out (s, k), of the points with the numbers kept (k,)."""
    for i in range(kept.size):
        dx, dy = points[0, kept[i]] - pose[0], points[1, kept[i]] - pose[1]
        out[0, i] = arctangent(dy, dx)
        if points.shape[0] == 3:
            out[1, i] = arctangent(points[2, kept[i]] - pose[2], np.sqrt(dx * dx + dy * dy))
