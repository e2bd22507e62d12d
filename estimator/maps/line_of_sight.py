"""Walls hide targets: any sensor model on an occupancy map, with p_D = 0 where a wall is in between."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from estimator.maps.sight import Sight
from estimator.sensor import Look, SensorModel, checked_points, checked_poses
from estimator.sensors.wrapped import Wrapped

_STEP = np.radians(1.0)  # an outline's edge is cut so finely, as seen from the sensor


@dataclass(frozen=True, slots=True, eq=False)
class LineOfSight(Wrapped):
    """A sensor model that does not see through walls.

    Filters and planners ask for p_D, so particles, clusters and planned measurements are all hidden alike.
    Clutter is the sensor's own: it comes from nothing, wherever walls are.
    """

    sensor: SensorModel
    sight: Sight

    def detection(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        """p_D (k, n) of points (d, n) from poses (k, 4): the sensor's own, and 0 behind walls.

        Raises:
            ValueError: as the sensor's own, and if a point that it may detect is not finite.
        """
        detection = np.ascontiguousarray(self.sensor.detection(points, poses))
        self.sight.hide(points, checked_poses(poses), detection)
        return detection

    def look(self, points: FloatArray, pose: FloatArray, measurements: FloatArray) -> Look:
        """The sensor's look, in which what a wall hides has neither p_D nor likelihood.

        Raises:
            ValueError: as the sensor's own.
        """
        look = self.sensor.look(points, pose, measurements)
        seen = look.detection.copy()
        self.sight.hide(checked_points(points, self.dimension), checked_poses(pose), seen[None, :])
        hidden = seen != look.detection
        if not hidden.any():
            return look
        likelihood = np.where(hidden[look.indices], 0.0, look.likelihood)
        return Look(seen, look.offsets, look.indices, likelihood, look.clutter)

    def sample(self, targets: FloatArray, pose: FloatArray, rng: np.random.Generator) -> FloatArray:
        """One random measurement set (m, s) of those of the targets (d, n) that no wall hides."""
        targets = checked_points(targets, self.dimension)
        seen = self.sight.visible(targets, pose)[0]
        return self.sensor.sample(np.ascontiguousarray(targets[:, seen]), pose, rng)

    def outline(self, pose: FloatArray) -> FloatArray:
        """The sensor's outline (k, 3), each of its points drawn in to the first wall on the way to it."""
        pose = checked_poses(pose)[0]
        fine = _finer(self.sensor.outline(pose), pose)
        shares = self.sight.clear_shares(np.ascontiguousarray(fine[:, :2].T), pose)
        fine[:, :2] = pose[:2] + shares[:, None] * (fine[:, :2] - pose[:2])
        return fine


def _finer(outline: FloatArray, pose: FloatArray) -> FloatArray:
    """A polyline (k, 3) with more points, none of its pieces wider than _STEP as seen from the pose."""
    angles = np.unwrap(np.arctan2(outline[:, 1] - pose[1], outline[:, 0] - pose[0]))
    pieces = np.maximum(1, np.ceil(np.abs(np.diff(angles)) / _STEP)).astype(np.int64)
    begins = np.repeat(np.arange(len(pieces)), pieces)
    shares = np.concatenate([np.arange(n) / n for n in pieces]) if len(pieces) else np.zeros(0)
    points = outline[begins] + shares[:, None] * (outline[begins + 1] - outline[begins])
    return np.concatenate([points, outline[-1:]])
