"""What moving costs: a linear model of the energy that a vehicle takes out of its battery.

E = rest_w T + metre_j S + climb_j_m H, with T the seconds, S the metres travelled, H those of them climbed.
`rest_w` is all that runs whether it moves or not: of a drone its hover, of which moving slowly takes no more;
`metre_j` is what friction and drag take per metre; `climb_j_m` is weight over efficiency. Sinking gives
nothing back. Being linear it adds up over the parts of a way, whatever they are.

Defaults are of the vehicles that the models stand for, in round numbers: a Parrot Mambo empties 2.4 Wh in 8
minutes of hovering, a TurtleBot3 20 Wh in 2.5 hours; a multirotor of 1 kg takes some 150 W to hover; an
aircraft of 1.5 kg, with a lift of 8 times the drag and half of the power lost, 3.7 J per metre.
"""

from typing import Protocol, runtime_checkable

import msgspec
import numpy as np

from estimator.arrays import FloatArray, NonNegative

WH = 3600.0  # joules


class Power(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a mission may say of a vehicle's consumption."""

    rest_w: NonNegative  # W, moving or not
    metre_j: NonNegative  # J, more for each metre
    climb_j_m: NonNegative  # J, more for each metre climbed

    def joules(self, seconds: float, metres: float, climbed: float) -> float:
        """What so many seconds, metres and metres of climbing take."""
        return self.rest_w * seconds + self.metre_j * metres + self.climb_j_m * climbed

    def along(self, times: FloatArray, places: FloatArray) -> float:
        """J of a way through places (k, 3 or more columns: x, y, z) at times (k,)."""
        steps = np.diff(places[:, :3], axis=0)
        climbed = float(np.maximum(steps[:, 2], 0.0).sum())
        return self.joules(float(times[-1] - times[0]), float(np.linalg.norm(steps, axis=1).sum()), climbed)


@runtime_checkable
class Powered(Protocol):
    """A vehicle model that knows what it consumes."""

    @property
    def power(self) -> Power:
        """Its consumption."""
