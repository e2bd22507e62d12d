"""What a vehicle does when it gives up its way: it brakes, or circles to the left if it cannot stop.

Where it will be then is known in closed form from its position and velocity alone, so that others, who hear
just these, can reckon with it.
"""

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from estimator.arrays import FloatArray
from estimator.kernels import exact_kernel

# Of a motion: position, velocity, velocity steered for (3 each); deceleration, approach, lag, turn rate.
COLUMNS = 13


@dataclass(frozen=True, slots=True)
class Evasion:
    """A vehicle's limits as others must know them to keep clear of it."""

    speed: float  # m/s, at most
    acceleration: float  # m/s^2, at most
    approach: float = 2.0  # 1/s: how the last metres are braked, exponentially
    lag: float = 0.0  # s with which its velocity follows the one steered for, exponentially
    turn_rate: float = 0.0  # rad/s; above 0 it cannot stop and circles to the left
    climb: float = 0.0  # m/s of a vehicle that circles

    def motion(self, position: FloatArray, velocity: FloatArray, aim: FloatArray) -> FloatArray:
        """The row (COLUMNS,) for the kernels, of a vehicle that now steers for a velocity `aim` (3,)."""
        row = np.empty(COLUMNS)
        row[0:3], row[3:6], row[6:9] = position, velocity, aim
        row[9:] = self.acceleration, self.approach, self.lag, self.turn_rate
        return row

    def reach(self, speed: float, seconds: float) -> float:
        """Metres from here of whatever it can come to in so many seconds and then halting."""
        if self.turn_rate > 0:
            return speed * seconds + 2.0 * speed / self.turn_rate
        fast = min(self.speed, speed + self.acceleration * seconds)
        return fast * (seconds + self.lag) + stopping(fast, self.acceleration, self.approach)

    @property
    def margin(self) -> float:
        """Metres by which its motion may differ from what is reckoned here: a lag itself begins slowly."""
        return 0.5 * self.acceleration * self.lag**2

    def uncertainty(self, speed: float, age: float) -> float:
        """Metres by which it may be elsewhere than where braking or going on would have brought it."""
        return min(0.5 * self.acceleration * age * age, self.speed * age) + SWERVE * speed * age

    def settling(self, speed: float) -> float:
        """Seconds after which its halt is over; of a circle, one turn."""
        if self.turn_rate > 0:
            return 2.0 * math.pi / self.turn_rate
        return 2.0 * stopping(speed, self.acceleration, self.approach) / max(speed, 0.1)


SWERVE = 0.2  # share of its way since its last pose by which a vehicle may have turned off


@runtime_checkable
class Evader(Protocol):
    """A vehicle model that can get out of the way."""

    @property
    def evasion(self) -> Evasion:
        """Its limits."""

    def aim(self, state: FloatArray) -> FloatArray:
        """The velocity (3,) that it steers for at this moment; for most vehicles the one it has."""

    def steer(self, state: FloatArray, velocity: FloatArray) -> FloatArray:
        """The waypoint (3,) for which it moves at a velocity (3,) now, and brakes later."""


@exact_kernel
def stopping(speed: float, acceleration: float, approach: float) -> float:
    """Metres to a stop at `acceleration`, and exponentially at rate `approach` in the end."""
    if speed * approach <= acceleration:
        return speed / approach
    return speed * speed / (2.0 * acceleration) + acceleration / (2.0 * approach * approach)


@exact_kernel
def halted(row: FloatArray, t: float, out: FloatArray) -> None:
    """Where (3,) a vehicle with motion `row` is `t` seconds after it began to halt.

    Its aim c falls evenly to 0 over the stopping distance, and its velocity v follows by v' = (c - v) / lag,
    of which the solution is written out; then p(t) = p + lag (v(0) - v(t)) + the integral of c.
    """
    if row[12] > 0.0:
        radius, a = 1.0 / row[12], row[12] * t
        c, s = math.cos(a), math.sin(a)
        # About the centre to the left, by a radians: v sin / ω along, v (1 - cos) / ω to the left.
        out[0] = row[0] + radius * (row[6] * s - row[7] * (1.0 - c))
        out[1] = row[1] + radius * (row[7] * s + row[6] * (1.0 - c))
        out[2] = row[2]
        return
    lag = row[11]
    speed = math.sqrt(row[6] * row[6] + row[7] * row[7] + row[8] * row[8])
    fade = math.exp(-t / lag) if lag > 0.0 else 0.0
    if speed < 1e-9:
        for axis in range(3):
            out[axis] = row[axis] + lag * row[3 + axis] * (1.0 - fade)
        return
    way = stopping(speed, row[9], row[10])
    duration = 2.0 * way / speed
    slowing = speed / duration
    braked = min(t, duration)
    along = speed * braked - 0.5 * slowing * braked * braked
    kept = math.exp(-braked / lag) if lag > 0.0 else 0.0
    after = math.exp(-(t - braked) / lag) if lag > 0.0 else 0.0
    for axis in range(3):
        unit = row[6 + axis] / speed
        behind = row[3 + axis] - row[6 + axis] - slowing * lag * unit
        velocity = (unit * (speed - slowing * braked + slowing * lag) + behind * kept) * after
        out[axis] = row[axis] + lag * (row[3 + axis] - velocity) + unit * along


@exact_kernel
def ahead(row: FloatArray, seconds: float) -> FloatArray:
    """The motion of a vehicle that has steered on for the same velocity for so long."""
    on = row.copy()
    fade = math.exp(-seconds / row[11]) if row[11] > 0.0 else 0.0
    for axis in range(3):
        behind = row[3 + axis] - row[6 + axis]
        on[axis] += row[6 + axis] * seconds + row[11] * behind * (1.0 - fade)
        on[3 + axis] = row[6 + axis] + behind * fade
    return on
