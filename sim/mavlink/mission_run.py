"""A mission that is flown: its items one after another."""

import math
from typing import TYPE_CHECKING

from sim.mavlink.plans import MISSION, Item
from sim.mavlink.telemetry import mission_current

if TYPE_CHECKING:
    from sim.mavlink.autopilot import Autopilot

WAYPOINT, LOITER_UNLIM, LOITER_TIME, RETURN, LAND, TAKEOFF = 16, 17, 19, 20, 21, 22
DELAY, JUMP, CHANGE_SPEED = 93, 177, 178
COMMANDS = {WAYPOINT, LOITER_UNLIM, 18, LOITER_TIME, RETURN, LAND, TAKEOFF, 82, DELAY, 112, 115, JUMP,
            CHANGE_SPEED, 179, 181, 183, 189, 195, 196, 197, 201, 203, 205, 206, 530, 2000, 2001}  # fmt: skip


class MissionRun:
    """Where a vehicle is in its mission."""

    def __init__(self, vehicle: "Autopilot") -> None:
        self._vehicle = vehicle
        self.index = 0
        self.running = False
        self._begun = False
        self._waited = 0.0
        self._jumps: dict[int, int] = {}

    def __repr__(self) -> str:
        return f"MissionRun(item {self.index} of {len(self.items)}, running={self.running})"

    @property
    def items(self) -> list[Item]:
        return self._vehicle.plans.items[MISSION]

    def wire_index(self) -> int:
        """As MISSION_CURRENT counts: with home as item 0 where the autopilot has it there."""
        return min(self.index, max(len(self.items) - 1, 0)) + self._vehicle.home_is_item_0

    def state(self) -> int:
        """MISSION_STATE: none, not started, active, paused, complete."""
        if not self.items:
            return 1
        if self.running:
            return 3
        return 5 if self.index >= len(self.items) else 2 if self.index == 0 else 4

    def start(self, index: int | None = None) -> None:
        """From an item, or from where it was; anew if it was at the end."""
        if index is not None or self.index >= len(self.items):
            self.index = index or 0
            self._jumps = {}
        self.running, self._begun, self._waited = True, False, 0.0

    def stop(self) -> None:
        self.running = False

    def tick(self, seconds: float) -> bool:
        """Fly on; True: the last item is done."""
        for _ in range(len(self.items) + 1):  # a jump may lead round in a ring
            if not self.running or self.index >= len(self.items):
                break
            item = self.items[self.index]
            if not self._begun:
                self._begun, self._waited = True, 0.0
                self._begin(item)
            if not self._done(item, seconds):
                return False
            self._vehicle.reached_item(self.wire_index())
            self._next(item)
            self._vehicle.send(mission_current(self._vehicle))
            seconds = 0.0
        if not self.running or self.index < len(self.items):
            return False
        self.running = False
        return True

    def _begin(self, item: Item) -> None:
        vehicle = self._vehicle
        if item.command in (WAYPOINT, LOITER_TIME, LOITER_UNLIM, 18, 82):
            yaw = item.params[3]
            fixed = item.command == WAYPOINT and vehicle.mission_yaws and math.isfinite(yaw)
            vehicle.guidance.goto(vehicle.item_target(item), math.radians(yaw) if fixed else None)
        elif item.command == TAKEOFF:
            vehicle.guidance.take_off(vehicle.item_target(item)[2])
        elif item.command == LAND:
            vehicle.guidance.land()
        elif item.command == RETURN:
            vehicle.begin_return()
        elif item.command == CHANGE_SPEED and item.params[1] > 0:
            vehicle.change_speed(item.params[1])
        elif item.command == DELAY:
            vehicle.guidance.hold()

    def _done(self, item: Item, seconds: float) -> bool:
        guidance = self._vehicle.guidance
        if item.command in (WAYPOINT, LOITER_TIME, 82, DELAY):
            if item.command != DELAY and not guidance.near_target():
                return False
            self._waited += seconds
            return self._waited >= max(item.params[0], 0.0)
        if item.command in (LOITER_UNLIM, 18):
            return False
        if item.command == TAKEOFF:
            return guidance.near_target()
        if item.command in (LAND, RETURN):
            return not self._vehicle.armed
        return True

    def _next(self, item: Item) -> None:
        self._begun = False
        if item.command == JUMP:
            done = self._jumps.get(self.index, 0)
            to = int(item.params[0]) - self._vehicle.home_is_item_0
            if (item.params[1] < 0 or done < item.params[1]) and 0 <= to < len(self.items):
                self._jumps[self.index] = done + 1
                self.index = to
                return
        self.index += 1
