"""What missions and fences are made of, and how an autopilot's answers to them read in words."""

import math
from dataclasses import dataclass
from enum import IntEnum

from bridges.mavlink.dialect import Message, mavlink

GLOBAL_FRAMES = frozenset({0, 2, 3, 5, 6, 10, 11})  # x and y are 1e-7 degrees on the wire; else 1e-4 metres
WAYPOINT = int(mavlink.MAV_CMD_NAV_WAYPOINT)
RELATIVE = int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)
ABSOLUTE = int(mavlink.MAV_FRAME_GLOBAL)
NAN = math.nan

RESULTS = {
    mavlink.MAV_MISSION_ERROR: "refused without a reason",
    mavlink.MAV_MISSION_UNSUPPORTED_FRAME: "a coordinate frame is not supported",
    mavlink.MAV_MISSION_UNSUPPORTED: "a command in it, or all of its kind, is unknown to this autopilot",
    mavlink.MAV_MISSION_NO_SPACE: "it has more items than fit on board",
    mavlink.MAV_MISSION_INVALID: "an item is invalid",
    **{
        getattr(mavlink, f"MAV_MISSION_INVALID_PARAM{number}"): f"parameter {number} of an item is invalid"
        for number in (1, 2, 3, 4, 7)
    },
    mavlink.MAV_MISSION_INVALID_PARAM5_X: "the latitude of an item is invalid",
    mavlink.MAV_MISSION_INVALID_PARAM6_Y: "the longitude of an item is invalid",
    mavlink.MAV_MISSION_INVALID_SEQUENCE: "the items came out of order",
    mavlink.MAV_MISSION_DENIED: "denied; perhaps another station uploads at this time",
    mavlink.MAV_MISSION_OPERATION_CANCELLED: "the autopilot gave up on it",
}


class PlanKind(IntEnum):
    """What can be on board."""

    MISSION = 0
    FENCE = 1
    RALLY = 2

    @property
    def word(self) -> str:
        """For people."""
        return ("mission", "fence", "rally points")[self]


@dataclass(frozen=True, slots=True)
class Item:
    """One item. Places are latitude and longitude in degrees (in a local frame metres), `z` in metres."""

    command: int
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    frame: int = RELATIVE
    autocontinue: int = 1

    def message(self, target: tuple[int, int], number: int, kind: PlanKind, current: bool = False) -> Message:
        """On the wire, as item `number`."""
        scale = 1e7 if self.frame in GLOBAL_FRAMES else 1e4
        return mavlink.MAVLink_mission_item_int_message(
            *target,
            number,
            self.frame,
            self.command,
            int(current),
            self.autocontinue,
            *self.params,
            round(self.x * scale),
            round(self.y * scale),
            self.z,
            int(kind),
        )

    @staticmethod
    def of(message: Message) -> "Item":
        """From a MISSION_ITEM_INT."""
        scale = 1e-7 if message.frame in GLOBAL_FRAMES else 1e-4
        params = (message.param1, message.param2, message.param3, message.param4)
        return Item(
            message.command,
            message.x * scale,
            message.y * scale,
            message.z,
            params,
            message.frame,
            message.autocontinue,
        )

    @property
    def words(self) -> str:
        """For people: `waypoint 47.3977420, 8.5455940, 20 m above home`."""
        entry = mavlink.enums["MAV_CMD"].get(self.command)
        name = entry.name if entry else f"command {self.command}"
        for prefix in ("MAV_CMD_NAV_", "MAV_CMD_"):
            name = name.removeprefix(prefix)
        name = name.lower().replace("_", " ")
        fence = self.command >= mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT
        placed = fence or self.command < mavlink.MAV_CMD_NAV_LAST
        if not placed or self.frame == mavlink.MAV_FRAME_MISSION:
            return name
        above = "above home" if self.frame in (RELATIVE, 6) else "above sea level"
        height = "" if fence else f", {self.z:g} m {above}"
        radius = f", radius {self.params[0]:g} m" if "circle" in name else ""
        return f"{name} {self.x:.7f}, {self.y:.7f}{height}{radius}"


def waypoint(
    latitude: float, longitude: float, height: float, hold: float = 0.0, within: float = 1.0
) -> Item:
    """Fly through a place (degrees, metres above home) as near as `within` m, and stay `hold` s."""
    return Item(WAYPOINT, latitude, longitude, height, (hold, within, 0.0, NAN))
