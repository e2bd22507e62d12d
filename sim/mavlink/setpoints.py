"""What a SET_POSITION_TARGET_* message asks for, in local NED, with NaN where it asks for nothing."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bridges.mavlink.dialect import Message

if TYPE_CHECKING:
    from sim.mavlink.autopilot import Autopilot

NAN = math.nan
LOCAL_NED, LOCAL_OFFSET, BODY_NED, BODY_OFFSET = 1, 7, 8, 9
POSITION, VELOCITY, ACCELERATION, YAW, RATE, FORCE = 0x7, 0x38, 0x1C0, 0x400, 0x800, 0x200
GLOBAL_RELATIVE = {3, 6, 10, 11}
GLOBAL = {0, 5} | GLOBAL_RELATIVE


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Position, velocity (3 each), yaw, yaw rate."""

    position: tuple[float, float, float]
    velocity: tuple[float, float, float]
    yaw: float
    yaw_rate: float
    mask: int
    frame: int

    @staticmethod
    def of(message: Message, vehicle: "Autopilot") -> "Setpoint | None":
        """In local NED, whatever the frame; None for a frame that is none of a setpoint's."""
        mask, frame, body = message.type_mask, message.coordinate_frame, vehicle.body
        velocity = (message.vx, message.vy, message.vz)
        yaw = message.yaw
        if message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT":
            if frame not in GLOBAL:
                return None
            base = (vehicle.home or vehicle.origin)[2] if frame in GLOBAL_RELATIVE else 0.0
            latitude, longitude = message.lat_int * 1e-7, message.lon_int * 1e-7
            position = vehicle.local(latitude, longitude, message.alt + base)
        elif frame in (LOCAL_NED, LOCAL_OFFSET, BODY_NED, BODY_OFFSET):
            position = (message.x, message.y, message.z)
            if frame in (BODY_NED, BODY_OFFSET):
                position, velocity = turned(position, body.yaw), turned(velocity, body.yaw)
                yaw = yaw + body.yaw
            if frame != LOCAL_NED:
                here = body.position
                position = (here[0] + position[0], here[1] + position[1], here[2] + position[2])
        else:
            return None
        return Setpoint(
            _masked(position, mask),
            _masked(velocity, mask >> 3),
            NAN if mask & YAW else yaw,
            NAN if mask & RATE else message.yaw_rate,
            mask,
            frame,
        )

    def whole(self, what: tuple[float, float, float]) -> bool:
        return all(math.isfinite(x) for x in what)


def turned(vector: tuple[float, float, float], yaw: float) -> tuple[float, float, float]:
    """From forward, right, down to north, east, down."""
    north = vector[0] * math.cos(yaw) - vector[1] * math.sin(yaw)
    return north, vector[0] * math.sin(yaw) + vector[1] * math.cos(yaw), vector[2]


def known(value: float) -> float | None:
    """None for NaN."""
    return value if math.isfinite(value) else None


def _masked(vector: tuple[float, float, float], mask: int) -> tuple[float, float, float]:
    x, y, z = (NAN if mask >> axis & 1 else value for axis, value in enumerate(vector))
    return x, y, z
