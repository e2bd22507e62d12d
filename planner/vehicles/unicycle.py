"""A ground robot: the unicycle of (MA)ASI section 7.1.3 under a stabilising waypoint controller.

With the distance ρ to the waypoint and the error α of the heading towards it, the kinematics are

    ρ' = -v cos α,    α' = -ω + v sin α / ρ.

The feedback (in the manner of Khoukhi and Shahab 2013; derived here)

    v = min(v_max, s(ρ)) max(cos α, 0),    ω = k_α α + v sin α / ρ,

with s(ρ) of `planner.vehicles.approach`, at most min(k_ρ, ω_max) ρ and for deceleration b,

gives V = (ρ² + α²) / 2 the derivative V' = -ρ s(ρ) max(cos α, 0) cos α - k_α α² <= 0, zero only at the
waypoint, so it is asymptotically stable; the robot turns on the spot as long as the waypoint lies behind it,
and never drives backwards. Where ω meets its limit, s(ρ) <= ω_max ρ leaves
|v sin α / ρ| <= ω_max / 2, so |α| still falls. s(ρ) is a speed from which the robot can stop there,
and v follows the law at the acceleration a, or braking b. The waypoint is approached exponentially in the
end and is therefore within any tolerance after a finite time.
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

SPOT_RAD, ABEAM_RAD = 0.3, 1.75
STATES = 6  # x, y, z (kept), yaw, v, ω


class UnicycleConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a mission may say of a ground robot."""

    speed_m_s: Positive = 1.0
    turn_rate_deg_s: Positive = 90.0
    acceleration_m_s2: Positive = 1.0
    braking_m_s2: Positive | None = None  # default: as it accelerates
    tolerance_m: Positive = 0.1  # epsilon: nearer than this counts as there
    distance_gain: Positive = 1.0  # k_ρ, 1/s
    heading_gain: Positive = 3.0  # k_α, 1/s
    power: Power = Power(rest_w=6.0, metre_j=10.0, climb_j_m=0.0)


class Unicycle:
    """VehicleModel of the unicycle. State (6,): x, y, z, yaw, speed, turn rate; it never leaves its z.

    Source: (MA)ASI (Yousuf et al. 2024), section 7.1.3; Khoukhi and Shahab (2013).
    """

    Config: ClassVar[type[UnicycleConfig]] = UnicycleConfig

    def __init__(self, config: UnicycleConfig) -> None:
        self.config = config
        self._braking = config.braking_m_s2 or config.acceleration_m_s2
        self._numbers = np.array(
            [
                self.control_period,
                config.speed_m_s,
                math.radians(config.turn_rate_deg_s),
                config.acceleration_m_s2,
                config.tolerance_m,
                config.distance_gain,
                config.heading_gain,
                self._braking,
            ]
        )

    def __repr__(self) -> str:
        return f"Unicycle({self.config!r})"

    @property
    def power(self) -> Power:
        return self.config.power

    @property
    def control_period(self) -> float:
        return 0.005

    @property
    def evasion(self) -> Evasion:
        """How it gets out of the way: it brakes straight ahead."""
        config = self.config
        turning = math.radians(config.turn_rate_deg_s)
        agility = math.hypot(max(config.acceleration_m_s2, self._braking), config.speed_m_s * turning)
        approach = min(config.distance_gain, turning)
        return Evasion(config.speed_m_s, self._braking, approach, swerving=agility)

    def aim(self, state: FloatArray) -> FloatArray:
        """Its own velocity (3,)."""
        return self.velocity(state)

    def steer(self, state: FloatArray, velocity: FloatArray) -> FloatArray:
        """The waypoint (3,) for which it turns to the direction of a velocity (3,), then drives as fast.

        A direction far off its heading is first turned to on the spot, for a waypoint a little behind abeam.
        """
        off = math.remainder(math.atan2(velocity[1], velocity[0]) - float(state[3]), 2.0 * math.pi)
        if SPOT_RAD < abs(off) < ABEAM_RAD and (velocity[0] != 0.0 or velocity[1] != 0.0):
            turned = float(state[3]) + math.copysign(ABEAM_RAD, off)
            length = float(np.hypot(velocity[0], velocity[1]))
            velocity = np.array([length * math.cos(turned), length * math.sin(turned), 0.0])
        speed = float(np.linalg.norm(velocity))
        way = stopping(speed, self._braking, self.evasion.approach)
        return np.asarray(state[:3] + velocity * (way / max(speed, 1e-9)))

    def initial_state(self, pose: FloatArray) -> FloatArray:
        return np.array([pose[0], pose[1], pose[2], pose[3], 0.0, 0.0])

    def pose(self, state: FloatArray) -> FloatArray:
        return np.array(state[:4])

    def velocity(self, state: FloatArray) -> FloatArray:
        return np.array([state[4] * math.cos(state[3]), state[4] * math.sin(state[3]), 0.0])

    def begin(self, state: FloatArray, waypoint: FloatArray) -> FloatArray:
        """The controller has no memory: the state as it is."""
        return np.array(state)

    def advance(self, state: FloatArray, waypoint: FloatArray, steps: int) -> FloatArray:
        moved = np.array(state, dtype=np.float64)
        _drive(moved, np.ascontiguousarray(waypoint, dtype=np.float64), self._numbers, steps, False)
        return moved

    def reached(self, state: FloatArray, waypoint: FloatArray) -> bool:
        """Within the tolerance on the ground; the waypoint's altitude does not count."""
        gap = state[:2] - waypoint[:2]
        return bool(gap @ gap <= self.config.tolerance_m**2)

    def predict(self, state: FloatArray, waypoints: FloatArray, measure_period: float) -> Predictions:
        every = measure_steps(measure_period, self.control_period)
        targets = np.ascontiguousarray(waypoints, dtype=np.float64)
        gaps = np.linalg.norm(targets[:, :2] - state[:2], axis=1)
        config = self.config
        turn = 360.0 / config.turn_rate_deg_s  # seconds; turning may come before driving
        bounds = step_bounds(
            gaps + turn * config.speed_m_s,
            config.speed_m_s,
            config.acceleration_m_s2,
            abs(float(state[4])),
            self.control_period,
        )
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
    """Advance state s (6,) in place by at most `most` periods; with `stop`, only until within tolerance.

    Returns the steps done and their control cost, sum of v^2 + ω^2, (MA)ASI (18).
    """
    t, speed, turn, acceleration, tolerance2 = n[0], n[1], n[2], n[3], n[4] ** 2
    distance_gain, heading_gain, braking = n[5], n[6], n[7]
    x, y, yaw, v, w = s[0], s[1], s[3], s[4], s[5]
    cost = 0.0
    done = 0
    while done < most:
        dx, dy = waypoint[0] - x, waypoint[1] - y
        square = dx * dx + dy * dy
        if stop and square <= tolerance2:
            break
        gap = max(math.sqrt(square), 1e-9)
        # cos α and sin α without an angle; the angle itself only for the turn
        c, k = math.cos(yaw), math.sin(yaw)
        ahead, left = (c * dx + k * dy) / gap, (c * dy - k * dx) / gap
        aim = min(speed, stoppable(gap, braking, min(distance_gain, turn)))
        aim *= max(ahead, 0.0)
        v += min(max(aim - v, -braking * t), acceleration * t)
        w = heading_gain * math.atan2(left, ahead) + v * left / gap
        w = min(max(w, -turn), turn)
        middle = yaw + 0.5 * w * t
        x += v * t * math.cos(middle)
        y += v * t * math.sin(middle)
        yaw += w * t
        if abs(yaw) > math.pi:
            yaw -= math.copysign(2.0 * math.pi, yaw)
        cost += v * v + w * w
        done += 1
    s[0], s[1], s[3], s[4], s[5] = x, y, yaw, v, w
    return done, cost


@exact_kernel
def _predict(
    start: FloatArray, waypoints: FloatArray, n: FloatArray, bounds: IntArray, every: int
) -> tuple[IntArray, FloatArray, IntArray, FloatArray, FloatArray]:
    """Drive from `start` to each waypoint (w, 3), noting the pose every `every` steps from the first."""
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
