"""How near the ways to the candidates come to the ways of other robots.

Between samples both robots are taken to move straight.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel
from planner.commitments import heeded
from planner.plan import Commitment, PlanProblem, Trajectory, VehicleModel
from planner.vehicles.prediction import finer, measure_steps

SAME_PLACE = 1e-6  # m
SOON_S = 3.0


@dataclass(frozen=True, slots=True)
class Courses:
    """The ways of k other robots, one after another."""

    offsets: IntArray  # (k + 1,) other i has the samples offsets[i]:offsets[i + 1]
    times: FloatArray  # (total,) team time
    poses: FloatArray  # (total, 4)

    @staticmethod
    def of(others: Sequence[Commitment]) -> "Courses":
        """Of usable commitments; those without samples say nothing of where a robot is."""
        some = [other for other in others if other.times.size]
        sizes = [0, *(other.times.size for other in some)]
        return Courses(
            np.cumsum(np.array(sizes, dtype=np.int64)),
            np.concatenate([np.zeros(0), *(other.times for other in some)]),
            np.vstack([np.zeros((0, 4)), *(other.poses for other in some)]),
        )


def keeps_apart(
    problem: PlanProblem, vehicle: VehicleModel, way: Trajectory, courses: Courses | None = None
) -> bool:
    """Whether a trajectory keeps the problem's separation from what the other robots have committed to.

    Robots that are too close already need only come no closer, or they would hold each other for ever.

    Args:
        problem, vehicle: of the robot.
        way: begun at the problem's start.
        courses: of the others, where somebody has them already.
    """
    if problem.separation <= 0 or not problem.others:
        return True
    known = Courses.of(heeded(problem.others, problem.robot)) if courses is None else courses
    _, enough = kept(
        known,
        problem.start_time,
        problem.separation,
        vehicle.pose(problem.state)[:3],
        np.array([0, way.times.size]),
        way.times - problem.start_time,
        np.ascontiguousarray(way.poses),
        np.array([way.end_time - problem.start_time]),
        np.ascontiguousarray(way.poses[-1:, :3]),
    )
    return bool(enough[0])


def meets_soon(problem: PlanProblem, vehicle: VehicleModel, waypoint: FloatArray, courses: Courses) -> bool:
    """Whether straight on to a waypoint (3,) it comes too near to another robot within SOON_S seconds.

    Then `keeps_apart` would say no to the trajectory; this saves predicting the rest of it.

    Args:
        problem, vehicle: of the robot.
        waypoint: where it goes without a corner.
        courses: of the others.
    """
    if problem.separation <= 0 or courses.times.size == 0:
        return False
    every = measure_steps(problem.measure_period, vehicle.control_period)
    every //= finer(every, vehicle.control_period)
    seconds = every * vehicle.control_period
    poses = [vehicle.pose(problem.state)]
    state = vehicle.begin(problem.state, waypoint)
    while (len(poses) - 1) * seconds < SOON_S:
        state = vehicle.advance(state, waypoint, every)
        if vehicle.reached(state, waypoint):
            break
        poses.append(vehicle.pose(state))
    way, last = np.stack(poses), len(poses) - 1
    _, enough = kept(
        courses,
        problem.start_time,
        problem.separation,
        way[0, :3],
        np.array([0, last]),
        seconds * np.arange(last, dtype=np.float64),
        way[:last],
        np.array([seconds * last]),
        np.ascontiguousarray(way[last:, :3]),
    )
    return not enough[0]


def kept(
    courses: Courses,
    start_time: float,
    separation: float,
    here: FloatArray,
    offsets: IntArray,
    times: FloatArray,
    poses: FloatArray,
    end_times: FloatArray,
    ends: FloatArray,
) -> tuple[FloatArray, BoolArray]:
    """The smallest distances (w,) in metres of w ways to other robots, and whether all are enough.

    Args:
        courses: of the others.
        start_time: team time at which all ways begin.
        separation: metres; of robots that are nearer already at the start, only as much as they have.
        here: (3,) where the ways begin.
        offsets, times, poses, end_times, ends: of the ways, see `clearances`.
    """
    least, enough = np.full(offsets.size - 1, np.inf), np.ones(offsets.size - 1, dtype=np.bool_)
    others = courses.times - start_time
    _kept(
        offsets, times, poses, end_times, ends, courses.offsets, others, courses.poses, separation, here,
        least, enough,
    )  # fmt: skip
    return least, enough


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
def _kept(
    offsets: IntArray,
    times: FloatArray,
    poses: FloatArray,
    end_times: FloatArray,
    ends: FloatArray,
    other_offsets: IntArray,
    other_times: FloatArray,
    other_poses: FloatArray,
    separation: float,
    here: FloatArray,
    least: FloatArray,
    enough: BoolArray,
) -> None:
    present = np.empty((1, 4))
    present[0, :3] = here
    present[0, 3] = 0.0
    one, at, own = np.array([0, 0]), np.zeros(1), np.empty(least.size)
    now = np.empty(1)
    for k in range(other_offsets.size - 1):
        first, last = other_offsets[k], other_offsets[k + 1]
        _clearances(
            one,
            at[:0],
            present[:0],
            at,
            present[:, :3],
            other_times[first:last],
            other_poses[first:last],
            now,
        )
        _clearances(
            offsets, times, poses, end_times, ends, other_times[first:last], other_poses[first:last], own
        )
        for i in range(own.size):
            least[i] = min(least[i], own[i])
            enough[i] = enough[i] and own[i] >= min(separation, now[0]) - SAME_PLACE


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
