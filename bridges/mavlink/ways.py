"""Ways as missions on board: put there, begun, and seen to their end."""

from typing import ClassVar

import numpy as np

from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.frames import LocalFrame, Place
from bridges.mavlink.mission_items import PlanKind, waypoint
from bridges.mavlink.mission_protocol import Upload
from bridges.mavlink.wanted import Way
from estimator.arrays import FloatArray

AGAIN = 3.0  # s before an upload that failed is tried again


def way_of(route: FloatArray, local: LocalFrame, home: Place, within: float = 1.0) -> Way:
    """A way along `route` (r, 3) of the team's frame (`Trajectory.route`), of a vehicle with this home.

    The vehicle passes each corner within `within` m.
    """
    items = []
    for corner in route:
        latitude, longitude, altitude = local.team.to_degrees(corner)
        items.append(waypoint(latitude, longitude, altitude - home[2], within=within))
    return Way(np.array([local.to_ned(corner) for corner in route]), tuple(items))


class Ways:
    """An errand that never ends: uploads the way that is wanted, and hears how far it has been flown."""

    done: ClassVar[bool] = False

    def __init__(self, vehicle: tuple[int, int], us: tuple[int, int], home_first: bool) -> None:
        self._vehicle = vehicle
        self._us = us
        self._home_first = home_first
        self._wanted: Way | None = None
        self._upload: Upload | None = None
        self._not_before = 0.0
        self._begin = False
        self.on_board: Way | None = None
        self._next = 0  # item of what is on board that was not reached yet
        self.trouble = ""  # why what is wanted is not on board

    def __repr__(self) -> str:
        return f"Ways(on_board={self.on_board is not None}, ended={self.ended}, {self.trouble!r})"

    @property
    def ended(self) -> bool:
        """Whether the last item of what is on board was reached."""
        return self.on_board is not None and self._next >= len(self.on_board.items)

    def want(self, way: Way) -> None:
        """Put this on board, if it is not there."""
        if way is not self._wanted:
            self._wanted, self._upload, self._not_before = way, None, 0.0

    def begin(self) -> None:
        """What is on board is flown, from where it was left if it was begun before."""
        self._begin = True

    def step(self, now: float, received: list[Message]) -> list[Message]:
        """Upload, and listen."""
        for message in received:
            if message.get_type() == "MISSION_ITEM_REACHED" and self.on_board is not None:
                self._next = max(self._next, message.seq + 1 - self._home_first)
        out: list[Message] = []
        if self._begin:
            self._begin = False
            number = self._next + self._home_first
            out.append(mavlink.MAVLink_mission_set_current_message(*self._vehicle, number))
        if self._wanted is None or self._wanted is self.on_board or now < self._not_before:
            return out
        if self._upload is None:
            self.on_board = None
            items = self._wanted.items
            self._upload = Upload(items, PlanKind.MISSION, self._vehicle, self._us, self._home_first)
        out += self._upload.step(now, received)
        if self._upload.done:
            self.trouble = self._upload.trouble
            if self.trouble:
                self._not_before = now + AGAIN
            else:
                self.on_board, self._next = self._wanted, 0
            self._upload = None
        return out
