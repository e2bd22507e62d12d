"""Which measurement came from whom, when the truth is known but measurements carry no name."""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.calibration.recording import Geometry, Recording
from estimator.sensors.range_bearing import wrapped


def errors_of(measurements: FloatArray, expected: FloatArray, geometry: Geometry) -> FloatArray:
    """Measured minus expected (..., s), angles wrapped."""
    out = measurements - expected
    out[..., geometry.angular] = wrapped(out[..., geometry.angular])
    return out


def errors_at(recording: Recording, seen: Geometry, owner: IntArray, rows: IntArray) -> FloatArray:
    """Errors (k, s) of the measurements `rows` (k,) against whom they came from."""
    return errors_of(recording.measurements[rows], seen.expected[recording.frames[rows], owner[rows]], seen)


def associate(
    recording: Recording, geometry: Geometry, sigmas: FloatArray, biases: FloatArray, gate: FloatArray
) -> IntArray:
    """(m,) the target or bystander that each measurement came from, -1 for none.

    In every set the nearest pairs come first, in standard deviations; each measurement and each object is
    used once, and only pairs whose every component is within +-gate (s,). With `recording.sources` nothing
    has to be found out.
    """
    if recording.sources is not None:
        return recording.sources.copy()
    frames = recording.frames
    errors = errors_of(recording.measurements[:, None, :], geometry.expected[frames], geometry)
    with np.errstate(invalid="ignore"):
        inside = (np.abs(errors) <= gate).all(axis=2)
    rows, objects = np.nonzero(inside)
    apart = (((errors[rows, objects] - biases) / sigmas) ** 2).sum(axis=1)
    owner = np.full(len(frames), -1, dtype=np.int64)
    taken: set[tuple[int, int]] = set()
    for k in np.argsort(apart, kind="stable"):
        row, pair = int(rows[k]), (int(frames[rows[k]]), int(objects[k]))
        if owner[row] < 0 and pair not in taken:
            owner[row] = pair[1]
            taken.add(pair)
    return owner
