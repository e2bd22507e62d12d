"""What a calibration starts from: measurement sets, and what was really there when each was taken."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.sensors.range_bearing import wrapped


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """f measurement sets of one planar sensor, empty ones too, with n targets and b bystanders.

    Bystanders are seen like targets but are none (other robots): their sightings are neither clutter nor do
    they count for p_D, and who stands behind one is hidden. NaN stands for what was not there.

    Raises:
        ValueError: naming the field that is wrong.
    """

    poses: FloatArray  # (f, 4) x, y, z, yaw
    offsets: IntArray  # (f + 1,) set i holds the rows offsets[i]:offsets[i + 1] of
    measurements: FloatArray  # (m, s) range in metres and / or bearing in radians, as `quantities` says
    targets: FloatArray  # (f, 2, n) metres
    bystanders: FloatArray  # (f, 2, b)
    quantities: tuple[str, ...] = ("range", "bearing")
    body_frame: bool = True  # bearings are relative to yaw
    # (m,) who each measurement came from, where that is known: below n a target, below n + b a bystander,
    # -1 nothing. None: to be found out.
    sources: IntArray | None = None
    hidden: BoolArray | None = None  # (f, n) targets that a wall hid

    def __post_init__(self) -> None:
        f, m = len(self.poses), len(self.measurements)
        if f == 0 or self.poses.shape != (f, 4) or not np.isfinite(self.poses).all():
            raise ValueError(f"poses: expected finite numbers of shape (f, 4), f > 0, got {self.poses.shape}")
        offsets = self.offsets
        if offsets.shape != (f + 1,) or offsets[0] != 0 or offsets[-1] != m or (np.diff(offsets) < 0).any():
            raise ValueError(f"offsets: expected {f + 1} growing numbers from 0 to {m}")
        if not self.quantities or set(self.quantities) - {"range", "bearing"}:
            raise ValueError(f"quantities: expected range and / or bearing, got {self.quantities}")
        if self.measurements.shape != (m, len(self.quantities)) or not np.isfinite(self.measurements).all():
            expected = f"(m, {len(self.quantities)})"
            raise ValueError(
                f"measurements: expected finite numbers of shape {expected}, got {self.measurements.shape}"
            )
        for name, places in (("targets", self.targets), ("bystanders", self.bystanders)):
            if places.ndim != 3 or places.shape[:2] != (f, 2):
                raise ValueError(f"{name}: expected shape ({f}, 2, count), got {places.shape}")
        if self.targets.shape[2] == 0 or not np.isfinite(self.targets).any():
            raise ValueError("targets: expected at least one whose place is known")
        known = self.targets.shape[2] + self.bystanders.shape[2]
        if self.sources is not None and (
            self.sources.shape != (m,) or (m and not -1 <= self.sources.min() <= self.sources.max() < known)
        ):
            raise ValueError(f"sources: expected {m} numbers from -1 to {known - 1}")
        if self.hidden is not None and self.hidden.shape != (f, self.targets.shape[2]):
            raise ValueError(f"hidden: expected shape {(f, self.targets.shape[2])}, got {self.hidden.shape}")

    @property
    def frames(self) -> IntArray:
        """(m,) the set that each measurement is in."""
        return np.repeat(np.arange(len(self.poses)), np.diff(self.offsets))


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """Where targets, and then bystanders, stood as seen from the sensor; NaN for those that did not."""

    ranges: FloatArray  # (f, n + b) metres
    bearings: FloatArray  # (f, n + b) radians from the heading
    expected: FloatArray  # (f, n + b, s) measurements without noise
    angular: BoolArray  # (s,)


def geometry(recording: Recording) -> Geometry:
    """The truth in the sensor's own terms."""
    places = np.concatenate([recording.targets, recording.bystanders], axis=2)
    dx, dy = (places[:, i] - recording.poses[:, i, None] for i in range(2))
    ranges, world = np.hypot(dx, dy), np.arctan2(dy, dx)
    bearings = wrapped(world - recording.poses[:, 3, None])
    columns = {"range": ranges, "bearing": bearings if recording.body_frame else world}
    expected = np.stack([columns[name] for name in recording.quantities], axis=2)
    return Geometry(ranges, bearings, expected, np.array([q == "bearing" for q in recording.quantities]))


def behind(geometry: Geometry, targets: int, radius: float) -> BoolArray:
    """(f, targets) which targets a bystander of this radius (m) hides."""
    out = np.zeros((len(geometry.ranges), targets), dtype=np.bool_)
    for b in range(targets, geometry.ranges.shape[1]):
        near = geometry.ranges[:, b, None]
        half = np.arcsin(np.clip(radius / np.maximum(near, radius), 0.0, 1.0))
        apart = np.abs(wrapped(geometry.bearings[:, :targets] - geometry.bearings[:, b, None]))
        out |= (apart < half) & (geometry.ranges[:, :targets] > near)
    return out
