"""A quadrotor that flies to waypoints: the linear Parrot Mambo of (MA)ASI section 5.1 under a discrete LQR.

Model. Near hover, with roll φ, pitch θ, yaw ψ, thrust surplus F over the weight m g and torques τ,

    x'' = g θ,  y'' = -g φ,  z'' = F / m,  φ'' = τ_φ / I_x,  θ'' = τ_θ / I_y,  ψ'' = τ_ψ / I_z,

which is Newton's and Euler's law to first order in angles and rates (products such as (I_y - I_z) q r are of
second order and vanish). The paper writes it in north-east-down; half a turn about the nose gives ours:
nose n -> x, right e -> -y, down -> -z, so roll keeps its sign while pitch, yaw and the collective force
change theirs, and a drone of yaw 0 looks along x (east). As in the paper all angle setpoints are 0, so the
drone turns to yaw 0 and stays there. The zero-order hold at T_s is exact: the chains are nilpotent, so their
exponential series ends.

Weights. The paper prints only "diag([1/15, 1000, 1000, 100])" for a 12-state model with 4 inputs. Four
numbers, and states listed as position, angles, linear and angular velocity, make it the weights of these four
blocks of three. Input weights are not printed. Ours are 1 on each angular
acceleration, that is 1 / I^2 on the torques: with 1 on a torque in N m, some 10^-4 here, torque would cost
nothing and the gain would ask for dead beat in one period of 5 ms. The weight on the collective force is such
that climbing answers with the same lag as level flight, or a straight reference would be flown bent.

Speed. A waypoint as the setpoint of this LQR would be approached with its slow pole, 1 / 122 s, after a kick
at the start that no motor can give. Instead it tracks a reference point that moves to the waypoint within
the limits of speed and acceleration: from rest on the straight line with a trapezoidal profile, and from any
other speed along the curve that these limits allow. The reference is part of the state, so a drone that
passes a waypoint keeps its speed.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import msgspec
import numpy as np

from estimator.arrays import FloatArray, IntArray, Positive
from estimator.kernels import exact_kernel
from planner.plan import Predictions, Trajectory
from planner.prediction import grown, measure_steps, measure_times, sampled, step_bounds

GRAVITY = 9.81
POSITION_WEIGHT = 1.0 / 15.0
ANGLE_WEIGHT = 1000.0
VELOCITY_WEIGHT = 1000.0
RATE_WEIGHT = 100.0
APPROACH = 2.0  # 1/s: the last metres of the reference, where sqrt(2 a d) would be infinitely steep
STATES = 18  # the paper's position, angles, velocity, rates (3 each), then the reference's position, velocity


class QuadrotorConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a mission may say of a quadrotor. Mass and inertias are those of the Parrot Mambo."""

    speed_m_s: Positive = 8.0
    acceleration_m_s2: Positive = 4.0
    tolerance_m: Positive = 0.5  # epsilon: nearer than this counts as there
    mass_kg: Positive = 0.063
    inertias_kg_m2: tuple[Positive, Positive, Positive] = (0.5829e-4, 0.7169e-4, 1.0e-4)


@dataclass(frozen=True, slots=True)
class Lqr:
    """The discrete LQR of the four chains, with inputs as the accelerations that they cause."""

    level: FloatArray  # (4,) gain on position, tilt, velocity, tilt rate -> angular acceleration
    climb: FloatArray  # (2,) gain on position, velocity -> vertical acceleration
    turn: FloatArray  # (2,) gain on yaw, yaw rate -> angular acceleration
    lag: float  # s: level flight under a steady acceleration is this far behind its reference
    climb_lag: float  # s, nearly the same
    climb_weight: float  # input weight on the vertical acceleration


class Quadrotor:
    """VehicleModel of the quadrotor. State (18,) in SI units, radians, ENU: see STATES.

    Source: (MA)ASI (Yousuf et al. 2024), section 5.1.
    """

    Config: ClassVar[type[QuadrotorConfig]] = QuadrotorConfig

    def __init__(self, config: QuadrotorConfig) -> None:
        self.config = config
        self.lqr = lqr(self.control_period)
        self._numbers = np.array(
            [
                self.control_period,
                *self.lqr.level,
                self.lqr.lag,
                *self.lqr.climb,
                self.lqr.climb_lag,
                *self.lqr.turn,
                *config.inertias_kg_m2,
                config.mass_kg,
                config.speed_m_s,
                config.acceleration_m_s2,
                config.tolerance_m,
            ]
        )

    def __repr__(self) -> str:
        return f"Quadrotor({self.config!r})"

    @property
    def control_period(self) -> float:
        return 0.005

    def initial_state(self, pose: FloatArray) -> FloatArray:
        return self.state_at(pose, np.zeros(3))

    def state_at(self, pose: FloatArray, velocity: FloatArray) -> FloatArray:
        """The state of a level drone at pose (4,) with velocity (3,), as an autopilot reports it."""
        state = np.zeros(STATES)
        state[0:3] = pose[:3]
        state[5] = pose[3]
        state[6:9] = velocity
        state[12:15] = state[0:3] + velocity * np.array([self.lqr.lag, self.lqr.lag, self.lqr.climb_lag])
        state[15:18] = velocity
        return state

    def pose(self, state: FloatArray) -> FloatArray:
        return np.array([state[0], state[1], state[2], state[5]])

    def velocity(self, state: FloatArray) -> FloatArray:
        return np.array(state[6:9])

    def begin(self, state: FloatArray, waypoint: FloatArray) -> FloatArray:
        """The reference goes on from where it is with the speed it has; only its aim changes."""
        return np.array(state)

    def advance(self, state: FloatArray, waypoint: FloatArray, steps: int) -> FloatArray:
        moved = np.array(state, dtype=np.float64)
        _fly(moved, np.ascontiguousarray(waypoint, dtype=np.float64), self._numbers, steps, False)
        return moved

    def reached(self, state: FloatArray, waypoint: FloatArray) -> bool:
        gap = state[:3] - waypoint
        return bool(gap @ gap <= self.config.tolerance_m**2)

    def predict(self, state: FloatArray, waypoints: FloatArray, measure_period: float) -> Predictions:
        every = measure_steps(measure_period, self.control_period)
        targets = np.ascontiguousarray(waypoints, dtype=np.float64)
        present = max(float(np.linalg.norm(state[6:9])), float(np.linalg.norm(state[15:18])))
        bounds = step_bounds(
            np.linalg.norm(targets - state[:3], axis=1),
            self.config.speed_m_s,
            self.config.acceleration_m_s2,
            present,
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


@cache
def lqr(period: float) -> Lqr:
    """Solve the Riccati equations of the chains; they share no state, input or weight, so it is exact."""
    from scipy.linalg import solve_discrete_are  # noqa: PLC0415  # half a second that only quadrotors pay

    def gain(a: FloatArray, b: FloatArray, weights: list[float], weight: float) -> FloatArray:
        r = np.array([[weight]])
        p = solve_discrete_are(a, b, np.diag(weights), r)
        return np.asarray(np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)[0], dtype=np.float64)

    level = gain(*level_chain(period), [POSITION_WEIGHT, ANGLE_WEIGHT, VELOCITY_WEIGHT, RATE_WEIGHT], 1.0)
    lag = level[1] / (GRAVITY * level[2])
    climb_weight = VELOCITY_WEIGHT * lag**2
    climb = gain(*double_integrator(period), [POSITION_WEIGHT, VELOCITY_WEIGHT], climb_weight)
    turn = gain(*double_integrator(period), [ANGLE_WEIGHT, RATE_WEIGHT], 1.0)
    return Lqr(level, climb, turn, float(lag), float(1.0 / climb[1]), float(climb_weight))


def level_chain(t: float) -> tuple[FloatArray, FloatArray]:
    """A (4, 4) and B (4, 1) of position, tilt, velocity, tilt rate under an angular acceleration."""
    a = np.array(
        [
            [1.0, GRAVITY * t**2 / 2, t, GRAVITY * t**3 / 6],
            [0.0, 1.0, 0.0, t],
            [0.0, GRAVITY * t, 1.0, GRAVITY * t**2 / 2],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
    return a, np.array([[GRAVITY * t**4 / 24], [t**2 / 2], [GRAVITY * t**3 / 6], [t]])


def double_integrator(t: float) -> tuple[FloatArray, FloatArray]:
    """A (2, 2) and B (2, 1) of a position and its speed under an acceleration."""
    return np.array([[1.0, t], [0.0, 1.0]]), np.array([[t**2 / 2], [t]])


@exact_kernel
def _fly(s: FloatArray, waypoint: FloatArray, n: FloatArray, most: int, stop: bool) -> tuple[int, float]:
    """Advance state s (18,) in place by at most `most` periods; with `stop`, only until within tolerance.

    Returns the steps done and their control cost, sum of u^T u in N^2 and (N m)^2, (MA)ASI (18).
    """
    t, kp, ka, kv, kr, lag = n[0], n[1], n[2], n[3], n[4], n[5]
    cp, cv, climb_lag, tp, tr = n[6], n[7], n[8], n[9], n[10]
    ix2, iy2, iz2, m2 = n[11] ** 2, n[12] ** 2, n[13] ** 2, n[14] ** 2
    speed, acceleration, tolerance2 = n[15], n[16], n[17] ** 2
    wx, wy, wz = waypoint[0], waypoint[1], waypoint[2]
    x, y, z, roll, pitch, yaw = s[0], s[1], s[2], s[3], s[4], s[5]
    vx, vy, vz, p, q, r = s[6], s[7], s[8], s[9], s[10], s[11]
    rx, ry, rz, cx, cy, cz = s[12], s[13], s[14], s[15], s[16], s[17]
    near = acceleration / (APPROACH * APPROACH)  # where the two laws of approach meet, with equal slope
    change = acceleration * t
    gt, gt2, gt3, gt4 = GRAVITY * t, GRAVITY * t**2 / 2, GRAVITY * t**3 / 6, GRAVITY * t**4 / 24
    t2 = t**2 / 2
    cost = 0.0
    done = 0
    while done < most:
        if stop and (x - wx) ** 2 + (y - wy) ** 2 + (z - wz) ** 2 <= tolerance2:
            break
        # The reference: aim at the waypoint as fast as still lets it stop there, change speed as allowed.
        dx, dy, dz = wx - rx, wy - ry, wz - rz
        gap = math.sqrt(dx * dx + dy * dy + dz * dz)
        if gap > near:
            scale = min(speed, math.sqrt(2.0 * acceleration * (gap - 0.5 * near))) / gap
        else:
            scale = min(APPROACH, speed / max(gap, 1e-12))
        dx, dy, dz = dx * scale - cx, dy * scale - cy, dz * scale - cz
        jump = math.sqrt(dx * dx + dy * dy + dz * dz)
        share = change / max(jump, change)
        cx, cy, cz = cx + dx * share, cy + dy * share, cz + dz * share
        rx, ry, rz = rx + cx * t, ry + cy * t, rz + cz * t
        # The LQR about it. Behind it by the lag is where a drone in steady flight belongs.
        ux = -kp * (x - rx + lag * cx) - ka * pitch - kv * (vx - cx) - kr * q
        uy = kp * (y - ry + lag * cy) - ka * roll + kv * (vy - cy) - kr * p
        uz = -cp * (z - rz + climb_lag * cz) - cv * (vz - cz)
        ut = -tp * yaw - tr * r
        x, vx = x + t * vx + gt2 * pitch + gt3 * q + gt4 * ux, vx + gt * pitch + gt2 * q + gt3 * ux
        y, vy = y + t * vy - gt2 * roll - gt3 * p - gt4 * uy, vy - gt * roll - gt2 * p - gt3 * uy
        z, vz = z + t * vz + t2 * uz, vz + t * uz
        pitch, q = pitch + t * q + t2 * ux, q + t * ux
        roll, p = roll + t * p + t2 * uy, p + t * uy
        yaw, r = yaw + t * r + t2 * ut, r + t * ut
        cost += ix2 * uy * uy + iy2 * ux * ux + iz2 * ut * ut + m2 * uz * uz
        done += 1
    s[0], s[1], s[2], s[3], s[4], s[5] = x, y, z, roll, pitch, yaw
    s[6], s[7], s[8], s[9], s[10], s[11] = vx, vy, vz, p, q, r
    s[12], s[13], s[14], s[15], s[16], s[17] = rx, ry, rz, cx, cy, cz
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
        while steps[i] < bounds[i]:
            before = s[0], s[1], s[2], s[5]
            chunk = min(every, bounds[i] - steps[i])
            done, cost = _fly(s, waypoints[i], n, chunk, True)
            if done > 0:
                if row == poses.shape[0]:
                    poses = grown(poses)
                poses[row, 0], poses[row, 1], poses[row, 2], poses[row, 3] = before
                row += 1
                steps[i] += done
                costs[i] += cost
            if done < chunk:
                break
        ends[i] = s
        offsets[i + 1] = row
    return steps, costs, offsets, poses[:row].copy(), ends
