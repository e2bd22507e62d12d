"""What the particle filter knows, and how its particles move."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.filter import Area
from estimator.motion import Motion
from estimator.undetected import Undetected


@dataclass(frozen=True, slots=True, eq=False)
class SmcPhdState:
    """The intensity after some time and some measurement sets."""

    states: FloatArray  # (n_x, n) of the particles: positions, then velocities where targets have one
    weights: FloatArray  # (n,) expected targets each
    labels: IntArray  # (n,) cluster of the last `clusters` call, -1 for none
    undetected: Undetected  # 0 everywhere if particles were everywhere from the start
    centres: FloatArray  # (d, c) of the last `clusters` call
    reach: float  # metres, how far a measurement's target may be from where it points; 0 before the first
    unborn: float = 0.0  # expected targets born since the last set that are yet in neither part
    places: FloatArray | None = None  # (d, f) where the prior's particles lay, if they were everywhere
    spacing: float = 0.0  # metres between those

    @property
    def positions(self) -> FloatArray:
        """(d, n) of the particles."""
        return self.states[: self.centres.shape[0]]


def moved(
    states: FloatArray, motion: Motion, duration: float, area: Area, rng: np.random.Generator
) -> FloatArray:
    """States (n_x, n) `duration` seconds later; targets turn back at the area's border and at walls."""
    later = motion.moved(states, duration, rng)
    if later is states:
        return states
    d = area.dimension
    turned_back(later, area)
    if area.map is not None:
        blocked = np.flatnonzero(~area.is_free(later[:d]))
        later[:d, blocked] = states[:d, blocked]
        later[d:, blocked] *= -1.0
    return later


def turned_back(states: FloatArray, area: Area) -> FloatArray:
    """States (n_x, n) whose positions left the area, mirrored at its border, with their velocities; in place.

    The area is where targets may be: what would leave it comes back instead, as the undetected part's
    targets do, so that mass is kept and a uniform intensity stays uniform.
    """
    d = area.dimension
    for axis in range(d):
        low, high = area.low[axis], area.high[axis]
        outside = np.flatnonzero((states[axis] < low) | (states[axis] > high))
        if outside.size == 0:
            continue
        length = high - low
        way = np.mod(states[axis, outside] - low, 2.0 * length)
        back = way > length
        states[axis, outside] = low + np.where(back, 2.0 * length - way, way)
        if states.shape[0] > d:
            states[d + axis, outside[back]] *= -1.0
    return states


def with_velocities(positions: FloatArray, motion: Motion, rng: np.random.Generator) -> FloatArray:
    """States (n_x, n) of new targets at positions (d, n): of no known velocity, if they have one at all."""
    d = motion.dimension
    if motion.state_size == d:
        return positions
    velocities = motion.config.speed * rng.standard_normal((d, positions.shape[1]))
    return np.concatenate([positions, velocities])
