"""Setpoints in local NED, with the type masks that both autopilots read alike.

ArduPilot drops a whole group of which one axis is ignored, so a group is given or ignored as a whole.
"""

from bridges.mavlink.dialect import Message, mavlink
from estimator.arrays import FloatArray

NO_POSITION, NO_VELOCITY, NO_ACCELERATION, NO_YAW, NO_YAW_RATE = 0x007, 0x038, 0x1C0, 0x400, 0x800
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
