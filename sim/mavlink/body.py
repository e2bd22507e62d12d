"""What moves: the planner's quadrotor or unicycle, seen in local NED: north, east, down, m and rad."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from planner.plan import VehicleModel
from planner.vehicles.quadrotor import Quadrotor, QuadrotorConfig
from planner.vehicles.unicycle import Unicycle, UnicycleConfig

Vector = tuple[float, float, float]
STEP = 0.005  # s, the control period of both models
TURN_RATE = math.radians(60.0)
FALL = 10.0  # m/s


@dataclass(frozen=True, slots=True)
class Limits:
    """How fast it may go, m/s."""

    level: float
    up: float
    down: float


def enu(ned: Vector) -> FloatArray:
    return np.array([ned[1], ned[0], -ned[2]])


def ned(vector: FloatArray) -> Vector:
    return float(vector[1]), float(vector[0]), -float(vector[2])


class Body(ABC):
    """Goes to a position or with a velocity, whichever it was told last. The ground is at down = 0."""

    flies: bool = True
    _model: VehicleModel
    _state: FloatArray

    def __init__(self, yaw: float) -> None:
        self.yaw = yaw
        self.yaw_rate = 0.0
        self.on_ground = True
        self._order: tuple[object, ...] = ()
        self.cut = False  # motors are off
        self._waypoint: FloatArray = np.zeros(3)
        self._driven: FloatArray | None = np.zeros(3)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({[round(x, 2) for x in self.position]}, on_ground={self.on_ground})"

    @property
    def position(self) -> Vector:
        return ned(self._model.pose(self._state)[:3])

    @property
    def velocity(self) -> Vector:
        return ned(self._model.velocity(self._state))

    @property
    @abstractmethod
    def tilt(self) -> tuple[float, float]:
        """Roll and pitch, rad, nose up and right side down positive."""

    def goto(self, target: Vector, limits: Limits) -> None:
        """Go to a position and stay there."""
        if self._order == (target, limits):
            return
        self._order = (target, limits)
        self._waypoint, self._driven = enu(target), None
        gap = np.abs(np.subtract(target, self.position))
        level, rise = float(np.hypot(gap[0], gap[1])), float(gap[2])
        climbing = limits.up if target[2] < self.position[2] else limits.down
        way = math.hypot(level, rise)
        times = max(level / limits.level, rise / climbing)
        self._set_speed(way / times if times > 1e-6 else limits.level)

    def drive(self, velocity: Vector) -> None:
        """Go with a velocity until told otherwise; (0, 0, 0): stop and hold."""
        if self._order == (velocity,):
            return
        self._order = (velocity,)
        self._driven = enu(velocity)
        speed = float(np.linalg.norm(self._driven))
        if speed > 1e-3:
            self._set_speed(speed)

    @abstractmethod
    def turn(self, yaw: float | None, rate: float | None, seconds: float) -> None:
        """Turn towards a yaw, or at a rate, for so long; neither: keep the yaw."""

    @abstractmethod
    def _set_speed(self, speed: float) -> None:
        """The greatest speed from now on."""

    def advance(self, steps: int) -> None:
        """Move for so many control steps."""
        if self._driven is not None:
            self._waypoint = self._model.steer(self._state, self._driven)  # type: ignore[attr-defined]
        self._state = self._model.advance(self._state, self._waypoint, steps)


class Copter(Body):
    """The quadrotor of the planner, with a yaw of its own: that model always looks along x."""

    def __init__(self, yaw: float, acceleration: float) -> None:
        super().__init__(yaw)
        self._acceleration = acceleration
        self._model: Quadrotor = Quadrotor(QuadrotorConfig(acceleration_m_s2=acceleration))
        self._state = self._model.initial_state(np.zeros(4))

    @property
    def tilt(self) -> tuple[float, float]:
        north, east = (
            -float(self._state[3]),
            float(self._state[4]),
        )  # accelerations in g: x'' = g θ, y'' = -g φ
        forward = north * math.cos(self.yaw) + east * math.sin(self.yaw)
        right = east * math.cos(self.yaw) - north * math.sin(self.yaw)
        return math.atan(right), -math.atan(forward)

    def turn(self, yaw: float | None, rate: float | None, seconds: float) -> None:
        if yaw is not None:
            gap = math.remainder(yaw - self.yaw, 2 * math.pi)
            rate = max(-TURN_RATE, min(TURN_RATE, gap / seconds))
        self.yaw_rate = 0.0 if rate is None or self.on_ground else rate
        self.yaw = math.remainder(self.yaw + self.yaw_rate * seconds, 2 * math.pi)

    def _set_speed(self, speed: float) -> None:
        self._model = Quadrotor(QuadrotorConfig(speed_m_s=speed, acceleration_m_s2=self._acceleration))

    def advance(self, steps: int) -> None:
        if self.cut:
            self._drop(steps * STEP)
            return
        wants_up = self._waypoint[2] > 0.05 if self._driven is None else self._driven[2] > 0.0
        if self.on_ground and not wants_up:
            return
        self.on_ground = False
        super().advance(steps)
        rising = self._state[8] >= 0.0 or wants_up
        if self._state[2] <= 0.0 and not rising:
            self._touch_down()

    def _drop(self, seconds: float) -> None:
        if not self.on_ground:
            self._state[2] -= FALL * seconds
            if self._state[2] <= 0.0:
                self._touch_down()

    def _touch_down(self) -> None:
        self.on_ground = True
        self._state = self._model.initial_state(np.array([*self._state[:2], 0.0, 0.0]))
        self._order, self._driven = (), np.zeros(3)


class Rover(Body):
    """The unicycle of the planner."""

    flies = False

    def __init__(self, yaw: float, acceleration: float) -> None:
        super().__init__(yaw)
        self._acceleration = acceleration
        self._model: Unicycle = self._made(2.0)
        self._state = self._model.initial_state(np.array([0.0, 0.0, 0.0, math.pi / 2 - yaw]))

    @property
    def tilt(self) -> tuple[float, float]:
        return 0.0, 0.0

    def turn(self, yaw: float | None, rate: float | None, seconds: float) -> None:
        """It turns as it drives."""

    def _set_speed(self, speed: float) -> None:
        self._model = self._made(speed)

    def _made(self, speed: float) -> Unicycle:
        return Unicycle(UnicycleConfig(speed_m_s=speed, acceleration_m_s2=self._acceleration))

    def advance(self, steps: int) -> None:
        if self.cut:
            self._state[4:6] = 0.0
            return
        super().advance(steps)
        self.yaw = math.remainder(math.pi / 2 - float(self._state[3]), 2 * math.pi)
        self.yaw_rate = -float(self._state[5])


def warm() -> None:
    """Load the models' kernels, which takes a second, before a clock runs."""
    for body in (Copter(0.0, 2.5), Rover(0.0, 1.0)):
        body.goto((1.0, 0.0, -1.0), Limits(1.0, 1.0, 1.0))
        body.advance(1)
