"""A point mass: goes anywhere, in 2D or 3D, within limits of speed and acceleration.

It steers for its waypoint as fast as still lets it stop there (`planner.vehicles.approach`); its velocity
follows by at most a T_s per control period.
"""

import math
from typing import ClassVar

import msgspec
import numpy as np

from estimator.arrays import FloatArray, IntArray, Positive
from estimator.kernels import exact_kernel
from planner.avoidance.halt import Evasion, stopping
from planner.plan import Predictions, Trajectory
from planner.vehicles.approach import stoppable
from planner.vehicles.power import Power
from planner.vehicles.prediction import grown, measure_steps, measure_times, sampled, step_bounds

APPROACH = 2.0  # k, 1/s


class PointMassConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a mission may say of a point mass."""

    speed_m_s: Positive = 5.0
    acceleration_m_s2: Positive = 2.0
    tolerance_m: Positive = 0.5  # nearer than this counts as there
    power: Power = Power(rest_w=150.0, metre_j=0.0, climb_j_m=9.8)


class PointMass:
    """VehicleModel of the point mass. State (7,): x, y, z, yaw (it keeps its first), velocity (3)."""

    Config: ClassVar[type[PointMassConfig]] = PointMassConfig

    def __init__(self, config: PointMassConfig) -> None:
        self.config = config
        self._numbers = np.array(
            [self.control_period, config.speed_m_s, config.acceleration_m_s2, config.tolerance_m]
        )

    def __repr__(self) -> str:
        return f"PointMass({self.config!r})"

    @property
    def power(self) -> Power:
        return self.config.power

    @property
    def control_period(self) -> float:
        return 0.02

    @property
    def evasion(self) -> Evasion:
        """How it gets out of the way: it brakes on the spot."""
        return Evasion(self.config.speed_m_s, self.config.acceleration_m_s2, APPROACH)

    def aim(self, state: FloatArray) -> FloatArray:
        """Its own velocity (3,)."""
        return np.array(state[4:7])

    def initial_state(self, pose: FloatArray) -> FloatArray:
        state = np.zeros(7)
        state[:4] = pose
        return state

    def pose(self, state: FloatArray) -> FloatArray:
        return np.array(state[:4])

    def velocity(self, state: FloatArray) -> FloatArray:
        return np.array(state[4:7])

    def begin(self, state: FloatArray, waypoint: FloatArray) -> FloatArray:
        """The controller has no memory: the state as it is."""
        return np.array(state)

    def advance(self, state: FloatArray, waypoint: FloatArray, steps: int) -> FloatArray:
        moved = np.array(state, dtype=np.float64)
        _drive(moved, np.ascontiguousarray(waypoint, dtype=np.float64), self._numbers, steps, False)
        return moved

    def reached(self, state: FloatArray, waypoint: FloatArray) -> bool:
        gap = state[:3] - waypoint
        return bool(gap @ gap <= self.config.tolerance_m**2)

    def steer(self, state: FloatArray, velocity: FloatArray) -> FloatArray:
        """The waypoint (3,) for which it steers at a velocity (3,) m/s."""
        speed = float(np.linalg.norm(velocity))
        way = stopping(speed, self.config.acceleration_m_s2, APPROACH)
        return np.asarray(state[:3] + velocity * (way / max(speed, 1e-9)))

    def predict(self, state: FloatArray, waypoints: FloatArray, measure_period: float) -> Predictions:
        every = measure_steps(measure_period, self.control_period)
        targets = np.ascontiguousarray(waypoints, dtype=np.float64)
        config = self.config
        with np.errstate(over="ignore"):
            gaps = np.linalg.norm(targets - state[:3], axis=1)
        present = float(np.linalg.norm(state[4:7]))
        bounds = step_bounds(gaps, config.speed_m_s, config.acceleration_m_s2, present, self.control_period)
        start = np.array(state, dtype=np.float64)
        steps, costs, offsets, poses, ends = _predict(start, targets, self._numbers, bounds, every)
        times = measure_times(offsets, every * self.control_period)
        return Predictions(targets, steps, costs, offsets, times, poses, ends)

    def trajectory(
        self, state: FloatArray, waypoint: FloatArray, start_time: float, measure_period: float
    ) -> Trajectory:
        return sampled(self, state, waypoint, start_time, measure_period)


@exact_kernel
def _drive(s: FloatArray, waypoint: FloatArray, n: FloatArray, most: int, stop: bool) -> tuple[int, float]:
    """Advance state s (7,) in place by at most `most` periods; with `stop`, only until within tolerance.

    Returns the steps done and their control cost, the sum of the accelerations' squares, (MA)ASI (18).
    """
    t, speed, acceleration, tolerance2 = n[0], n[1], n[2], n[3] ** 2
    change = acceleration * t
    cost = 0.0
    done = 0
    while done < most:
        dx, dy, dz = waypoint[0] - s[0], waypoint[1] - s[1], waypoint[2] - s[2]
        square = dx * dx + dy * dy + dz * dz
        if stop and square <= tolerance2:
            break
        gap = max(math.sqrt(square), 1e-12)
        scale = min(speed, stoppable(gap, acceleration, APPROACH)) / gap
        dx, dy, dz = dx * scale - s[4], dy * scale - s[5], dz * scale - s[6]
        share = change / max(math.sqrt(dx * dx + dy * dy + dz * dz), change)
        dx, dy, dz = dx * share, dy * share, dz * share
        # The mean of the velocities before and after: exact for a constant acceleration over the period.
        s[0] += (s[4] + 0.5 * dx) * t
        s[1] += (s[5] + 0.5 * dy) * t
        s[2] += (s[6] + 0.5 * dz) * t
        s[4] += dx
        s[5] += dy
        s[6] += dz
        cost += (dx * dx + dy * dy + dz * dz) / (t * t)
        done += 1
    return done, cost


@exact_kernel
def _predict(
    start: FloatArray, waypoints: FloatArray, n: FloatArray, bounds: IntArray, every: int
) -> tuple[IntArray, FloatArray, IntArray, FloatArray, FloatArray]:
    """Go from `start` to each waypoint (w, 3), noting the pose every `every` steps from the first."""
    w = waypoints.shape[0]
    steps = np.zeros(w, dtype=np.int64)
    costs = np.zeros(w)
    offsets = np.zeros(w + 1, dtype=np.int64)
    ends = np.empty((w, start.size))
    poses = np.empty((64, 4))
    row = 0
    for i in range(w):
        s = start.copy()
        while steps[i] < bounds[i]:
            x, y, z, yaw = s[0], s[1], s[2], s[3]
            chunk = min(every, bounds[i] - steps[i])
            done, cost = _drive(s, waypoints[i], n, chunk, True)
            if done > 0:
                if row == poses.shape[0]:
                    poses = grown(poses)
                poses[row, 0], poses[row, 1], poses[row, 2], poses[row, 3] = x, y, z, yaw
                row += 1
                steps[i] += done
                costs[i] += cost
            if done < chunk:
                break
        ends[i] = s
        offsets[i + 1] = row
    return steps, costs, offsets, poses[:row].copy(), ends
