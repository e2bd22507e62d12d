"""What a simulated PX4 does about commands; each returns a MAV_RESULT."""

import math
from typing import TYPE_CHECKING

from sim.mavlink.autopilot import INFO
from sim.mavlink.commands import ACCEPTED, BUSY, DENIED, Command
from sim.mavlink.setpoints import known

if TYPE_CHECKING:
    from sim.mavlink.px4 import Px4


def take_off(vehicle: "Px4", command: Command) -> int:
    """The altitude is AMSL; without one it is MIS_TAKEOFF_ALT above home."""
    trouble = vehicle.set_mode("TAKEOFF")
    if trouble is not None:
        return BUSY
    if math.isfinite(command.z) and command.z != 0.0:
        vehicle.rise(command.z - vehicle.origin[2])
    vehicle.say(INFO, "Takeoff detected" if vehicle.armed else "Waiting for arming")
    return ACCEPTED


def start_mission(vehicle: "Px4", command: Command) -> int:
    if vehicle.set_mode("MISSION"):
        return BUSY
    if not vehicle.mission.running:
        vehicle.mission.start()
    return ACCEPTED


def reposition(vehicle: "Px4", command: Command) -> int:
    """The altitude is AMSL whatever the frame, as with the real one."""
    if vehicle.mode != "HOLD" and vehicle.set_mode("HOLD"):
        return BUSY
    here = vehicle.geodetic(vehicle.body.position)
    if not vehicle.armed or vehicle.body.on_ground:
        return DENIED
    place = (command.x, command.y) if command.has_place else here[:2]
    altitude = command.z if math.isfinite(command.z) else here[2]
    if command.params[0] > 0:
        vehicle.change_speed(command.params[0])
    vehicle.guidance.goto(vehicle.local(*place, altitude), known(command.params[3]))
    return ACCEPTED


def change_speed_command(vehicle: "Px4", command: Command) -> int:
    if command.params[1] > 0:
        vehicle.change_speed(command.params[1])
    return ACCEPTED
