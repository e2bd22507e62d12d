"""What a simulated ArduPilot does about commands; each returns a MAV_RESULT."""

import math
from typing import TYPE_CHECKING

from sim.mavlink.commands import ACCEPTED, DENIED, FAILED, Command

if TYPE_CHECKING:
    from sim.mavlink.ardupilot import ArduPilot


def take_off(vehicle: "ArduPilot", command: Command) -> int:
    height = command.z
    ready = vehicle.armed and vehicle.mode == "GUIDED" and vehicle.body.on_ground and vehicle.has_position()
    if not ready or not math.isfinite(height) or height <= 0.0:
        return FAILED
    vehicle.guidance.take_off(vehicle.home_local()[2] - height)
    return ACCEPTED


def start_mission(vehicle: "ArduPilot", command: Command) -> int:
    if vehicle.set_mode("AUTO"):
        return FAILED
    vehicle.mission.start()
    return ACCEPTED


def reposition(vehicle: "ArduPilot", command: Command) -> int:
    if command.frame is None:
        return 8  # COMMAND_INT_ONLY
    if not command.has_place:
        return DENIED
    if vehicle.mode != "GUIDED" and (not int(command.params[1]) & 1 or vehicle.set_mode("GUIDED")):
        return DENIED
    base = (vehicle.home or vehicle.origin)[2] if command.frame in (3, 6) else 0.0
    vehicle.guidance.goto(vehicle.local(command.x, command.y, command.z + base))
    vehicle.last_setpoint = math.inf
    return ACCEPTED


def change_speed_command(vehicle: "ArduPilot", command: Command) -> int:
    if command.params[1] <= 0:
        return DENIED
    vehicle.change_speed(command.params[1])
    return ACCEPTED


def yaw(vehicle: "ArduPilot", command: Command) -> int:
    angle = math.radians(command.params[0])
    relative = command.params[3] == 1.0
    vehicle.guidance.yaw = (vehicle.body.yaw if relative else 0.0) + angle
    return ACCEPTED


def pause(vehicle: "ArduPilot", command: Command) -> int:
    if vehicle.mode not in ("GUIDED", "AUTO"):
        return FAILED
    vehicle.guidance.hold()
    return ACCEPTED


def enable_fence(vehicle: "ArduPilot", command: Command) -> int:
    vehicle.parameters["FENCE_ENABLE"] = 1.0 if command.params[0] == 1.0 else 0.0
    return ACCEPTED
