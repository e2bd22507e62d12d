"""Range-bearing(-elevation) sensors with Gaussian noise and uniform clutter, (MA)ASI (3)-(10), (25), (34).

Yousuf, Herzal, Lendek, Buşoniu, "Multi-agent active multi-target search with intermittent measurements",
Control Engineering Practice, 2024.
"""

from dataclasses import dataclass
from math import pi
from typing import Literal

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray, NonNegative, Positive
from estimator.filter import Area
from estimator.kernels import kernel
from estimator.sensor import Look, checked_points, checked_poses, validated
from estimator.sensors.densities import own_likelihoods
from estimator.sensors.field_config import FieldConfig, field_of
from estimator.sensors.field_of_view import FieldOfView
from estimator.sensors.gating import gated_likelihoods

GATE_SIGMAS = 6.0  # a component further off than this has likelihood 0; 2e-9 of the Gaussian lies beyond


class RangeBearingConfig(FieldConfig, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A range-bearing sensor in a mission file. 3D areas need elevation_sigma_deg."""

    period_s: Positive
    range_sigma_m: Positive
    bearing_sigma_deg: Positive
    elevation_sigma_deg: Positive | None = None
    bearing_frame: Literal["world", "body"] = (
        "world"  # counter-clockwise from east, or from the yaw direction
    )
    clutter: NonNegative = 0.0  # expected false measurements in a set
    max_range_m: Positive | None = None  # clutter lies within it; default: the area's diagonal


@dataclass(frozen=True, slots=True, eq=False)
class RangeBearing:
    """Measurements (range m, bearing rad(, elevation rad)) of targets in 2D (3D).

    In 2D the heights of robot and target are ignored. Bearings are (8): in the world frame, or relative to
    yaw if `body_frame`. Elevation is the angle above the horizontal plane (9). Clutter is uniform over its
    support `clutter_low`..`clutter_high` in (range, bearing(, elevation)); its volume is the product of the
    sides in m rad(^2), without a sine for the elevation. A sector's clutter lies within the sector,
    otherwise it lies within max_range_m all around (elevations -pi/2..pi/2). A target exactly above the
    sensor, or on it, has bearing 0, and on it elevation 0.
    """

    field: FieldOfView
    sigmas: FloatArray  # (s,) m, rad(, rad)
    clutter: float  # expected false measurements in a set
    clutter_low: FloatArray  # (s,)
    clutter_high: FloatArray  # (s,)
    body_frame: bool = False

    Config = RangeBearingConfig

    @staticmethod
    def of(config: RangeBearingConfig, area: Area) -> "RangeBearing":
        """The model that a mission's table describes.

        Raises:
            ValueError: if a key is missing or does not fit the area's dimension; names the key.
        """
        d = area.dimension
        if (d == 3) != (config.elevation_sigma_deg is not None):
            raise ValueError(f"elevation_sigma_deg: needed in 3D and only there, the area is {d}D")
        sigmas = [config.range_sigma_m, np.radians(config.bearing_sigma_deg)]
        low, high = [0.0, -pi], [config.max_range_m or float(np.linalg.norm(area.high - area.low)), pi]
        if config.elevation_sigma_deg is not None:
            sigmas.append(np.radians(config.elevation_sigma_deg))
            low.append(-pi / 2)
            high.append(pi / 2)
        field = field_of(config, d)
        if field.shape == "sector":
            low[0], high[0] = float(field.size[0]), float(field.size[1])
            low[1], high[1] = -float(field.size[2]) / 2, float(field.size[2]) / 2
        return RangeBearing(
            field,
            np.array(sigmas),
            config.clutter,
            np.array(low),
            np.array(high),
            config.bearing_frame == "body",
        )

    @property
    def dimension(self) -> int:
        return self.field.dimension

    @property
    def measurement_size(self) -> int:
        return self.field.dimension

    def detection(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        """p_D of points (d, n) from poses (k, 4), shape (k, n)."""
        return self.field.detection(points, poses)

    def look(self, points: FloatArray, pose: FloatArray, measurements: FloatArray) -> Look:
        """All that a measurement set (m, s) taken at pose (4,) says about points (d, n).

        Raises:
            ValueError: if a shape is another, or a number of any argument is not finite.
        """
        measurements = validated(measurements, self.measurement_size)
        points = checked_points(points, self.dimension)
        detection = self.field.detection(points, pose)[0]
        pose = np.ascontiguousarray(pose, dtype=np.float64)
        offsets, indices, likelihood, finite = gated_likelihoods(
            points, pose, self._in_world(measurements, pose), self.sigmas, GATE_SIGMAS
        )
        if not finite:
            raise ValueError("points: every number must be finite")
        return Look(detection, offsets, indices, likelihood, self.clutter_intensity(measurements, pose))

    def own_look(
        self, points: FloatArray, pose: FloatArray, measurements: FloatArray, owners: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """p_D (n,) of points (d, n), and g (n,) of each under its own measurement, that of row owners (n,).

        Raises:
            ValueError: if a shape is another, or a number of any argument is not finite.
        """
        detection = self.field.detection(points, pose)[0]
        z = self._in_world(validated(measurements, self.measurement_size), pose)
        likelihood, finite = own_likelihoods(points, pose, z, owners, self.sigmas, GATE_SIGMAS)
        if not finite:
            raise ValueError("points: every number must be finite")
        return detection, likelihood

    def clutter_intensity(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """c(z; q) (m,), false measurements per m rad(^2): uniform on the support, 0 outside."""
        out = np.zeros(len(measurements))
        if self.clutter > 0.0:
            _uniform_clutter(
                measurements, self.clutter_low, self.clutter_high, self._clutter_turn(pose), self.clutter, out
            )
        return out

    def locate(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """The point (d, m) that each measurement (m, s) would come from without noise.

        A negative range counts as 0.
        """
        return self.located(measurements, pose)[0]

    def location_covariance(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """Covariance (m, d, d) in m^2 of `locate`, to first order in the angles.

        Across the line of sight the mean square of the range, r^2 + sigma_r^2, is used instead of r^2, so
        that a target on the sensor has a covariance too.
        """
        return self.located(measurements, pose)[1]

    def located(self, measurements: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`locate` and `location_covariance` at once."""
        pose = checked_poses(pose)[0]
        z = self._in_world(validated(measurements, self.measurement_size), pose)
        d = self.dimension
        places, covariances = np.empty((d, len(z))), np.empty((len(z), d, d))
        _locate(z, pose, self.sigmas, places, covariances)
        return places, covariances

    def measure(self, targets: FloatArray, pose: FloatArray) -> FloatArray:
        """Noiseless measurements (n, s) of targets (d, n), (6)-(9)."""
        targets = checked_points(targets, self.dimension)
        pose = checked_poses(pose)[0]
        dx, dy = targets[0] - pose[0], targets[1] - pose[1]
        level = np.hypot(dx, dy)
        bearing = np.arctan2(dy, dx) - (pose[3] if self.body_frame else 0.0)
        columns = [level, wrapped(bearing)]
        if self.dimension == 3:
            dz = targets[2] - pose[2]
            columns = [np.hypot(level, dz), wrapped(bearing), np.arctan2(dz, level)]
        return np.stack(columns, axis=1)

    @property
    def noise(self) -> FloatArray:
        """diag(sigma^2), (s, s)."""
        return np.diag(self.sigmas**2)

    @property
    def angular(self) -> BoolArray:
        """Bearing and elevation are angles."""
        return np.arange(self.measurement_size) > 0

    def jacobian(self, targets: FloatArray, pose: FloatArray) -> FloatArray:
        """Derivatives (n, s, d) of (6)-(9) at targets (d, n).

        Where a direction is not defined (on the sensor, or above it for the bearing), its derivative is 0.
        """
        targets = checked_points(targets, self.dimension)
        pose = checked_poses(pose)[0]
        out = np.zeros((targets.shape[1], self.measurement_size, self.dimension))
        differentiate(targets, pose, out)
        return out

    def sample(self, targets: FloatArray, pose: FloatArray, rng: np.random.Generator) -> FloatArray:
        """One random measurement set (m, s) of targets (d, n): detections, noise and clutter, shuffled."""
        pose = checked_poses(pose)[0]
        targets = checked_points(targets, self.dimension)
        seen = rng.random(targets.shape[1]) < self.field.detection(targets, pose)[0]
        z = self.measure(targets[:, seen], pose)
        z += rng.standard_normal(z.shape) * self.sigmas
        false = rng.uniform(
            self.clutter_low, self.clutter_high, (rng.poisson(self.clutter), self.measurement_size)
        )
        false[:, 1] += self._clutter_turn(pose)
        z = np.concatenate([z, false])
        z[:, 1] = wrapped(z[:, 1])
        return rng.permutation(z, axis=0)

    def outline(self, pose: FloatArray) -> FloatArray:
        """A closed polyline (k, 3) that shows the field of view at pose, for people."""
        return self.field.outline(checked_poses(pose)[0])

    def _in_world(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        if not self.body_frame:
            return measurements
        turned = measurements.copy()
        turned[:, 1] += pose[3]
        return turned

    def _clutter_turn(self, pose: FloatArray) -> float:
        """What turns the clutter's support: a sector follows yaw also where bearings do not."""
        return float(pose[3]) if self.field.shape == "sector" and not self.body_frame else 0.0


@kernel
def _locate(
    z: FloatArray, pose: FloatArray, sigmas: FloatArray, places: FloatArray, covariances: FloatArray
) -> None:
    """Positions (d, m) and their covariances (m, d, d) of measurements (m, d) in the world frame."""
    d = z.shape[1]
    axes, scale = np.zeros((d, d)), np.zeros(d)
    for j in range(z.shape[0]):
        r = max(z[j, 0], 0.0)
        across = r * r + sigmas[0] * sigmas[0]
        c, s = np.cos(z[j, 1]), np.sin(z[j, 1])
        ce, se = (np.cos(z[j, 2]), np.sin(z[j, 2])) if d == 3 else (1.0, 0.0)
        places[0, j], places[1, j] = pose[0] + r * ce * c, pose[1] + r * ce * s
        axes[0, 0], axes[0, 1] = ce * c, ce * s
        axes[1, 0], axes[1, 1] = -s, c
        scale[0] = sigmas[0] ** 2
        scale[1] = across * sigmas[1] ** 2
        if d == 3:
            places[2, j] = pose[2] + r * se
            axes[0, 2] = se
            axes[2, 0], axes[2, 1], axes[2, 2] = -se * c, -se * s, ce
            scale[1] *= max(ce * ce, sigmas[2] ** 2)
            scale[2] = across * sigmas[2] ** 2
        for a in range(d):
            for b in range(d):
                total = 0.0
                for k in range(d):
                    total += axes[k, a] * scale[k] * axes[k, b]
                covariances[j, a, b] = total


@kernel
def differentiate(targets: FloatArray, pose: FloatArray, out: FloatArray) -> None:
    """d(range, bearing(, elevation))/dx (n, d, d) at targets (d, n)."""
    d = targets.shape[0]
    for i in range(targets.shape[1]):
        dx, dy = targets[0, i] - pose[0], targets[1, i] - pose[1]
        dz = targets[2, i] - pose[2] if d == 3 else 0.0
        flat = dx * dx + dy * dy
        square = flat + dz * dz
        if square > 0.0:
            r = np.sqrt(square)
            out[i, 0, 0], out[i, 0, 1] = dx / r, dy / r
            if d == 3:
                out[i, 0, 2] = dz / r
        if flat > 0.0:
            out[i, 1, 0], out[i, 1, 1] = -dy / flat, dx / flat
            if d == 3:
                level = np.sqrt(flat)
                out[i, 2, 0], out[i, 2, 1] = -dz * dx / (level * square), -dz * dy / (level * square)
                out[i, 2, 2] = level / square


@kernel
def _uniform_clutter(
    z: FloatArray, low: FloatArray, high: FloatArray, turn: float, rate: float, out: FloatArray
) -> None:
    """rate / volume where z (m, s) lies in the support, whose bearings are turned by `turn`."""
    density = rate
    for a in range(low.size):
        density /= high[a] - low[a]
    for j in range(z.shape[0]):
        inside = True
        for a in range(low.size):
            x = z[j, a]
            if a == 1:
                x = (x - turn + pi) % (2.0 * pi) - pi
            inside = inside and low[a] <= x <= high[a]
        out[j] = density if inside else 0.0


def wrapped(angles: FloatArray) -> FloatArray:
    """Angles brought into -pi..pi."""
    return np.asarray((angles + pi) % (2 * pi) - pi)
