"""The mission's fence: where a vehicle may be sent, and where it is out of bounds, in the team's frame.

It may be sent into the mission's area with a margin, out of obstacles and keep-out zones, inside the
geofence, and between two altitudes. A vehicle that is beyond all that by the margin once more has broken out.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FloatArray
from planner.ground.grid_ground import GridGround
from planner.plan import Ground

AROUND = 0.25 * np.pi * np.arange(8)


@dataclass(frozen=True, slots=True)
class Fence:
    """Metres of the team's frame."""

    low: FloatArray  # (2,) of the area
    high: FloatArray
    altitude: tuple[float, float]
    margin: float
    ground: Ground | None = None

    def forbids(self, place: FloatArray) -> str | None:
        """Why nothing may be sent to a place (3,); None: it may."""
        z, (floor, ceiling) = float(place[2]), self.altitude
        if not floor <= z <= ceiling:
            return f"{z:.1f} m is not between the altitudes {floor:g} and {ceiling:g} m"
        return self._beyond(place, self.margin) or self._blocked(place[:, None])

    def left(self, place: FloatArray) -> str | None:
        """Why a vehicle at a place (3,) has broken out; None: it has not, or by no more than the margin."""
        z, ceiling = float(place[2]), self.altitude[1]
        if z > ceiling + self.margin:
            return f"it is {z:.1f} m high, above the highest altitude of {ceiling:g} m"
        ring = np.stack([np.cos(AROUND), np.sin(AROUND), np.zeros(8)]) * self.margin
        # On the ground it is below the lowest layer, which is no breach.
        lifted = np.array([place[0], place[1], np.clip(z, *self.altitude)])
        return self._beyond(place, 2 * self.margin) or self._blocked(
            np.column_stack([lifted, lifted[:, None] + ring])
        )

    def _beyond(self, place: FloatArray, margin: float) -> str | None:
        x, y = float(place[0]), float(place[1])
        low, high = self.low, self.high
        if low[0] - margin <= x <= high[0] + margin and low[1] - margin <= y <= high[1] + margin:
            return None
        return (
            f"({x:.1f}, {y:.1f}) is more than {margin:g} m outside of the mission's area, which reaches from "
            f"({low[0]:g}, {low[1]:g}) to ({high[0]:g}, {high[1]:g})"
        )

    def _blocked(self, places: FloatArray) -> str | None:
        """Why none of places (3, n) may be entered."""
        ground = self.ground
        if ground is None:
            return None
        blocked: Callable[[FloatArray], BoolArray] = (
            ground.solid if isinstance(ground, GridGround) else lambda points: ~ground.clear(points)
        )
        if not blocked(np.ascontiguousarray(places)).all():
            return None
        x, y = places[:2, 0]
        return f"({x:.1f}, {y:.1f}) is in an obstacle or a keep-out zone, or outside of the geofence"
