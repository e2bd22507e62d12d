"""What the ground has to say to a robot that is turned aside: no wall, keep-out zone or fence in its way."""

import math

import numpy as np

from estimator.arrays import FloatArray
from planner.avoidance.halt import halted, settling
from planner.plan import Ground

ARC = 12  # corners that stand for the circle of a vehicle that cannot stop
AGAIN_S = 1.0  # a way around is looked for at most this often


class Footing:
    """Mutable: remembers the way around, back to the waypoint."""

    def __init__(self, ground: Ground | None, *, level: bool) -> None:
        """`ground` None: everything is open; `level`: its places have no altitude (2D)."""
        self._ground = ground
        self._dimension = 2 if level else 3
        self._around: list[FloatArray] = []
        self._for = np.zeros(3)
        self._look_at = -math.inf

    @property
    def open(self) -> bool:
        """Whether there is nothing to ask."""
        return self._ground is None

    def holds(self, here: FloatArray, motion: FloatArray) -> bool:
        """Whether the way from `here` (3,) to a motion (COLUMNS,) after a tick, and its halt, are clear."""
        if self._ground is None:
            return True
        duration = settling(motion)
        corners = ARC if motion[12] > 0 else 1
        places = np.empty((corners + 2, 3))
        places[0], places[1] = here, motion[:3]
        for k in range(corners):
            halted(motion, duration * (k + 1) / corners, places[k + 2])
        return self.along(places)

    def along(self, places: FloatArray) -> bool:
        """Whether the way through places (k, 3) is clear. From one that is not, one may go to any that is."""
        if self._ground is None:
            return True
        points = places.T[: self._dimension].copy()
        if not self._ground.clear(points[:, :1])[0]:
            return bool(self._ground.clear(points[:, -1:])[0])
        return bool(self._ground.segments_clear(points[:, :-1].copy(), points[:, 1:].copy()).all())

    def toward(self, now: float, here: FloatArray, waypoint: FloatArray, diverted: bool) -> FloatArray:
        """Where to head for from `here` (3,): the waypoint (3,) itself, or a corner around what is between.

        A robot that is not `diverted` is where its plan led it, and goes on with that.
        """
        if self._ground is None or not diverted:
            self._around = []
            return waypoint
        if self._sees(here, waypoint):
            self._around = []
            return waypoint
        while len(self._around) > 1 and self._sees(here, self._around[1]):
            self._around.pop(0)
        known = self._around and (self._for == waypoint).all() and self._sees(here, self._around[0])
        if not known and now >= self._look_at:
            self._look_at, self._for = now + AGAIN_S, waypoint.copy()
            found = self._ground.path(here[: self._dimension].copy(), waypoint[: self._dimension].copy())
            self._around = [] if found is None else [self._lifted(p, waypoint) for p in found.T[1:]]
        return self._around[0] if self._around else waypoint

    def _sees(self, here: FloatArray, there: FloatArray) -> bool:
        assert self._ground is not None
        d = self._dimension
        return bool(self._ground.segments_clear(here[:d, None].copy(), there[:d, None].copy())[0])

    def _lifted(self, place: FloatArray, waypoint: FloatArray) -> FloatArray:
        out = np.array(waypoint)
        out[: self._dimension] = place
        return out
