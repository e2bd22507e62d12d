"""What other robots will do: the tails of their committed plans, and standing still after them.

(MA)ASI section 6: a trajectory shorter than the longest one under consideration is extended by constant
states, equal to its last; a robot that stands there goes on measuring.
"""

import numpy as np

from estimator.arrays import FloatArray
from planner.plan import Commitment

SAME_INSTANT = 1e-6  # s: instants computed along different ways differ by rounding
MOST_LOOKS = 10_000  # of one robot within a horizon; more would be a wrong period, and no plan is that long


def looks(commitment: Commitment, start: float, end: float) -> tuple[FloatArray, FloatArray]:
    """When and from where another robot will measure between `start` and `end` (team time).

    Returns:
        Times (k,) in growing order and poses (k, 4). On arrival it measures, as at every waypoint, and then
        once per period.
    """
    times, poses = commitment.measure_times, commitment.measure_poses
    order = np.argsort(times, kind="stable")
    times, poses = times[order], poses[order]
    keep = (times >= start - SAME_INSTANT) & (times <= end + SAME_INSTANT)
    if commitment.times.size == 0:
        return times[keep], poses[keep]
    still = standing_looks(float(commitment.times[-1]), commitment.measure_period, start, end)
    if times.size:
        still = still[still > times[-1] + SAME_INSTANT]
    pose = commitment.poses[-1]
    return np.concatenate([times[keep], still]), np.vstack([poses[keep], np.tile(pose, (still.size, 1))])


def standing_looks(arrival: float, period: float, start: float, end: float) -> FloatArray:
    """Instants arrival + j period, j = 0, 1, ..., that lie between `start` and `end`."""
    if not (period > 0 and np.isfinite([arrival, start, end]).all()):
        return np.zeros(0)
    first = max(0, int(np.ceil((start - SAME_INSTANT - arrival) / period)))
    last = int(np.floor((end + SAME_INSTANT - arrival) / period))
    count = np.arange(first, min(last + 1, first + MOST_LOOKS), dtype=np.float64)
    return arrival + period * count


def position_at(commitment: Commitment, time: float) -> FloatArray:
    """Where (3,) another robot is at a team time; infinitely far if its commitment has no samples."""
    if commitment.times.size == 0:
        return np.full(3, np.inf)
    return np.array([np.interp(time, commitment.times, commitment.poses[:, axis]) for axis in range(3)])


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
