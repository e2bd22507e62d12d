"""A fixed-wing aircraft: constant speed, a least turn radius, limits of climb and sink. It never stops.

It flies the shortest Dubins way to its waypoint, whatever the heading there, and when that is done circles to
the left on its least radius: so it holds, on a loiter circle that comes by the waypoint once a turn. That all
hold to the same side is a rule of the air: others know where an aircraft can be that just gave up its way.
It climbs and sinks at its rates, beside its turns, until it has the waypoint's altitude; where that comes
after the waypoint, it reaches it on one of its next turns.
"""

import math
from typing import ClassVar

import msgspec
import numpy as np

from estimator.arrays import FloatArray, IntArray, Positive
from estimator.kernels import exact_kernel
from planner.avoidance.halt import Evasion
from planner.plan import Predictions, Trajectory
from planner.vehicles.dubins import arc, to_point
from planner.vehicles.power import Power
from planner.vehicles.prediction import PATIENCE, grown, measure_steps, measure_times, sampled

STATES = 9  # x, y, z, yaw, climb rate; sense and metres left of the way's two parts
FAR_M = 1e6  # coordinates beyond this are no waypoints for an aircraft: it never gets there


class FixedWingConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a mission may say of a fixed-wing aircraft."""

    speed_m_s: Positive = 15.0
    turn_radius_m: Positive = 30.0
    climb_m_s: Positive = 3.0
    sink_m_s: Positive = 3.0
    tolerance_m: Positive = 5.0  # nearer than this counts as there
    power: Power = Power(rest_w=10.0, metre_j=3.7, climb_j_m=29.0)


class FixedWing:
    """VehicleModel of a fixed-wing aircraft. State (9,): see STATES.

    Source: Dubins (1957); limits as of the UAVs in Ponda et al. (2009).
    """

    Config: ClassVar[type[FixedWingConfig]] = FixedWingConfig
    hovers: ClassVar[bool] = False  # to hold is to circle

    def __init__(self, config: FixedWingConfig) -> None:
        """Raises ValueError if the aircraft could fly past a waypoint between two control steps."""
        if config.tolerance_m < config.speed_m_s * self.control_period:
            raise ValueError(
                f"tolerance_m: expected at least {config.speed_m_s * self.control_period:g} m, "
                f"which is flown in a control period, got {config.tolerance_m:g}"
            )
        self.config = config
        self._numbers = np.array(
            [
                *(self.control_period, config.speed_m_s, config.turn_radius_m),
                *(config.climb_m_s, config.sink_m_s, config.tolerance_m),
            ]
        )

    def __repr__(self) -> str:
        return f"FixedWing({self.config!r})"

    @property
    def power(self) -> Power:
        return self.config.power

    @property
    def control_period(self) -> float:
        return 0.02

    @property
    def evasion(self) -> Evasion:
        """How it gets out of the way: it circles to the left."""
        speed, radius = self.config.speed_m_s, self.config.turn_radius_m
        climb = max(self.config.climb_m_s, self.config.sink_m_s)
        return Evasion(speed, speed**2 / radius, turn_rate=speed / radius, climb=climb)

    def aim(self, state: FloatArray) -> FloatArray:
        """Its own level velocity (3,): it levels off when it gives up its way."""
        east, north, _ = self.velocity(state)
        return np.array([east, north, 0.0])

    def initial_state(self, pose: FloatArray) -> FloatArray:
        """On its loiter circle at the pose; there is no state at rest."""
        state = np.zeros(STATES)
        state[:4] = pose
        return state

    def pose(self, state: FloatArray) -> FloatArray:
        return np.array(state[:4])

    def velocity(self, state: FloatArray) -> FloatArray:
        speed = self.config.speed_m_s
        return np.array([speed * math.cos(state[3]), speed * math.sin(state[3]), state[4]])

    def begin(self, state: FloatArray, waypoint: FloatArray) -> FloatArray:
        """The state with the shortest way to a waypoint (3,) ahead of it."""
        begun = np.array(state, dtype=np.float64)
        _begin(begun, np.ascontiguousarray(waypoint, dtype=np.float64), self._numbers)
        return begun

    def advance(self, state: FloatArray, waypoint: FloatArray, steps: int) -> FloatArray:
        moved = np.array(state, dtype=np.float64)
        _fly(moved, np.ascontiguousarray(waypoint, dtype=np.float64), self._numbers, steps, False)
        return moved

    def reached(self, state: FloatArray, waypoint: FloatArray) -> bool:
        return math.dist(state[:3], waypoint) <= self.config.tolerance_m

    def steer(self, state: FloatArray, velocity: FloatArray) -> FloatArray:
        """The waypoint (3,) for which it turns to the direction of a velocity (3,); its speed stays."""
        level = max(float(np.hypot(velocity[0], velocity[1])), 1e-9)
        ahead = 10.0 * self.config.turn_radius_m
        rise = 10.0 * float(np.sign(velocity[2]))
        return np.array(
            [state[0] + velocity[0] / level * ahead, state[1] + velocity[1] / level * ahead, state[2] + rise]
        )

    def predict(self, state: FloatArray, waypoints: FloatArray, measure_period: float) -> Predictions:
        every = measure_steps(measure_period, self.control_period)
        targets = np.ascontiguousarray(waypoints, dtype=np.float64)
        config = self.config
        near = np.all(np.abs(targets) <= FAR_M, axis=1)
        gaps = np.where(np.reshape(near, (-1, 1)), np.abs(targets - state[:3]), 0.0)
        metres = np.hypot(gaps[:, 0], gaps[:, 1]) + 8.0 * math.pi * config.turn_radius_m
        seconds = metres / config.speed_m_s + gaps[:, 2] / min(config.climb_m_s, config.sink_m_s)
        bounds = np.where(near, np.ceil(PATIENCE * seconds / self.control_period), 0.0).astype(np.int64)
        start = np.array(state, dtype=np.float64)
        steps, costs, offsets, poses, ends = _predict(start, targets, self._numbers, bounds, every)
        times = measure_times(offsets, every * self.control_period)
        return Predictions(targets, steps, costs, offsets, times, poses, ends)

    def trajectory(
        self, state: FloatArray, waypoint: FloatArray, start_time: float, measure_period: float
    ) -> Trajectory:
        return sampled(self, state, waypoint, start_time, measure_period)


@exact_kernel
def _begin(s: FloatArray, waypoint: FloatArray, n: FloatArray) -> None:
    s[5:9] = to_point(s[0], s[1], s[3], waypoint[0], waypoint[1], n[2])


@exact_kernel
def _fly(s: FloatArray, waypoint: FloatArray, n: FloatArray, most: int, stop: bool) -> tuple[int, float]:
    """Advance state s (9,) in place by at most `most` periods; with `stop`, only until within tolerance.

    Returns the steps done and their control cost, sum of squares of turn rate and climb rate, (MA)ASI (18).
    """
    t, speed, radius, climb, sink, tolerance2 = n[0], n[1], n[2], n[3], n[4], n[5] ** 2
    cost = 0.0
    done = 0
    while done < most:
        dx, dy, dz = waypoint[0] - s[0], waypoint[1] - s[1], waypoint[2] - s[2]
        if stop and dx * dx + dy * dy + dz * dz <= tolerance2:
            break
        before = s[3]
        left = speed * t
        x, y, yaw = s[0], s[1], s[3]
        for part in range(3):
            length = left
            sense = 1.0  # when the way is done: the loiter circle
            if part < 2:
                length = min(left, s[6 + 2 * part])
                sense = s[5 + 2 * part]
                s[6 + 2 * part] -= length
            if length > 0.0:
                x, y, yaw = arc(x, y, yaw, sense / radius, length)
            left -= length
        s[4] = min(max(dz / t, -sink), climb)
        s[0], s[1], s[2] = x, y, s[2] + s[4] * t
        cost += ((yaw - before) / t) ** 2 + s[4] ** 2
        s[3] = yaw - 2.0 * math.pi * math.floor((yaw + math.pi) / (2.0 * math.pi))
        done += 1
    return done, cost


@exact_kernel
def _predict(
    start: FloatArray, waypoints: FloatArray, n: FloatArray, bounds: IntArray, every: int
) -> tuple[IntArray, FloatArray, IntArray, FloatArray, FloatArray]:
    """Fly from `start` to each waypoint (w, 3), noting the pose every `every` steps from the first."""
    w = waypoints.shape[0]
    steps = np.zeros(w, dtype=np.int64)
    costs = np.zeros(w)
    offsets = np.zeros(w + 1, dtype=np.int64)
    ends = np.empty((w, start.size))
    poses = np.empty((64, 4))
    row = 0
    for i in range(w):
        s = start.copy()
        if bounds[i] > 0:
            _begin(s, waypoints[i], n)
        while steps[i] < bounds[i]:
            x, y, z, yaw = s[0], s[1], s[2], s[3]
            chunk = min(every, bounds[i] - steps[i])
            done, cost = _fly(s, waypoints[i], n, chunk, True)
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
