"""Read a UTIAS MRCLAM directory (Leung et al. 2011): motion-capture poses, camera frames, landmarks.

Times become team times: 0 is the moment from which the motion capture knows all robots. Barcodes are not
read into a recording: a frame is what an anonymous sensor would have given, other robots' sightings included.

A measurement file has a line for each thing seen and none for a frame in which nothing was seen. Those empty
frames carry information (nothing is there), so they are rebuilt: the camera's period is steady within a few
milliseconds, and a gap of about k periods between two frames held k - 1 empty ones, evenly spaced. Before the
first and after the last sighting the frames go on to where the robot's own log (the odometry file) begins
and ends, as far as the motion capture goes.

The files call their second column a range. It is the depth along the camera's optical axis (see
docs/mrclam.md), and `Camera` turns it into the range and bearing of the robot's centre.
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from agents.errors import DataError
from estimator.arrays import FloatArray, IntArray

_SAME_FRAME_S = 0.05  # lines of one frame differ by at most 1 ms, frames by at least 140 ms
_STRIDE_S = 1.0  # the way travelled is added up in steps of this, so that the capture's noise does not count


@dataclass(frozen=True, slots=True)
class Camera:
    """What a robot's camera does to range and bearing, and how to undo it."""

    depth_scale: float = 1.0  # true depth over recorded depth
    axis: float = 0.0  # the optical axis, radians from the robot's heading
    forward: float = 0.0  # metres from the robot's centre to the camera, along its heading
    bearing: tuple[float, float, float] = (0.0, 0.0, 0.0)  # added: b0 + b1 b + b2 b^2, radians
    delay: float = 0.0  # seconds from exposure to time stamp

    def correct(self, lines: FloatArray) -> FloatArray:
        """Recorded depth and bearing (m, 2) as range and bearing (m, 2) from the robot's centre."""
        depth, recorded = lines[:, 0], lines[:, 1]
        distance = self.depth_scale * depth / np.cos(recorded - self.axis)
        b0, b1, b2 = self.bearing
        bearing = recorded + b0 + b1 * recorded + b2 * recorded**2
        x, y = self.forward + distance * np.cos(bearing), distance * np.sin(bearing)
        return np.column_stack([np.hypot(x, y), np.arctan2(y, x)])


@dataclass(frozen=True, slots=True)
class Track:
    """Where one robot was, from the motion capture."""

    times: FloatArray  # (n,) team time, ascending
    poses: FloatArray  # (3, n) x, y in metres, yaw in radians without jumps
    stride_times: FloatArray  # (k,)
    travelled: FloatArray  # (k,) metres since the start

    def pose(self, time: float) -> FloatArray:
        """(4,) at a team time; before the start and after the end the robot stands."""
        after = int(np.clip(np.searchsorted(self.times, time), 1, self.times.size - 1))
        begin, end = self.times[after - 1], self.times[after]
        share = float(np.clip((time - begin) / (end - begin), 0.0, 1.0))
        x, y, yaw = (1.0 - share) * self.poses[:, after - 1] + share * self.poses[:, after]
        return np.array([x, y, 0.0, np.arctan2(np.sin(yaw), np.cos(yaw))])

    def velocity(self, time: float, window: float = 0.25) -> FloatArray:
        """(3,) m/s, over a window of seconds on both sides."""
        if not self.times[0] <= time <= self.times[-1]:
            return np.zeros(3)
        way = self.pose(time + window)[:3] - self.pose(time - window)[:3]
        return np.asarray(way / (2.0 * window), dtype=np.float64)

    def way(self, time: float) -> float:
        """Metres travelled by a team time."""
        return float(np.interp(time, self.stride_times, self.travelled))


@dataclass(frozen=True, slots=True)
class Frames:
    """All camera frames of one robot, also those in which nothing was seen."""

    times: FloatArray  # (f,) team time of the exposure, ascending
    offsets: IntArray  # (f + 1,) frame i saw rows offsets[i]:offsets[i + 1]
    measurements: FloatArray  # (m, 2) range in metres, bearing in radians from the robot's heading

    def at(self, index: int) -> FloatArray:
        """The measurement set (m, 2) of one frame."""
        return self.measurements[self.offsets[index] : self.offsets[index + 1]]

    @property
    def empty(self) -> int:
        """How many frames saw nothing."""
        return int(np.count_nonzero(np.diff(self.offsets) == 0))


def start_time(directory: Path) -> float:
    """The file time that is team time 0.

    Raises:
        DataError: if the directory is missing or holds no recording.
    """
    if not directory.is_dir():
        raise DataError(
            f"the recordings directory {directory} does not exist; set `data` in the mission's [world] to an "
            "MRCLAM directory (a relative path begins at the mission file)"
        )
    files = sorted(directory.glob("Robot*_Groundtruth.dat"))
    if not files:
        raise DataError(f"{directory} holds no Robot*_Groundtruth.dat; it is not an MRCLAM directory")
    return max(_ends(file)[0] for file in files)


def read_landmarks(directory: Path) -> FloatArray:
    """True landmark positions (2, n) in metres.

    Raises:
        DataError: as `start_time`.
    """
    start_time(directory)
    table = read_table(directory / "Landmark_Groundtruth.dat", 5)
    return np.ascontiguousarray(table[:, 1:3].T)


def read_track(directory: Path, robot: int) -> Track:
    """Where one robot was.

    Raises:
        DataError: if the files are missing or malformed.
    """
    zero = start_time(directory)
    table = read_table(directory / f"Robot{robot}_Groundtruth.dat", 4)
    times, poses = table[:, 0] - zero, np.ascontiguousarray(table[:, 1:].T)
    poses[2] = np.unwrap(poses[2])
    strides = np.append(np.arange(times[0], times[-1], _STRIDE_S), times[-1])
    steps = [np.diff(np.interp(strides, times, poses[i])) for i in range(2)]
    travelled = np.append(0.0, np.cumsum(np.hypot(*steps)))
    return Track(times, poses, strides, travelled)


def read_frames(directory: Path, robot: int, camera: Camera, period: float) -> Frames:
    """One robot's camera frames; `period` (s) is the camera's, for rebuilding the empty ones.

    Raises:
        DataError: if the files are missing or malformed.
    """
    zero = start_time(directory)
    table = read_table(directory / f"Robot{robot}_Measurement.dat", 4)
    stamps = table[:, 0] - zero
    first = np.append(0, np.flatnonzero(np.diff(stamps) > _SAME_FRAME_S) + 1)
    seen = stamps[first]
    logged = _ends(directory / f"Robot{robot}_Odometry.dat")
    posed = _ends(directory / f"Robot{robot}_Groundtruth.dat")
    begin, end = max(logged[0], posed[0]) - zero, min(logged[1], posed[1]) - zero + camera.delay
    parts = [seen[0] - period * np.arange(max(0, int((seen[0] - begin) / period)), 0, -1)]
    for this, following in pairwise(seen):
        count = max(1, round((following - this) / period))
        parts.append(this + (following - this) / count * np.arange(count))
    parts.append(seen[-1] + period * np.arange(max(0, int((end - seen[-1]) / period)) + 1))
    times = np.concatenate(parts)
    within = np.diff(np.append(first, len(stamps)))  # lines of each frame that saw something
    counts = np.zeros(len(times), dtype=np.int64)
    counts[np.cumsum([len(part) for part in parts[:-1]])] = within
    offsets = np.append(0, np.cumsum(counts)).astype(np.int64)
    keep = times <= end  # without a pose a frame says nothing
    last = int(np.count_nonzero(keep))
    return Frames(
        times[:last] - camera.delay, offsets[: last + 1], camera.correct(table[: offsets[last], 2:4])
    )


def read_table(file: Path, columns: int) -> FloatArray:
    """The rows (k, columns) of one of the data set's files.

    Raises:
        DataError: if it is missing or malformed.
    """
    try:
        table = np.loadtxt(file, dtype=np.float64, comments="#", ndmin=2)
    except OSError as error:
        raise DataError(
            f"{file} cannot be read ({error.strerror or error}); is the data set complete?"
        ) from None
    except ValueError as error:
        raise DataError(f"{file} is not an MRCLAM table: {error}") from None
    if table.shape[0] == 0 or table.shape[1] != columns or not np.isfinite(table).all():
        raise DataError(f"{file}: expected rows of {columns} finite numbers, got shape {table.shape}")
    if columns == 4 and (np.diff(table[:, 0]) < 0).any():
        raise DataError(f"{file}: time stamps go back")
    return table


def _ends(file: Path) -> tuple[float, float]:
    """First and last time stamp, without reading what lies between."""
    try:
        with file.open("rb") as stream:
            head = next((line for line in stream if line.strip() and not line.startswith(b"#")), b"")
            stream.seek(0, 2)
            stream.seek(max(0, stream.tell() - 400))
            tail = [line for line in stream.read().splitlines() if line.strip()][-1:]
        return float(head.split()[0]), float(tail[0].split()[0])
    except OSError as error:
        raise DataError(f"{file} cannot be read ({error.strerror}); is the data set complete?") from None
    except (ValueError, IndexError):
        raise DataError(f"{file} is not an MRCLAM table") from None
