"""Sensors that give positions: a camera that looks down and knows where it is.

The footprint is usually a box, (MA)ASI (25) and (34): Yousuf, Herzal, Lendek, Buşoniu, Control Engineering
Practice, 2024.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from estimator.arrays import BoolArray, FloatArray, NonNegative, Positive
from estimator.filter import Area
from estimator.sensor import Look, checked_points, checked_poses, validated
from estimator.sensors.additive import detectable, finite_points, gated_look, sampled
from estimator.sensors.field_config import FieldConfig, field_of
from estimator.sensors.field_of_view import FieldOfView


class PositionConfig(FieldConfig, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A sensor that gives positions in a mission file. 3D areas need height_sigma_m."""

    period_s: Positive
    sigma_m: Positive  # horizontal, per axis
    height_sigma_m: Positive | None = None
    field_of_view: Literal["exponential", "box", "sector", "smooth_sector"] = "box"
    clutter: NonNegative = 0.0  # expected false measurements in a set


@dataclass(frozen=True, slots=True, eq=False)
class Position:
    """Measurements (x m, y m(, z m)) in the team's frame of targets in 2D (3D).

    Clutter is uniform over the footprint of a box or a sector; other fields of view have no edge, and their
    clutter is uniform over the area.
    """

    field: FieldOfView
    sigmas: FloatArray  # (d,) m
    clutter: float  # expected false measurements in a set
    support: FieldOfView  # of the clutter: 1 inside
    support_moves: bool  # with the robot

    Config = PositionConfig

    @staticmethod
    def of(config: PositionConfig, area: Area) -> "Position":
        """The model that a mission's table describes.

        Raises:
            ValueError: if a key is missing or does not fit the area's dimension; names the key.
        """
        d = area.dimension
        if (d == 3) != (config.height_sigma_m is not None):
            raise ValueError(f"height_sigma_m: needed in 3D and only there, the area is {d}D")
        sigmas = np.array([config.sigma_m] * 2 + [config.height_sigma_m] * (d - 2), dtype=np.float64)
        field = field_of(config, d)
        if field.shape in ("box", "sector"):
            support = FieldOfView(d, field.shape, 1.0, field.size, field.turns)
            return Position(field, sigmas, config.clutter, support, True)
        box = np.stack([area.low, area.high], axis=1).ravel()
        return Position(field, sigmas, config.clutter, FieldOfView(d, "box", 1.0, box), False)

    @property
    def dimension(self) -> int:
        return self.field.dimension

    @property
    def measurement_size(self) -> int:
        return self.field.dimension

    @property
    def noise(self) -> FloatArray:
        """diag(sigma^2), (d, d)."""
        return np.diag(self.sigmas**2)

    @property
    def angular(self) -> BoolArray:
        """No component."""
        return np.zeros(self.dimension, dtype=np.bool_)

    def detection(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        """p_D of points (d, n) from poses (k, 4), shape (k, n)."""
        return self.field.detection(points, poses)

    def look(self, points: FloatArray, pose: FloatArray, measurements: FloatArray) -> Look:
        """All that a measurement set (m, d) taken at pose (4,) says about points (d, n).

        Points with p_D = 0 are in no measurement's row.

        Raises:
            ValueError: if a shape is another, or a number of any argument is not finite.
        """
        z = validated(measurements, self.dimension)
        points = finite_points(points, self.dimension)
        detection = self.field.detection(points, pose)[0]
        kept = detectable(detection)
        clutter = self.clutter_intensity(z, pose)
        return gated_look(
            detection, np.take(points, kept, axis=1), kept, z, self.sigmas, clutter, circular=False
        )

    def clutter_intensity(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """c(z; q) (m,), false measurements per m^d: uniform on the support, 0 outside."""
        z = validated(measurements, self.dimension)
        inside = self.support.detection(z.T, self._support_pose(pose))[0]
        return np.asarray(self.clutter / _volume(self.support) * inside)

    def locate(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """The measurements (m, d) as points (d, m)."""
        checked_poses(pose)
        return np.ascontiguousarray(validated(measurements, self.dimension).T)

    def location_covariance(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """Covariance (m, d, d) in m^2 of `locate`: the noise."""
        checked_poses(pose)
        return np.tile(self.noise, (len(validated(measurements, self.dimension)), 1, 1))

    def measure(self, targets: FloatArray, pose: FloatArray) -> FloatArray:
        """Noiseless measurements (n, d) of targets (d, n)."""
        return np.array(checked_points(targets, self.dimension).T, order="C")

    def jacobian(self, targets: FloatArray, pose: FloatArray) -> FloatArray:
        """Unit matrices (n, d, d)."""
        return np.tile(np.eye(self.dimension), (checked_points(targets, self.dimension).shape[1], 1, 1))

    def sample(self, targets: FloatArray, pose: FloatArray, rng: np.random.Generator) -> FloatArray:
        """One random measurement set (m, d) of targets (d, n): detections, noise and clutter, shuffled."""
        false = _uniform(self.support, self._support_pose(pose), rng.poisson(self.clutter), rng)
        return sampled(self, targets, checked_poses(pose)[0], self.sigmas, false, rng)

    def outline(self, pose: FloatArray) -> FloatArray:
        """A closed polyline (k, 3) that shows the field of view at pose, for people."""
        return self.field.outline(checked_poses(pose)[0])

    def _support_pose(self, pose: FloatArray) -> FloatArray:
        pose = checked_poses(pose)[0]
        return pose if self.support_moves else np.zeros(4)


def _volume(support: FieldOfView) -> float:
    """Of a box or a sector, m^d."""
    if support.shape == "box":
        return float(np.prod(support.size[1::2] - support.size[::2]))
    near, far, opening = support.size
    if support.dimension == 2:
        return float(opening * (far**2 - near**2) / 2)
    return float(2 * opening * (far**3 - near**3) / 3)


def _uniform(support: FieldOfView, pose: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Points (count, d) spread evenly over a box or a sector at a pose."""
    d = support.dimension
    if support.shape == "box":
        local = rng.uniform(support.size[::2], support.size[1::2], (count, d))
    else:
        near, far, opening = support.size
        r = rng.uniform(near**d, far**d, count) ** (1 / d)
        turn = rng.uniform(-opening / 2, opening / 2, count)
        rise = rng.uniform(-1.0, 1.0, count) if d == 3 else np.zeros(count)
        level = r * np.sqrt(1.0 - rise**2)
        local = np.stack([level * np.cos(turn), level * np.sin(turn), r * rise], axis=1)[:, :d]
    yaw = pose[3] if support.turns or support.shape == "sector" else 0.0
    c, s = np.cos(yaw), np.sin(yaw)
    ahead, left = local[:, 0].copy(), local[:, 1].copy()
    local[:, 0], local[:, 1] = c * ahead - s * left, s * ahead + c * left
    return local + pose[:d]
