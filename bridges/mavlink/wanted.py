"""What the robot wants of its vehicle. Declarative: how to get there from here is the pilot's business.

Positions and velocities are local NED: metres from the origin of the vehicle's estimator, z down.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from estimator.arrays import FloatArray

if TYPE_CHECKING:
    from bridges.mavlink.mission_items import Item


@dataclass(frozen=True, slots=True)
class Rest:
    """Nothing: a vehicle on the ground stays disarmed, one in the air holds."""


@dataclass(frozen=True, slots=True)
class Hold:
    """Stay where it is, under our control; on the ground the same as Rest."""


@dataclass(frozen=True, slots=True)
class GoTo:
    """Be at a position (3,), arming and taking off first where it stands on the ground."""

    position: FloatArray
    yaw: float | None = None  # rad from north, clockwise; None: as the autopilot likes


@dataclass(frozen=True, slots=True)
class Drive:
    """Move with a velocity (3,), m/s; likewise armed and taken off first."""

    velocity: FloatArray
    yaw: float | None = None


@dataclass(frozen=True, slots=True)
class TakeOff:
    """Hover above where it stands at the pilot's take-off height; a rover is only armed."""


@dataclass(frozen=True, slots=True)
class Land:
    """Come down here and disarm."""


@dataclass(frozen=True, slots=True)
class Return:
    """Go home and come down, as the autopilot does that."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """Fly a way by itself, as a mission on board, and hold at its end: for links too slow for setpoints."""

    route: FloatArray  # (k, 3) corners, for the fence
    items: "tuple[Item, ...]"  # the same as a mission


Task = Rest | Hold | GoTo | Drive | TakeOff | Land | Return | Way


@dataclass(frozen=True, slots=True)
class Wanted:
    """A task, and what the robot knows of its team while it wants it."""

    task: Task = Rest()
    team_age: float = 0.0  # s since anything was heard of the team


Permit = Callable[[FloatArray], str | None]
"""Why a position (3,) of local NED may not be flown to (fence, heights); None: it may."""
