"""The messages in which a simulated autopilot tells how it is, each made from its state when it is due."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from bridges.mavlink.dialect import Message, mavlink

if TYPE_CHECKING:
    from sim.mavlink.autopilot import Autopilot

NAN = math.nan
ARDUPILOT_EKF_READY = 831  # all but GPS glitch, constant position, height above ground, uninitialised
ARDUPILOT_EKF_WAITING = 167  # attitude, velocity, vertical position; constant position mode
PX4_EKF_READY = 1 | 2 | 4 | 8 | 16 | 32 | 256 | 512
PX4_EKF_RESTS = 128  # constant position: set at rest too, though it knows its position
PX4_EKF_WAITING = 1 | 4 | 32 | 128
SENSORS = 0x1 | 0x2 | 0x4 | 0x8 | 0x20 | 0x400 | 0x800 | 0x1000 | 0x4000 | 0x8000 | 0x200000
GEOFENCE = 0x100000
GPS, PRE_ARM, BATTERY = 0x20, 0x10000000, 0x2000000
SKY = 10  # satellites

Builder = Callable[["Autopilot"], Message | None]


def heartbeat(v: "Autopilot") -> Message:
    return mavlink.MAVLink_heartbeat_message(
        v.wire_type, v.wire_autopilot, v.base_mode(), v.custom_mode(), v.system_status(), 3
    )


def sys_status(v: "Autopilot") -> Message:
    present = SENSORS | PRE_ARM | BATTERY
    health = present | GEOFENCE
    if not v.has_position():
        health &= ~GPS
    if v.arming_trouble():
        health &= ~PRE_ARM
    enabled = present if v.armed or v.wire_autopilot == 12 else present & ~0x8000
    left = round(v.battery.left * 100)
    volts, amperes = round(v.battery.volts() * 1000), round(v.battery.amperes * 100)
    return mavlink.MAVLink_sys_status_message(
        present, enabled, health, 120, volts, amperes, left, 0, 0, 0, 0, 0, 0
    )


def system_time(v: "Autopilot") -> Message:
    return mavlink.MAVLink_system_time_message(v.unix_us(), v.boot_ms())


def gps_raw_int(v: "Autopilot") -> Message:
    latitude, longitude, altitude = v.geodetic(v.body.position)
    fix = 3 if v.has_position() else 1
    north, east, _ = v.body.velocity
    course = round(math.degrees(math.atan2(east, north)) % 360.0 * 100) % 36000
    where = (round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1000))
    return mavlink.MAVLink_gps_raw_int_message(
        v.boot_ms() * 1000, fix, *where, 121, 200, round(math.hypot(north, east) * 100), course, SKY
    )


def attitude(v: "Autopilot") -> Message:
    roll, pitch, yaw = _attitude(v)
    return mavlink.MAVLink_attitude_message(v.boot_ms(), roll, pitch, yaw, 0.0, 0.0, v.body.yaw_rate)


def attitude_quaternion(v: "Autopilot") -> Message:
    roll, pitch, yaw = _attitude(v)
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    q = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    return mavlink.MAVLink_attitude_quaternion_message(v.boot_ms(), *q, 0.0, 0.0, v.body.yaw_rate)


def local_position_ned(v: "Autopilot") -> Message | None:
    if not v.has_position():
        return None
    position, velocity = v.body.position, v.body.velocity
    if v.fault("nan_telemetry"):
        position = velocity = (NAN, NAN, NAN)
    return mavlink.MAVLink_local_position_ned_message(v.boot_ms(), *position, *velocity)


def global_position_int(v: "Autopilot") -> Message | None:
    if not v.has_position():
        return None
    latitude, longitude, altitude = v.geodetic(v.body.position)
    height = altitude - (v.home[2] if v.home else v.origin[2])
    heading = round(math.degrees(v.body.yaw) % 360.0 * 100) % 36000
    velocity = [round(x * 100) for x in v.body.velocity]
    where = (round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1000), round(height * 1000))
    return mavlink.MAVLink_global_position_int_message(v.boot_ms(), *where, *velocity, heading)


def battery_status(v: "Autopilot") -> Message:
    volts = [round(v.battery.volts() * 1000)] + [65535] * 9
    used = round((1.0 - v.battery.left) * 3300)
    current, left = round(v.battery.amperes * 100), round(v.battery.left * 100)
    return mavlink.MAVLink_battery_status_message(0, 0, 1, 32767, volts, current, used, -1, left)


def ekf_status_report(v: "Autopilot") -> Message:
    flags = ARDUPILOT_EKF_READY if v.has_position() else ARDUPILOT_EKF_WAITING
    error = 1.5 if v.fault("bad_estimate") else 0.02
    if v.fault("bad_estimate"):
        flags &= ~(8 | 16)
    return mavlink.MAVLink_ekf_status_report_message(flags, error, error, 0.01, 0.01, 0.0, 0.0)


def estimator_status(v: "Autopilot") -> Message:
    flags = PX4_EKF_READY if v.has_position() else PX4_EKF_WAITING
    flags |= PX4_EKF_RESTS if v.body.on_ground else 0
    error = 1.5 if v.fault("bad_estimate") else 0.02
    if v.fault("bad_estimate"):
        flags &= ~(8 | 16)
    rest = (error, error, 0.01, 0.01, 0.0, 0.0, 0.5, 0.8)
    return mavlink.MAVLink_estimator_status_message(v.boot_ms() * 1000, flags, *rest)


def extended_sys_state(v: "Autopilot") -> Message:
    state = 1 if v.body.on_ground else {"takeoff": 3, "land": 4}.get(v.guidance.task, 2)
    return mavlink.MAVLink_extended_sys_state_message(0, state)


def home_position(v: "Autopilot") -> Message | None:
    if v.home is None:
        return None
    latitude, longitude, altitude = v.home
    where = (round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1000))
    north, east, down = v.local(latitude, longitude, altitude)
    return mavlink.MAVLink_home_position_message(
        *where, north, east, down, (1.0, 0.0, 0.0, 0.0), NAN, NAN, NAN, v.boot_ms() * 1000
    )


def gps_global_origin(v: "Autopilot") -> Message | None:
    if not v.has_position():
        return None
    where = (round(v.origin[0] * 1e7), round(v.origin[1] * 1e7), round(v.origin[2] * 1000))
    return mavlink.MAVLink_gps_global_origin_message(*where, v.boot_ms() * 1000)


def position_target_local_ned(v: "Autopilot") -> Message:
    """What it steers for; without a target the mask ignores the position."""
    target, velocity = v.guidance.target, v.guidance.velocity
    mask = 0b110111111000 if target is not None else 0b110111000111
    yaw = v.body.yaw
    return mavlink.MAVLink_position_target_local_ned_message(
        v.boot_ms(), 1, mask, *(target or (0.0, 0.0, 0.0)), *velocity, 0.0, 0.0, 0.0, yaw, 0.0
    )


def position_target_global_int(v: "Autopilot") -> Message | None:
    if v.guidance.target is None:
        return None
    latitude, longitude, altitude = v.geodetic(v.guidance.target)
    where = (round(latitude * 1e7), round(longitude * 1e7), altitude)
    rest = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, v.body.yaw, 0.0)
    return mavlink.MAVLink_position_target_global_int_message(v.boot_ms(), 0, 0b110111111000, *where, *rest)


def mission_current(v: "Autopilot") -> Message:
    total = len(v.plans.items[0])
    state = v.mission.state()
    return mavlink.MAVLink_mission_current_message(v.mission.wire_index(), total, state, int(v.armed))


def vfr_hud(v: "Autopilot") -> Message:
    north, east, down = v.body.velocity
    speed, heading = math.hypot(north, east), round(math.degrees(v.body.yaw)) % 360
    altitude = v.geodetic(v.body.position)[2]
    return mavlink.MAVLink_vfr_hud_message(speed, speed, heading, 40 if v.armed else 0, altitude, -down)


def altitude(v: "Autopilot") -> Message:
    height = -v.body.position[2]
    amsl = v.geodetic(v.body.position)[2]
    return mavlink.MAVLink_altitude_message(
        v.boot_ms() * 1000, amsl, amsl, height, amsl - (v.home[2] if v.home else amsl), NAN, NAN
    )


def rc_channels(v: "Autopilot") -> Message:
    values = [1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800] + [0] * 10
    return mavlink.MAVLink_rc_channels_message(v.boot_ms(), 16, *values, 255)


def nav_controller_output(v: "Autopilot") -> Message:
    roll, pitch = v.body.tilt
    heading = round(math.degrees(v.body.yaw))
    target = v.guidance.target or v.body.position
    gap = [t - p for t, p in zip(target, v.body.position, strict=True)]
    bearing = round(math.degrees(math.atan2(gap[1], gap[0])))
    away = min(round(math.hypot(gap[0], gap[1])), 65535)
    return mavlink.MAVLink_nav_controller_output_message(
        math.degrees(roll), math.degrees(pitch), heading, bearing, away, -gap[2], 0.0, 0.0
    )


def vibration(v: "Autopilot") -> Message:
    return mavlink.MAVLink_vibration_message(v.boot_ms() * 1000, 0.02, 0.02, 0.03, 0, 0, 0)


def autopilot_version(v: "Autopilot") -> Message:
    none, serial = [0] * 8, v.settings.system_id
    uid2 = [*b"simulated", serial, *[0] * 8]
    return mavlink.MAVLink_autopilot_version_message(
        v.capabilities, v.version, 0, 0, 0, none, none, none, 0, 0, serial, uid2
    )


def _attitude(v: "Autopilot") -> tuple[float, float, float]:
    if v.fault("nan_telemetry"):
        return NAN, NAN, NAN
    return *v.body.tilt, v.body.yaw


COMMON: dict[int, Builder] = {
    0: heartbeat,
    1: sys_status,
    2: system_time,
    24: gps_raw_int,
    30: attitude,
    31: attitude_quaternion,
    32: local_position_ned,
    33: global_position_int,
    42: mission_current,
    49: gps_global_origin,
    62: nav_controller_output,
    65: rc_channels,
    74: vfr_hud,
    85: position_target_local_ned,
    87: position_target_global_int,
    147: battery_status,
    148: autopilot_version,
    241: vibration,
    242: home_position,
    245: extended_sys_state,
}
ARDUPILOT = COMMON | {193: ekf_status_report}
PX4 = {key: build for key, build in COMMON.items() if key != 62} | {141: altitude, 230: estimator_status}
DATA_STREAMS = {  # MAV_DATA_STREAM, as ArduPilot still understands it
    1: (24,),  # raw sensors
    2: (1, 42, 24, 62, 147),  # extended status
    3: (65,),  # RC
    6: (32, 33),  # position
    10: (30,),
    11: (74,),
    12: (2, 193, 241),
}
ONBOARD_RATES = {  # Hz: what a PX4 streams on its onboard link unasked, less what nobody here reads
    1: 5, 2: 1, 24: 5, 30: 50, 31: 50, 32: 30, 33: 10, 42: 1, 74: 10, 85: 10, 141: 10, 147: 0.5, 230: 1,
    242: 1, 245: 5,
}  # fmt: skip
