"""What other robots will do: the tails of their committed plans, and standing still after them.

(MA)ASI section 6: a trajectory shorter than the longest one under consideration is extended by constant
states, equal to its last; a robot that stands there goes on measuring.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from planner.plan import Commitment

SAME_INSTANT = 1e-6  # s: instants computed along different ways differ by rounding


@dataclass(frozen=True, slots=True)
class Looks:
    """When and from where one robot will measure: on its way, then standing, for as long as anybody asks."""

    times: FloatArray  # (k,) team time, in growing order
    poses: FloatArray  # (k, 4)
    stand_time: float  # of the first measurement standing; infinite if there is none
    stand_pose: FloatArray  # (4,)
    period: float  # between measurements standing


def looks(commitment: Commitment, start: float) -> Looks:
    """Another robot's measurements from `start` on (team time): the tail of its plan, then standing.

    On arrival it measures, as at every waypoint, and from then on once per period.
    """
    order = np.argsort(commitment.measure_times, kind="stable")
    times, poses = commitment.measure_times[order], commitment.measure_poses[order]
    keep = times >= start - SAME_INSTANT
    if commitment.times.size == 0 or not 0 < commitment.measure_period < np.inf:
        return Looks(times[keep], poses[keep], np.inf, np.zeros(4), 1.0)
    arrival, period = float(commitment.times[-1]), commitment.measure_period
    since = max(start - SAME_INSTANT, float(times[-1]) + SAME_INSTANT if times.size else -np.inf)
    first = arrival + period * max(0.0, np.ceil((since - arrival) / period))
    return Looks(times[keep], poses[keep], first, np.array(commitment.poses[-1]), period)


def position_at(commitment: Commitment, time: float) -> FloatArray:
    """Where (3,) another robot is at a team time; infinitely far if its commitment has no samples."""
    if commitment.times.size == 0:
        return np.full(3, np.inf)
    return np.array([np.interp(time, commitment.times, commitment.poses[:, axis]) for axis in range(3)])


def heeded(others: Sequence[Commitment], robot: str) -> tuple[Commitment, ...]:
    """Those that robot `robot` can plan around: usable, and not its own."""
    some = [
        other
        for other in others
        if other.robot != robot
        and other.times.size == len(other.poses)
        and other.measure_times.size == len(other.measure_poses)
        and other.times.size + other.measure_times.size > 0
    ]
    numbers = [
        array.ravel()
        for other in some
        for array in (other.times, other.poses, other.measure_times, other.measure_poses)
    ]
    if not numbers or np.isfinite(np.concatenate(numbers)).all():
        return tuple(some)
    return tuple(other for other in some if usable(other))


def usable(commitment: Commitment) -> bool:
    """Whether a commitment that came from elsewhere can be planned around: whole and finite."""
    return (
        commitment.times.size == len(commitment.poses)
        and commitment.measure_times.size == len(commitment.measure_poses)
        and commitment.times.size + commitment.measure_times.size > 0
        and all(
            bool(np.isfinite(array).all())
            for array in (
                commitment.times,
                commitment.poses,
                commitment.measure_times,
                commitment.measure_poses,
            )
        )
    )
