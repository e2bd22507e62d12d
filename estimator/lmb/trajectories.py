"""Where labelled targets were: what a filter remembers of its estimates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """The targets believed to be there at one time."""

    time: float  # s
    labels: IntArray  # (k,)
    means: FloatArray  # (d, k) m


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Where one target was believed to be."""

    times: FloatArray  # (t,) s, growing
    means: FloatArray  # (d, t) m


def trajectories(history: Sequence[Instant]) -> dict[int, Trajectory]:
    """By label, from instants in the order of their times."""
    times: dict[int, list[float]] = {}
    places: dict[int, list[FloatArray]] = {}
    for instant in history:
        for k, label in enumerate(instant.labels.tolist()):
            times.setdefault(label, []).append(instant.time)
            places.setdefault(label, []).append(instant.means[:, k])
    return {label: Trajectory(np.array(times[label]), np.stack(places[label], axis=1)) for label in times}
