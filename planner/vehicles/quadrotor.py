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

from typing import ClassVar

import msgspec
import numpy as np

from estimator.arrays import FloatArray, Positive
from planner.avoidance.halt import Evasion, stopping
from planner.plan import Predictions, Trajectory
from planner.vehicles.power import Power
from planner.vehicles.prediction import measure_steps, measure_times, sampled, step_bounds
from planner.vehicles.quadrotor_flight import APPROACH, LANES, ROWS, STATES, TOLERANCE, WAYPOINT, fly, predict
from planner.vehicles.quadrotor_lqr import lqr


class QuadrotorConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a mission may say of a quadrotor. Mass and inertias are those of the Parrot Mambo."""

    speed_m_s: Positive = 8.0
    acceleration_m_s2: Positive = 4.0
    tolerance_m: Positive = 0.5  # epsilon: nearer than this counts as there
    mass_kg: Positive = 0.063
    inertias_kg_m2: tuple[Positive, Positive, Positive] = (0.5829e-4, 0.7169e-4, 1.0e-4)
    power: Power = Power(rest_w=18.0, metre_j=0.0, climb_j_m=0.62)


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
                *(self.control_period, *self.lqr.level, self.lqr.lag),
                *(*self.lqr.climb, self.lqr.climb_lag, *self.lqr.turn),
                *(*config.inertias_kg_m2, config.mass_kg),
                *(config.speed_m_s, config.acceleration_m_s2, config.tolerance_m),
            ]
        )

    def __repr__(self) -> str:
        return f"Quadrotor({self.config!r})"

    @property
    def power(self) -> Power:
        return self.config.power

    @property
    def control_period(self) -> float:
        return 0.005

    @property
    def evasion(self) -> Evasion:
        """How it gets out of the way: its reference brakes, and its velocity follows with the lag."""
        return Evasion(self.config.speed_m_s, self.config.acceleration_m_s2, APPROACH, self.lqr.lag)

    def aim(self, state: FloatArray) -> FloatArray:
        """The velocity (3,) of the reference point; its own follows with the lag."""
        return np.array(state[15:18])

    def steer(self, state: FloatArray, velocity: FloatArray) -> FloatArray:
        """The waypoint (3,) for which the reference moves at a velocity (3,), m/s."""
        speed = float(np.linalg.norm(velocity))
        way = stopping(speed, self.config.acceleration_m_s2, APPROACH)
        return np.asarray(state[12:15] + velocity * (way / max(speed, 1e-9)))

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
        lanes = np.zeros((ROWS, LANES))
        lanes[:STATES] = np.asarray(state, dtype=np.float64)[:, None]
        lanes[WAYPOINT : WAYPOINT + 3] = np.asarray(waypoint, dtype=np.float64)[:, None]
        lanes[TOLERANCE] = -1.0
        fly(lanes, self._numbers, steps)
        return np.array(lanes[:STATES, 0])

    def reached(self, state: FloatArray, waypoint: FloatArray) -> bool:
        gap = state[:3] - waypoint
        return bool(gap @ gap <= self.config.tolerance_m**2)

    def predict(self, state: FloatArray, waypoints: FloatArray, measure_period: float) -> Predictions:
        every = measure_steps(measure_period, self.control_period)
        targets = np.ascontiguousarray(waypoints, dtype=np.float64)
        present = max(float(np.linalg.norm(state[6:9])), float(np.linalg.norm(state[15:18])))
        with np.errstate(over="ignore"):
            gaps = np.linalg.norm(targets - state[:3], axis=1)
        bounds = step_bounds(
            gaps,
            self.config.speed_m_s,
            self.config.acceleration_m_s2,
            present,
            self.control_period,
        )
        start = np.array(state, dtype=np.float64)
        steps, costs, offsets, poses, ends = predict(start, targets, self._numbers, bounds, every)
        times = measure_times(offsets, every * self.control_period)
        return Predictions(targets, steps, costs, offsets, times, poses, ends)

    def trajectory(
        self, state: FloatArray, waypoint: FloatArray, start_time: float, measure_period: float
    ) -> Trajectory:
        return sampled(self, state, waypoint, start_time, measure_period)
