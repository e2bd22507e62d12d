"""What MRCLAM recordings say of their cameras when barcodes and true landmarks are used.

Only calibration does so: in a mission the same frames come without names (`bridges.mrclam.mrclam`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from agents.errors import DataError
from bridges.mrclam.mrclam import (
    Camera,
    Track,
    read_frames,
    read_landmarks,
    read_table,
    read_track,
    start_time,
)
from estimator.arrays import FloatArray, IntArray
from estimator.calibration.recording import Recording
from estimator.sensors.range_bearing import wrapped

BODY_RADIUS_M = 0.17  # of the robots (iRobot Create), which hide what is behind them
_DELAYS = np.arange(0.0, 0.101, 0.025)  # s, tried; a parabola finds the best in between
_ENOUGH = 800  # sightings of a robot are enough to find the delay
_SCALES = np.array([0.03, 0.01])  # m and rad, a usual error


@dataclass(frozen=True, slots=True, eq=False)
class RecordedRobot:
    """One robot's file as it is, and where everybody stood."""

    number: int
    lines: FloatArray  # (m, 2) recorded depth and bearing
    sources: IntArray  # (m,) landmark's row, 15 and up another robot, -1 a barcode that nothing carries
    landmarks: FloatArray  # (2, n)
    track: Track
    others: tuple[Track, ...]

    def start(self) -> FloatArray:
        """(4,) pose at team time 0."""
        return self.track.pose(0.0)


def robots_of(directory: Path) -> list[int]:
    """The numbers of the recorded robots.

    Raises:
        DataError: as `start_time`.
    """
    start_time(directory)
    stems = [file.stem for file in directory.glob("Robot*_Groundtruth.dat")]
    return sorted(int(stem.removeprefix("Robot").split("_")[0]) for stem in stems)


def read_robots(directory: Path, numbers: Sequence[int]) -> list[RecordedRobot]:
    """The chosen robots of a recording.

    Raises:
        DataError: if a file is missing or malformed, or there is no such robot.
    """
    known = robots_of(directory)
    missing = sorted(set(numbers) - set(known))
    if missing:
        raise DataError(f"{directory} has no robot {missing[0]}; it has {', '.join(map(str, known))}")
    tracks = {number: read_track(directory, number) for number in known}
    barcodes = {int(code): int(subject) for subject, code in read_table(directory / "Barcodes.dat", 2)}
    subjects = read_table(directory / "Landmark_Groundtruth.dat", 5)[:, 0].astype(int).tolist()
    rows = {subject: i for i, subject in enumerate(subjects)}
    out = []
    for number in numbers:
        others = [other for other in known if other != number]
        carried = rows | {other: len(rows) + i for i, other in enumerate(others)}
        table = read_table(directory / f"Robot{number}_Measurement.dat", 4)
        sources = np.array([carried.get(barcodes.get(int(code), -1), -1) for code in table[:, 1]])
        out.append(
            RecordedRobot(
                number,
                np.ascontiguousarray(table[:, 2:4]),
                sources.astype(np.int64),
                read_landmarks(directory),
                tracks[number],
                tuple(tracks[other] for other in others),
            )
        )
    return out


def recording_of(
    directory: Path, robot: RecordedRobot, camera: Camera, period: float, *, named: bool = True
) -> Recording:
    """All frames of one robot with the truth; without names if not `named`.

    Raises:
        DataError: if a file is missing or malformed.
    """
    frames = read_frames(directory, robot.number, camera, period)
    count, last = len(frames.times), int(frames.offsets[-1])
    others = np.stack([_poses(track, frames.times)[:, :2] for track in robot.others], axis=2)
    return Recording(
        poses=_poses(robot.track, frames.times),
        offsets=frames.offsets,
        measurements=frames.measurements,
        targets=np.broadcast_to(robot.landmarks, (count, *robot.landmarks.shape)),
        bystanders=others if robot.others else np.zeros((count, 2, 0)),
        sources=robot.sources[:last] if named else None,
    )


def fit_cameras(directory: Path, robots: Sequence[RecordedRobot], period: float) -> list[Camera]:
    """Each robot's camera by robust least squares on the landmarks it saw, with one delay for all of them.

    Raises:
        DataError: if a robot saw too little.
    """
    sets = [_sightings(directory, robot, period) for robot in robots]
    tracks = [robot.track for robot in robots]
    few = [tuple(part[..., :: -(-part.shape[-1] // _ENOUGH)] for part in s) for s in sets]
    cost = np.array([sum(_fit(s, t, d)[1] for s, t in zip(few, tracks, strict=True)) for d in _DELAYS])
    at = int(np.clip(np.argmin(cost), 1, len(_DELAYS) - 2))
    a, b, c = cost[at - 1 : at + 2]
    bend = a - 2.0 * b + c
    step = 0.5 * (a - c) / bend if bend > 0.0 else 0.0
    delay = float(max(0.0, _DELAYS[at] + np.clip(step, -1.0, 1.0) * (_DELAYS[1] - _DELAYS[0])))
    return [_fit(s, t, delay)[0] for s, t in zip(sets, tracks, strict=True)]


Sightings = tuple[FloatArray, ...]  # of landmarks: time stamps (k,), lines (2, k), places (2, k)


def _sightings(directory: Path, robot: RecordedRobot, period: float) -> Sightings:
    frames = read_frames(directory, robot.number, Camera(), period)
    stamps = np.repeat(frames.times, np.diff(frames.offsets))
    sources = robot.sources[: len(stamps)]
    of_landmark = (sources >= 0) & (sources < robot.landmarks.shape[1])
    kept = np.flatnonzero(of_landmark)
    if len(kept) < 50:
        raise DataError(f"robot {robot.number} saw landmarks {len(kept)} times; at least 50 are needed")
    return stamps[kept], robot.lines[kept].T, robot.landmarks[:, sources[kept]]


def _fit(sightings: Sightings, track: Track, delay: float) -> tuple[Camera, float]:
    """The best camera of one delay, and its cost."""
    from scipy.optimize import least_squares  # noqa: PLC0415 - slow to import

    stamps, lines, places = sightings
    poses = _poses(track, stamps - delay)
    dx, dy = places[0] - poses[:, 0], places[1] - poses[:, 1]
    truth = np.column_stack([np.hypot(dx, dy), np.arctan2(dy, dx) - poses[:, 3]])

    def camera(x: FloatArray) -> Camera:
        return Camera(float(x[0]), float(x[1]), float(x[2]), (float(x[3]), float(x[4]), float(x[5])), delay)

    def errors(x: FloatArray) -> FloatArray:
        found = camera(x).correct(lines.T) - truth
        found[:, 1] = wrapped(found[:, 1])
        return np.asarray((found / _SCALES).ravel())

    fit = least_squares(errors, np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), loss="cauchy", f_scale=2.0)
    return camera(fit.x), float(fit.cost)


def _poses(track: Track, times: FloatArray) -> FloatArray:
    """(k, 4) of many times at once; as `Track.pose`."""
    out = np.zeros((len(times), 4))
    for row, column in ((0, 0), (1, 1), (2, 3)):
        out[:, column] = np.interp(times, track.times, track.poses[row])
    out[:, 3] = wrapped(out[:, 3])
    return out
