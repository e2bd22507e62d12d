"""How near the ways to the candidates come to the ways of other robots.

Between samples both robots are taken to move straight.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel
from planner.commitments import position_at, usable
from planner.plan import Commitment, PlanProblem, Trajectory, VehicleModel

SAME_PLACE = 1e-6  # m


def keeps_apart(problem: PlanProblem, vehicle: VehicleModel, way: Trajectory) -> bool:
    """Whether a trajectory keeps the problem's separation from what the other robots have committed to.

    Robots that are too close already need only come no closer, or they would hold each other for ever.
    """
    if problem.separation <= 0:
        return True
    offsets = np.array([0, way.times.size])
    end_times, ends = np.array([way.end_time - problem.start_time]), way.poses[-1:, :3].copy()
    here = vehicle.pose(problem.state)[:3]
    for other in problem.others:
        if other.robot == problem.robot or not usable(other):
            continue
        times = way.times - problem.start_time
        kept = clearances(problem.start_time, offsets, times, way.poses, end_times, ends, other)[0]
        now = float(np.linalg.norm(here - position_at(other, problem.start_time)))
        if kept < min(problem.separation, now) - SAME_PLACE:
            return False
    return True


def clearances(
    start_time: float,
    offsets: IntArray,
    times: FloatArray,
    poses: FloatArray,
    end_times: FloatArray,
    ends: FloatArray,
    other: Commitment,
) -> FloatArray:
    """Smallest distance (w,) in metres between the way to each of w candidates and another robot.

    Args:
        offsets: (w + 1,) candidate i has the samples offsets[i]:offsets[i + 1].
        times: of the samples, seconds after the start.
        poses: of the samples, (total, 4).
        end_times: (w,) seconds after the start at which each candidate is reached.
        ends: (w, 3) position there.
        other: its way is taken between its own samples, and standing before the first and after the last.
    """
    least = np.empty(offsets.size - 1)
    if other.times.size == 0:
        least.fill(np.inf)
        return least
    _clearances(
        offsets, times, poses, end_times, ends, other.times - start_time, np.array(other.poses), least
    )
    return least


@kernel
def _clearances(
    offsets: IntArray,
    times: FloatArray,
    poses: FloatArray,
    end_times: FloatArray,
    ends: FloatArray,
    other_times: FloatArray,
    other_poses: FloatArray,
    least: FloatArray,
) -> None:
    own = np.empty(3)
    gap = np.empty(3)
    before = np.empty(3)
    for i in range(least.size):
        best = np.inf
        k = 0  # the other is between its samples k - 1 and k
        for row in range(offsets[i], offsets[i + 1] + 1):
            last = row == offsets[i + 1]
            t = end_times[i] if last else times[row]
            for c in range(3):
                own[c] = ends[i, c] if last else poses[row, c]
            while k < other_times.size and other_times[k] <= t:
                k += 1
            for c in range(3):
                if k == 0:
                    there = other_poses[0, c]
                elif k == other_times.size:
                    there = other_poses[k - 1, c]
                else:
                    share = (t - other_times[k - 1]) / (other_times[k] - other_times[k - 1])
                    there = other_poses[k - 1, c] + share * (other_poses[k, c] - other_poses[k - 1, c])
                gap[c] = own[c] - there
            square = gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2
            if row > offsets[i]:
                square = min(square, _nearest(before, gap))
            best = min(best, square)
            before[:] = gap
        least[i] = np.sqrt(best)


@kernel
def _nearest(a: FloatArray, b: FloatArray) -> float:
    """Square of the distance of the segment from a to b to the origin."""
    along = 0.0
    length = 0.0
    for c in range(3):
        along -= a[c] * (b[c] - a[c])
        length += (b[c] - a[c]) ** 2
    share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    total = 0.0
    for c in range(3):
        total += (a[c] + share * (b[c] - a[c])) ** 2
    return total
