"""Setpoints in local NED, with the type masks that both autopilots read alike.

ArduPilot drops a whole group of which one axis is ignored, so a group is given or ignored as a whole.
"""

import math

import numpy as np

from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.vehicle_state import VehicleReport
from estimator.arrays import FloatArray

NO_POSITION, NO_VELOCITY, NO_ACCELERATION, NO_YAW, NO_YAW_RATE = 0x007, 0x038, 0x1C0, 0x400, 0x800
PERIOD = 0.1  # s between setpoints that say the same
SHORTEST = 0.02  # s between any setpoint and the next but one
LOCAL_NED = mavlink.MAV_FRAME_LOCAL_NED


def position_setpoint(
    target: tuple[int, int], boot_ms: int, position: FloatArray, yaw: float | None
) -> Message:
    """Be at a position (3,) m; yaw in rad from north."""
    mask = NO_VELOCITY | NO_ACCELERATION | NO_YAW_RATE | (NO_YAW if yaw is None else 0)
    x, y, z = (float(value) for value in position)
    return mavlink.MAVLink_set_position_target_local_ned_message(
        boot_ms, *target, LOCAL_NED, mask, x, y, z, 0, 0, 0, 0, 0, 0, yaw or 0.0, 0
    )


def velocity_setpoint(
    target: tuple[int, int], boot_ms: int, velocity: FloatArray, yaw: float | None
) -> Message:
    """Move with a velocity (3,) m/s; yaw in rad from north."""
    mask = NO_POSITION | NO_ACCELERATION | NO_YAW_RATE | (NO_YAW if yaw is None else 0)
    x, y, z = (float(value) for value in velocity)
    return mavlink.MAVLink_set_position_target_local_ned_message(
        boot_ms, *target, LOCAL_NED, mask, 0, 0, 0, x, y, z, 0, 0, 0, yaw or 0.0, 0
    )


class Setpoints:
    """A stream without gaps: a new setpoint goes out at once, the same one again every 0.1 s."""

    def __init__(self, target: tuple[int, int], stale: float) -> None:
        self._target = target
        self._stale = stale
        self._held: FloatArray | None = None
        self._sent = self._sent_before = -math.inf
        self._last: tuple[object, ...] = ()

    def __repr__(self) -> str:
        return f"Setpoints({self._last})"

    def let_go(self) -> None:
        """The next `hold` is at the place where it will be then."""
        self._held = None

    def hold(self, now: float, report: VehicleReport) -> list[Message]:
        """Stay where it was when this began; without a fresh position, stand still."""
        if report.age("LOCAL_POSITION_NED", now) > self._stale:
            return self.velocity(now, np.zeros(3), None)
        if self._held is None and report.position is not None:
            self._held = report.position.copy()
        return [] if self._held is None else self.position(now, self._held, None)

    def position(self, now: float, position: FloatArray, yaw: float | None) -> list[Message]:
        """Be at a position (3,)."""
        if not self._due(now, ("position", *position.tolist(), yaw)):
            return []
        return [position_setpoint(self._target, _boot(now), position, yaw)]

    def velocity(self, now: float, velocity: FloatArray, yaw: float | None) -> list[Message]:
        """Move with a velocity (3,)."""
        if not self._due(now, ("velocity", *velocity.tolist(), yaw)):
            return []
        return [velocity_setpoint(self._target, _boot(now), velocity, yaw)]

    def _due(self, now: float, setpoint: tuple[object, ...]) -> bool:
        if setpoint == self._last:
            if now - self._sent < PERIOD - 1e-3:
                return False
        elif now - self._sent_before < SHORTEST:
            return False
        self._sent_before, self._sent, self._last = self._sent, now, setpoint
        return True


def _boot(now: float) -> int:
    return int(now * 1000) % 2**32
