"""What a simulated autopilot does with each message that it hears."""

from typing import TYPE_CHECKING

from bridges.mavlink.dialect import Message, mavlink
from sim.mavlink import telemetry
from sim.mavlink.plans import Item

if TYPE_CHECKING:
    from sim.mavlink.autopilot import Autopilot


def receive(vehicle: "Autopilot", message: Message) -> None:
    """Do it, if it is for this vehicle."""
    if getattr(message, "target_system", 0) not in (0, vehicle.settings.system_id):
        return
    if getattr(message, "target_component", 0) not in (0, 1):
        return
    kind = message.get_type()
    if kind == "HEARTBEAT":
        vehicle.heard_heartbeat(message)
    elif kind in ("COMMAND_LONG", "COMMAND_INT", "SET_MODE"):
        vehicle.desk.receive(message)
    elif kind.startswith("SET_POSITION_TARGET_") or kind == "SET_ATTITUDE_TARGET":
        vehicle.setpoint(message)
    elif kind.startswith("PARAM_"):
        vehicle.send_all(vehicle.parameters.receive(message))
    elif kind.startswith("MISSION_"):
        _mission_message(vehicle, message)
    elif kind == "TIMESYNC" and message.tc1 == 0:
        vehicle.send(mavlink.MAVLink_timesync_message(vehicle.boot_ms() * 1_000_000, message.ts1))
    elif kind == "PING" and message.target_system == 0:
        back = (message.get_srcSystem(), message.get_srcComponent())
        vehicle.send(mavlink.MAVLink_ping_message(message.time_usec, message.seq, *back))
    elif kind == "FILE_TRANSFER_PROTOCOL":
        _refuse_files(vehicle, message)
    elif kind == "REQUEST_DATA_STREAM":
        _data_stream(vehicle, message)


def _refuse_files(vehicle: "Autopilot", message: Message) -> None:
    """There are no files: a NAK (128 + 1) for an unknown command (7), so that nobody waits."""
    asked = list(message.payload)
    sequence = asked[0] | asked[1] << 8
    follows = asked[2], 129, 1, asked[3], 0, 0, 0, 0, 0, 0, 7
    answer = [sequence + 1 & 255, sequence + 1 >> 8 & 255, *follows]
    back = (message.get_srcSystem(), message.get_srcComponent())
    padded = answer + [0] * (251 - len(answer))
    vehicle.send(mavlink.MAVLink_file_transfer_protocol_message(0, *back, padded))


def _mission_message(vehicle: "Autopilot", message: Message) -> None:
    if message.get_type() == "MISSION_SET_CURRENT":
        vehicle.mission.start(max(message.seq - vehicle.home_is_item_0, 0))
        if vehicle.mode not in ("AUTO", "MISSION"):
            vehicle.mission.stop()
        vehicle.send(telemetry.mission_current(vehicle))
        return
    latitude, longitude, altitude = vehicle.home or vehicle.origin
    vehicle.plans.home = Item(0, 16, (0.0, 0.0, 0.0, 0.0), latitude, longitude, altitude)
    vehicle.send_all(vehicle.plans.receive(message, vehicle.now))
    if vehicle.plans.changed:
        vehicle.plans_changed(vehicle.plans.changed)
        vehicle.plans.changed = set()


def _data_stream(vehicle: "Autopilot", message: Message) -> None:
    """The old way of asking, that ground stations still use with ArduPilot."""
    if vehicle.wire_autopilot != 3:
        return
    groups = telemetry.DATA_STREAMS
    ids = groups.get(message.req_stream_id, ())
    if message.req_stream_id == 0:
        ids = tuple({key for group in groups.values() for key in group})
    rate = message.req_message_rate if message.start_stop else 0
    for key in ids:
        vehicle.streams.set(key, 1.0 / rate if rate else 0.0, vehicle.now)
