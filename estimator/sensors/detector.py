"""Detectors that say "seen" or "not seen" and nothing else, as multimodal softmax: Ponda et al. 2012 (22)."""

from dataclasses import dataclass
from math import pi
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from estimator.arrays import FloatArray, Fraction, IntArray, NonNegative, Positive
from estimator.filter import Area
from estimator.kernels import kernel
from estimator.sensor import Look, checked_points, checked_poses, validated
from estimator.sensors.additive import finite_points
from estimator.sensors.softmax import Softmax, evaluate

_LEAST = 1e-9  # a point with less p_D than this is in no measurement's row
_SOFT = 4.0  # lengths 1 / steepness beyond its edges that a camera is integrated over
_CELLS = {2: 160, 3: 56}  # per axis of the grid that a category's moments are summed over

Opening = Annotated[float, Meta(gt=0, lt=180)]


class SoftmaxTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A softmax model in a mission file, in the robot's axes (x ahead, y left(, z up))."""

    weights: list[list[float]]  # one row of d numbers for each sub-class, 1/m
    biases: list[float]
    categories: list[int]  # of each sub-class: 0 is "no detection", 1 and up are kinds of detection


class DetectorConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A detector in a mission file: a camera that looks ahead, or any softmax model."""

    period_s: Positive
    gain: Fraction = 1.0  # the detection probability is multiplied by it
    range_m: Positive | None = None  # the camera's triangle (3D: pyramid) ends here
    angle_deg: Opening | None = None  # full opening about the yaw
    height_angle_deg: Opening | None = None  # full opening upwards and downwards, in 3D
    steepness: Positive = 2.0  # slope of the log-odds of a detection at an edge, 1/m
    softmax: SoftmaxTable | None = None  # instead of the camera
    clutter: NonNegative = 0.0  # expected false detections in a set, evenly of all kinds
    max_range_m: Positive | None = None  # softmax: targets are within it; default: the area's diagonal


@dataclass(frozen=True, slots=True, eq=False)
class Detector:
    """Measurements (category,) of targets in 2D or 3D: a detection, of a kind 1..c-1, and no place.

    Each target gives "no detection", that is no measurement, with probability p(0 | x), else one of category
    k with p(k | x). So p_D = G (1 - p(0 | x)), and g(k | x) = p(k | x) / (1 - p(0 | x)) sums to 1 over the
    kinds; densities are probabilities here. A number that is no category is a measurement that never happens:
    its likelihood and clutter are 0. `locate` gives the mean place of the targets that a detection may come
    from and `location_covariance` its covariance, were they anywhere alike.
    """

    softmax: Softmax  # in the robot's axes
    gain: float
    clutter: float  # expected false measurements in a set
    places: FloatArray  # (d, c - 1) m, mean place of what is detected as each kind, in the robot's axes
    spreads: FloatArray  # (c - 1, d, d) m^2, its covariance
    border: FloatArray  # (k, 2) m, the outline in the robot's axes

    Config = DetectorConfig

    @staticmethod
    def of(config: DetectorConfig, area: Area) -> "Detector":
        """The model that a mission's table describes.

        Raises:
            ValueError: if a key is missing or does not fit the area's dimension; names the key.
        """
        d = area.dimension
        if config.softmax is None:
            softmax = _camera(config, d)
            assert config.range_m is not None
            reach = config.range_m + _SOFT / config.steepness
        else:
            if config.range_m or config.angle_deg or config.height_angle_deg:
                raise ValueError("softmax: stands instead of range_m, angle_deg and height_angle_deg")
            softmax = _softmax(config.softmax, d)
            reach = config.max_range_m or float(np.linalg.norm(area.high - area.low))
        places, spreads = _moments(softmax, reach)
        border = _ellipse(places[:2, 0], spreads[0, :2, :2])
        if config.softmax is None and config.range_m is not None and config.angle_deg is not None:
            half = config.range_m * np.tan(np.radians(config.angle_deg) / 2)
            border = np.array([[0, 0], [config.range_m, -half], [config.range_m, half], [0, 0]], np.float64)
        return Detector(softmax, config.gain, config.clutter, places, spreads, border)

    @property
    def dimension(self) -> int:
        return self.softmax.dimension

    @property
    def measurement_size(self) -> int:
        return 1

    @property
    def kinds(self) -> int:
        """c - 1, kinds of detection."""
        return self.softmax.categories - 1

    def detection(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        """p_D of points (d, n) from poses (k, 4), shape (k, n)."""
        points, poses = checked_points(points, self.dimension), checked_poses(poses)
        out = np.empty((len(poses), points.shape[1]))
        soft = self.softmax
        _detection(points, poses, soft.weights, soft.biases, np.minimum(soft.class_of, 1), self.gain, out)
        return out

    def look(self, points: FloatArray, pose: FloatArray, measurements: FloatArray) -> Look:
        """All that a measurement set (m, 1) taken at pose (4,) says about points (d, n).

        Points with p_D < 1e-9 are in no measurement's row.

        Raises:
            ValueError: if a shape is another, or a number of any argument is not finite.
        """
        kinds = self._kinds(measurements)
        points = finite_points(points, self.dimension)
        pose = checked_poses(pose)[0]
        detection = self.detection(points, pose)[0]
        kept = np.flatnonzero(detection >= _LEAST)
        seen = self.softmax.placed(pose).probabilities(np.take(points, kept, axis=1))[1:]
        seen /= seen.sum(axis=0)
        real = np.flatnonzero(kinds >= 0)
        offsets = np.concatenate([[0], np.cumsum(np.where(kinds >= 0, kept.size, 0))])
        clutter = self.clutter_intensity(measurements, pose)
        return Look(detection, offsets, np.tile(kept, real.size), seen[kinds[real]].ravel(), clutter)

    def clutter_intensity(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """c(z; q) (m,), expected false measurements of each one's category."""
        return np.asarray(self.clutter / self.kinds * (self._kinds(measurements) >= 0))

    def locate(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """The mean place (d, m) of the targets that each measurement (m, 1) may come from.

        What is no category is taken for the first.
        """
        pose = checked_poses(pose)[0]
        local = self.places[:, np.maximum(self._kinds(measurements), 0)]
        return np.asarray(_turn(pose, self.dimension) @ local + pose[: self.dimension, None])

    def location_covariance(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """Covariance (m, d, d) in m^2 of the places that each measurement may come from."""
        turn = _turn(checked_poses(pose)[0], self.dimension)
        return np.asarray(turn @ self.spreads[np.maximum(self._kinds(measurements), 0)] @ turn.T)

    def sample(self, targets: FloatArray, pose: FloatArray, rng: np.random.Generator) -> FloatArray:
        """One random measurement set (m, 1) of targets (d, n): detections and false ones, shuffled."""
        targets = checked_points(targets, self.dimension)
        each = self.gain * self.softmax.placed(checked_poses(pose)[0]).probabilities(targets)[1:]
        drawn = (rng.random(targets.shape[1]) >= np.cumsum(each, axis=0)).sum(axis=0)  # kinds: not seen
        false = rng.integers(0, self.kinds, rng.poisson(self.clutter))
        kinds = np.concatenate([drawn[drawn < self.kinds], false])
        return rng.permutation(1.0 + kinds)[:, None]

    def outline(self, pose: FloatArray) -> FloatArray:
        """A closed polyline (k, 3) that shows the field of view at pose, for people."""
        pose = checked_poses(pose)[0]
        flat = self.border @ _turn(pose, 2).T + pose[:2]
        return np.column_stack([flat, np.full(len(flat), pose[2])])

    def _kinds(self, measurements: FloatArray) -> IntArray:
        """Which kind of detection (m,) from 0 up; -1 for what is no category."""
        z = validated(measurements, 1)[:, 0]
        real = (z >= 1.0) & (z <= self.kinds) & (z == np.floor(z))
        return np.asarray(np.where(real, z, 0.0).astype(np.int64) - 1)


def _camera(config: DetectorConfig, d: int) -> Softmax:
    """Triangle or pyramid with its tip on the robot: 3 (5) sub-classes "no detection" and one "detection"."""
    if config.range_m is None or config.angle_deg is None:
        raise ValueError(f"{'angle_deg' if config.range_m else 'range_m'}: a camera needs it")
    if (d == 3) != (config.height_angle_deg is not None):
        raise ValueError(f"height_angle_deg: needed in 3D and only there, the area is {d}D")
    half = np.radians(config.angle_deg) / 2
    normals = [[-np.sin(half), np.cos(half), 0.0], [-np.sin(half), -np.cos(half), 0.0], [1.0, 0.0, 0.0]]
    if config.height_angle_deg is not None:
        half = np.radians(config.height_angle_deg) / 2
        normals += [[-np.sin(half), 0.0, np.cos(half)], [-np.sin(half), 0.0, -np.cos(half)]]
    offsets = np.zeros(len(normals))
    offsets[2] = config.range_m
    return Softmax.polytope(np.array(normals)[:, :d], offsets, config.steepness)


def _softmax(table: SoftmaxTable, d: int) -> Softmax:
    if any(len(row) != d for row in table.weights):
        raise ValueError(f"softmax: every row of weights needs {d} numbers here")
    try:
        softmax = Softmax(np.array(table.weights), np.array(table.biases), np.array(table.categories))
    except ValueError as error:
        raise ValueError(f"softmax: {error}") from error
    if softmax.categories < 2:
        raise ValueError("softmax: needs a category 1 besides 0, which is no detection")
    return softmax


def _moments(softmax: Softmax, reach: float) -> tuple[FloatArray, FloatArray]:
    """Means (d, c - 1), covariances (c - 1, d, d) of p(k | x) within a box of `reach` m around the robot."""
    d = softmax.dimension
    step = 2.0 * reach / _CELLS[d]
    axis = np.arange(_CELLS[d]) * step + 0.5 * step - reach
    points = np.stack(np.meshgrid(*[axis] * d, indexing="ij")).reshape(d, -1)
    weights = softmax.probabilities(points)[1:]
    totals = weights.sum(axis=1, keepdims=True)
    if (totals * step**d < 1e-9).any():
        raise ValueError("softmax: a category is detected nowhere within max_range_m")
    weights /= totals
    means = points @ weights.T
    squares = np.einsum("ap,bp,kp->kab", points, points, weights, optimize=True)
    covariances = squares - means.T[:, :, None] * means.T[:, None, :] + np.eye(d) * step**2 / 12
    return means, np.asarray(covariances)


def _ellipse(mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """A closed polyline (k, 2) two standard deviations around a place."""
    values, vectors = np.linalg.eigh(covariance)
    angles = np.linspace(-pi, pi, 49)
    circle = np.stack([np.cos(angles), np.sin(angles)])
    return np.asarray((mean[:, None] + 2.0 * (vectors * np.sqrt(values)) @ circle).T)


def _turn(pose: FloatArray, d: int) -> FloatArray:
    """Rotation (d, d) from the robot's axes into the world's."""
    turn = np.eye(d)
    c, s = np.cos(pose[3]), np.sin(pose[3])
    turn[:2, :2] = [[c, -s], [s, c]]
    return turn


@kernel
def _detection(
    points: FloatArray,
    poses: FloatArray,
    weights: FloatArray,
    biases: FloatArray,
    class_of: IntArray,
    gain: float,
    out: FloatArray,
) -> None:
    """gain p(1 | x) (k, n), the model's weights turned and moved with each pose."""
    d = points.shape[0]
    turned, moved = weights.copy(), biases.copy()
    both = np.empty((2, points.shape[1]))
    for k in range(poses.shape[0]):
        c, s = np.cos(poses[k, 3]), np.sin(poses[k, 3])
        for r in range(weights.shape[0]):
            turned[r, 0] = c * weights[r, 0] - s * weights[r, 1]
            turned[r, 1] = s * weights[r, 0] + c * weights[r, 1]
            moved[r] = biases[r]
            for a in range(d):
                moved[r] -= turned[r, a] * poses[k, a]
        evaluate(points, turned, moved, class_of, both)
        for i in range(points.shape[1]):
            out[k, i] = gain * both[1, i]
