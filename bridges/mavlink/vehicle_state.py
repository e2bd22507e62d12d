"""What an autopilot has said of itself, each with the time at which it was heard.

Positions are local NED in metres, angles radians, global positions degrees and metres above mean sea level.
A message with a number that is none is not believed and counted.
"""

import math
from collections import Counter, deque
from dataclasses import dataclass, field

import numpy as np

from bridges.mavlink.dialect import Message, mavlink
from estimator.arrays import FloatArray

STATUS_TEXTS = 30
PIECE = 50  # bytes of a text in one message
PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK
COPTERS = frozenset({2, 3, 4, 13, 14, 15, 29, 35, 43})  # MAV_TYPE
ROVERS = frozenset({10, 11})
BOOTED_BEFORE = 1.0  # s by which the vehicle's clock goes back when it has started anew
_FINITE = {
    "LOCAL_POSITION_NED": ("x", "y", "z", "vx", "vy", "vz"),
    "ATTITUDE": ("roll", "pitch", "yaw"),
    "HOME_POSITION": ("x", "y", "z"),
}


def body_of(mav_type: int) -> str:
    """What kind of vehicle a MAV_TYPE is, in a word."""
    if mav_type in COPTERS:
        return "copter"
    if mav_type in ROVERS:
        return "rover"
    entry = mavlink.enums["MAV_TYPE"].get(mav_type)
    return entry.name.removeprefix("MAV_TYPE_").lower().replace("_", " ") if entry else f"type {mav_type}"


@dataclass(frozen=True, slots=True)
class StatusText:
    """What the autopilot told people."""

    time: float
    severity: int  # 0 emergency ... 3 error, 4 warning, 6 info
    text: str


@dataclass(slots=True)
class VehicleReport:
    """The newest of everything; None where nothing was heard yet."""

    heard: dict[str, float] = field(default_factory=dict)  # message type -> when
    boot_times: dict[str, int] = field(default_factory=dict)  # message type -> time_boot_ms
    mav_type: int = 0
    autopilot: int = mavlink.MAV_AUTOPILOT_INVALID
    base_mode: int = 0
    custom_mode: int = 0
    system_status: int = 0
    position: FloatArray | None = None  # (3,) local NED
    velocity: FloatArray | None = None  # (3,)
    attitude: tuple[float, float, float] | None = None  # roll, pitch, yaw
    where: tuple[float, float, float] | None = None  # latitude, longitude, altitude AMSL
    relative_altitude: float | None = None
    battery: float | None = None  # fraction that remains
    voltage: float | None = None
    prearm_ok: bool | None = None
    estimator_flags: int | None = None
    gps_fix: int | None = None
    satellites: int | None = None
    home: tuple[float, float, float] | None = None  # latitude, longitude, altitude AMSL
    origin: tuple[float, float, float] | None = None  # of local NED
    landed_state: int = 0
    capabilities: int | None = None
    version: str = ""
    radio: float | None = None  # weaker side's strength, 0-1
    texts: deque[StatusText] = field(default_factory=lambda: deque(maxlen=STATUS_TEXTS))
    told: int = 0  # texts in all
    reboots: int = 0
    turns: deque[float] = field(default_factory=lambda: deque(maxlen=8))  # when its clock went back
    counters: Counter[str] = field(default_factory=Counter)
    _chunks: dict[int, tuple[int, list[tuple[int, str]]]] = field(
        default_factory=dict
    )  # id -> severity, pieces

    def age(self, kind: str, now: float) -> float:
        """Seconds since a message of this type was heard; infinity: never."""
        return now - self.heard[kind] if kind in self.heard else math.inf

    @property
    def armed(self) -> bool:
        return bool(self.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    @property
    def body(self) -> str:
        """ "copter", "rover", or what else it is."""
        return body_of(self.mav_type)

    @property
    def in_air(self) -> bool:
        """Whether it flies; an armed one that does not say counts as flying where it may."""
        if self.landed_state in (mavlink.MAV_LANDED_STATE_IN_AIR, mavlink.MAV_LANDED_STATE_TAKEOFF):
            return True
        if self.landed_state == mavlink.MAV_LANDED_STATE_LANDING:
            return True
        if self.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND or not self.armed:
            return False
        return self.body == "copter" and (self.relative_altitude is None or self.relative_altitude > 0.5)

    def hear(self, now: float, message: Message) -> None:
        """Take in one message of this vehicle's autopilot."""
        kind = message.get_type()
        if not all(math.isfinite(getattr(message, name)) for name in _FINITE.get(kind, ())):
            self.counters["not_a_number"] += 1
            return
        self._boot_time(now, kind, message)
        handler = _HANDLERS.get(kind)
        if handler is not None:
            handler(self, now, message)
        self.heard[kind] = now

    def since(self, time: float, worst: int = 7) -> list[str]:
        """The texts heard since a time, of a severity or graver."""
        return [text.text for text in self.texts if text.time >= time and text.severity <= worst]

    def _boot_time(self, now: float, kind: str, message: Message) -> None:
        boot = getattr(message, "time_boot_ms", None)
        if boot is None:
            return
        if boot < self.boot_times.get(kind, 0) - BOOTED_BEFORE * 1000:
            self.turns.append(now)
            self.reboots += 1
            self.boot_times.clear()
        self.boot_times[kind] = boot

    def _heartbeat(self, now: float, message: Message) -> None:
        self.mav_type, self.autopilot = message.type, message.autopilot
        self.base_mode, self.custom_mode = message.base_mode, message.custom_mode
        self.system_status = message.system_status

    def _local(self, now: float, message: Message) -> None:
        self.position = np.array([message.x, message.y, message.z])
        self.velocity = np.array([message.vx, message.vy, message.vz])

    def _global(self, now: float, message: Message) -> None:
        self.where = (message.lat / 1e7, message.lon / 1e7, message.alt / 1e3)
        self.relative_altitude = message.relative_alt / 1e3

    def _attitude(self, now: float, message: Message) -> None:
        self.attitude = (message.roll, message.pitch, message.yaw)

    def _system(self, now: float, message: Message) -> None:
        if message.battery_remaining >= 0:
            self.battery = message.battery_remaining / 100
        if message.voltage_battery not in (0, 0xFFFF):
            self.voltage = message.voltage_battery / 1000
        if message.onboard_control_sensors_present & PREARM:
            self.prearm_ok = bool(message.onboard_control_sensors_health & PREARM)

    def _battery(self, now: float, message: Message) -> None:
        if message.id == 0 and message.battery_remaining >= 0:
            self.battery = message.battery_remaining / 100

    def _estimator(self, now: float, message: Message) -> None:
        self.estimator_flags = message.flags

    def _gps(self, now: float, message: Message) -> None:
        self.gps_fix = message.fix_type
        self.satellites = None if message.satellites_visible == 255 else message.satellites_visible

    def _home(self, now: float, message: Message) -> None:
        self.home = (message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3)

    def _origin(self, now: float, message: Message) -> None:
        self.origin = (message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3)

    def _landed(self, now: float, message: Message) -> None:
        self.landed_state = message.landed_state

    def _about(self, now: float, message: Message) -> None:
        self.capabilities = message.capabilities
        number = message.flight_sw_version
        self.version = f"{number >> 24}.{number >> 16 & 255}.{number >> 8 & 255}"

    def _radio(self, now: float, message: Message) -> None:
        weaker = min((value for value in (message.rssi, message.remrssi) if value != 255), default=None)
        self.radio = None if weaker is None else weaker / 254

    def _text(self, now: float, message: Message) -> None:
        text = message.text if isinstance(message.text, str) else message.text.decode("utf-8", "replace")
        text = text.rstrip("\x00")
        for other in self._chunks.keys() - {
            message.id
        }:  # a PX4 does not end a text that fills its last piece
            self._finish(now, other)
        if not message.id:
            self._say(now, message.severity, text)
            return
        chunks = self._chunks.setdefault(message.id, (message.severity, []))[1]
        chunks.append((message.chunk_seq, text))
        if len(text) < PIECE or len(chunks) >= 8:
            self._finish(now, message.id)

    def _finish(self, now: float, number: int) -> None:
        severity, chunks = self._chunks.pop(number)
        self._say(now, severity, "".join(part for _, part in sorted(chunks)))

    def _say(self, now: float, severity: int, text: str) -> None:
        self.told += 1
        text = text.rstrip()  # a PX4 marks with a tab what it also sends as an event
        self.texts.append(StatusText(now, severity, "".join(c if c.isprintable() else "?" for c in text)))


_HANDLERS = {
    "HEARTBEAT": VehicleReport._heartbeat,
    "LOCAL_POSITION_NED": VehicleReport._local,
    "GLOBAL_POSITION_INT": VehicleReport._global,
    "ATTITUDE": VehicleReport._attitude,
    "SYS_STATUS": VehicleReport._system,
    "BATTERY_STATUS": VehicleReport._battery,
    "EKF_STATUS_REPORT": VehicleReport._estimator,
    "ESTIMATOR_STATUS": VehicleReport._estimator,
    "GPS_RAW_INT": VehicleReport._gps,
    "HOME_POSITION": VehicleReport._home,
    "GPS_GLOBAL_ORIGIN": VehicleReport._origin,
    "EXTENDED_SYS_STATE": VehicleReport._landed,
    "AUTOPILOT_VERSION": VehicleReport._about,
    "RADIO_STATUS": VehicleReport._radio,
    "STATUSTEXT": VehicleReport._text,
}
