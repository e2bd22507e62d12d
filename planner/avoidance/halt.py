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
SETTLED = 3.0  # of the last, exponential part's time constants, after which it is taken to be over
EVEN = 0.01  # share of its speed by which a steady vehicle may be off
CONTROL_S = 0.02  # vehicles do what is asked of them with this delay


@dataclass(frozen=True, slots=True)
class Evasion:
    """A vehicle's limits as others must know them to keep clear of it."""

    speed: float  # m/s, at most
    acceleration: float  # m/s^2, with which it brakes
    approach: float = 2.0  # 1/s: how the last metres are braked, exponentially
    lag: float = 0.0  # s with which its velocity follows the one steered for, exponentially
    turn_rate: float = 0.0  # rad/s; above 0 it cannot stop and circles to the left
    climb: float = 0.0  # m/s up or down of a vehicle that circles, at once
    swerving: float = 0.0  # m/s^2 by which it changes its velocity in any direction; 0: as it brakes

    @property
    def agility(self) -> float:
        """m/s^2 by which it may change its velocity, in any direction."""
        return self.swerving or self.acceleration

    @property
    def margin(self) -> float:
        """Metres by which its motion may differ from what is reckoned here: a lag itself begins slowly."""
        return 0.5 * self.acceleration * self.lag**2 + CONTROL_S * self.speed

    def motion(self, position: FloatArray, velocity: FloatArray, aim: FloatArray) -> FloatArray:
        """The row (COLUMNS,) for the kernels, of a vehicle that now steers for a velocity `aim` (3,)."""
        row = np.empty(COLUMNS)
        row[0:3], row[3:6], row[6:9] = position, velocity, aim
        row[9:] = self.acceleration, self.approach, self.lag, self.turn_rate
        return row


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

    The velocity c that it steers for falls at the deceleration a until a / k, and exponentially at rate k
    then; its own velocity v follows by v' = (c - v) / lag, of which the solutions are written out. Then
    p(t) = p + lag (v(0) - v(t)) + the integral of c.
    """
    if row[12] > 0.0:
        radius, a = 1.0 / row[12], row[12] * t
        c, s = math.cos(a), math.sin(a)
        # About the centre to the left, by a radians: v sin / ω along, v (1 - cos) / ω to the left.
        out[0] = row[0] + radius * (row[6] * s - row[7] * (1.0 - c))
        out[1] = row[1] + radius * (row[7] * s + row[6] * (1.0 - c))
        out[2] = row[2]
        return
    deceleration, rate, lag = row[9], row[10], row[11]
    speed = math.sqrt(row[6] * row[6] + row[7] * row[7] + row[8] * row[8])
    slow = min(speed, deceleration / rate)
    braked = min(t, (speed - slow) / deceleration)
    faded = t - braked
    fade = math.exp(-rate * faded)
    along = speed * braked - 0.5 * deceleration * braked * braked + slow / rate * (1.0 - fade)
    if lag > 0.0:
        kept, after = math.exp(-braked / lag), math.exp(-faded / lag)
        follows = 1.0 - rate * lag
        follows = follows if abs(follows) > 1e-6 else 1e-6
    else:
        kept, after, follows = 0.0, 0.0, 1.0
    for axis in range(3):
        unit = row[6 + axis] / speed if speed > 1e-9 else 0.0
        late = deceleration * lag * unit if braked > 0.0 else 0.0  # steadily braking, v is above c by this
        velocity = unit * (speed - deceleration * braked) + late
        velocity += (row[3 + axis] - row[6 + axis] - late) * kept
        if faded > 0.0:
            ahead = unit * slow / follows
            velocity = ahead * fade + (velocity - ahead) * after
        out[axis] = row[axis] + lag * (row[3 + axis] - velocity) + unit * along


@exact_kernel
def going_on(row: FloatArray, seconds: float) -> FloatArray:
    """The motion of a vehicle that has steered on for the same velocity for so long."""
    on = row.copy()
    fade = math.exp(-seconds / row[11]) if row[11] > 0.0 else 0.0
    for axis in range(3):
        behind = row[3 + axis] - row[6 + axis]
        on[axis] += row[6 + axis] * seconds + row[11] * behind * (1.0 - fade)
        on[3 + axis] = row[6 + axis] + behind * fade
    return on


@exact_kernel
def settling(row: FloatArray) -> float:
    """Seconds after which the halt of a motion (COLUMNS,) is over; of a circle, one turn."""
    if row[12] > 0.0:
        return float(2.0 * math.pi / row[12])
    speed = math.sqrt(row[6] * row[6] + row[7] * row[7] + row[8] * row[8])
    braking = max(speed - row[9] / row[10], 0.0) / row[9]
    return float(braking + SETTLED / row[10] + 3.0 * row[11])


@exact_kernel
def steady(row: FloatArray, waypoint: FloatArray, speed: float, seconds: float) -> bool:
    """Whether a vehicle goes straight for a waypoint (3,) at its full speed, and will for so long."""
    gap2, v2, off2, aim2, along = 0.0, 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        gap = waypoint[axis] - row[axis]
        gap2 += gap * gap
        v2 += row[3 + axis] ** 2
        aim2 += row[6 + axis] ** 2
        off2 += (row[6 + axis] - row[3 + axis]) ** 2
        along += gap * row[6 + axis]
    v, gap, aim = math.sqrt(v2), math.sqrt(gap2), math.sqrt(aim2)
    if v < (1.0 - EVEN) * speed or aim < (1.0 - EVEN) * speed or math.sqrt(off2) > EVEN * speed:
        return False
    straight = along > gap * aim * (1.0 - EVEN * EVEN)
    return straight and gap > speed * seconds + stopping(speed, row[9], row[10])
