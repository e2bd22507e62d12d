"""What is different between autopilots, behind one interface: modes, what to ask for, when they may fly."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from bridges.mavlink.commands import Command
from bridges.mavlink.dialect import mavlink
from bridges.mavlink.vehicle_state import VehicleReport

POSITION_AGE = 2.0  # s
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
SET_MODE = mavlink.MAV_CMD_DO_SET_MODE
INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
REQUEST = mavlink.MAV_CMD_REQUEST_MESSAGE
CUSTOM_MODE = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED

# bits of both autopilots' estimator flags
VELOCITY, ABSOLUTE, CONSTANT_POSITION = 2, 16, 128


@dataclass(frozen=True, slots=True)
class Failsafe:
    """What the autopilot does by itself in one case, as its parameters say."""

    cause: str  # "ground link", "setpoints", "low battery", "estimator", "fence", "radio control"
    action: str  # "none", "hold", "return", "land", ...
    words: str  # with the parameter and its value
    after: float | None = None  # s


class Autopilot(ABC):
    """One autopilot on one kind of body."""

    name: ClassVar[str]
    guided: ClassVar[str]  # the mode in which it follows our setpoints
    lead: ClassVar[float]  # s of setpoints that must have come before it takes that mode
    constant_is_blind: ClassVar[bool]  # its CONSTANT_POSITION means that it has no other position
    climbs_by_setpoint: ClassVar[bool]  # takes off by following setpoints, not by a command

    def __init__(self, body: str) -> None:
        self.body = body

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.body!r})"

    @abstractmethod
    def mode(self, report: VehicleReport) -> str:
        """The name of the mode it is in."""

    @property
    @abstractmethod
    def modes(self) -> tuple[str, ...]:
        """The names of all modes that it may have."""

    @abstractmethod
    def mode_command(self, mode: str) -> Command:
        """Ask for a mode by its name."""

    @property
    @abstractmethod
    def land_mode(self) -> str:
        """In which it comes down where it is (a rover: stands)."""

    @property
    @abstractmethod
    def return_mode(self) -> str:
        """In which it goes home."""

    @property
    @abstractmethod
    def hold_mode(self) -> str:
        """In which it stays where it is by itself."""

    @property
    @abstractmethod
    def mission_mode(self) -> str:
        """In which it flies the mission on board."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[str, ...]:
        """What to read to know its failsafes."""

    @abstractmethod
    def failsafes(self, values: Mapping[str, float], us: int) -> list[Failsafe]:
        """What these parameters make it do by itself; `us` is the system id that we send as."""

    @abstractmethod
    def take_off(self, height: float) -> Command | None:
        """Climb to a height above home; None: it needs no command."""

    @abstractmethod
    def estimator_message(self) -> int:
        """The message by which it reports its estimator."""

    def streams(self, rate: float) -> tuple[tuple[int, float], ...]:
        """Message ids and rates, Hz, of all that the bridge needs."""
        return (
            (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, rate),
            (mavlink.MAVLINK_MSG_ID_ATTITUDE, rate),
            (mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 2.0),
            (self.estimator_message(), 1.0),
            (mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, 1.0),
            (mavlink.MAVLINK_MSG_ID_SYS_STATUS, 1.0),
            (mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, 0.5),
            (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 2.0),
            (mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, 1.0),
            (mavlink.MAVLINK_MSG_ID_HOME_POSITION, 0.5),
            (mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, 0.5),
        )

    def not_ready(self, report: VehicleReport, now: float) -> list[str]:
        """Why it may not be armed yet, a sentence each; empty: it may."""
        reasons = []
        if report.position is None:
            reasons.append("it has not reported a local position (LOCAL_POSITION_NED)")
        elif report.age("LOCAL_POSITION_NED", now) > POSITION_AGE:
            reasons.append(f"its last local position is {report.age('LOCAL_POSITION_NED', now):.1f} s old")
        flags = report.estimator_flags
        if flags is None:
            reasons.append("it has not reported its estimator's state")
        elif not flags & ABSOLUTE:
            reasons.append(f"its estimator has no absolute position yet (flags {flags})")
        elif flags & CONSTANT_POSITION and self.constant_is_blind:
            reasons.append(f"its estimator only assumes its position (flags {flags})")
        if report.origin is None:
            reasons.append("it has not reported its estimator's origin (GPS_GLOBAL_ORIGIN)")
        if report.home is None:
            reasons.append("it has no home position yet")
        return reasons


def interval(message: int, rate: float) -> Command:
    """Ask for a message at a rate, Hz."""
    name = mavlink.mavlink_map[message].msgname
    return Command(INTERVAL, f"stream {name}", (float(message), 1e6 / rate))


def request(message: int) -> Command:
    """Ask for a message once."""
    return Command(REQUEST, f"request {mavlink.mavlink_map[message].msgname}", (float(message),))


def arm(yes: bool) -> Command:
    """Arm or disarm. Never forced."""
    return Command(ARM, "arm" if yes else "disarm", (float(yes), 0.0))


def autopilot_of(report: VehicleReport) -> Autopilot | None:
    """The adapter for what a heartbeat says; None: nobody here flies that."""
    from bridges.mavlink.ardupilot import ArduPilot  # noqa: PLC0415
    from bridges.mavlink.px4 import Px4  # noqa: PLC0415

    if report.body not in ("copter", "rover"):
        return None
    if report.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return ArduPilot(report.body)
    if report.autopilot == mavlink.MAV_AUTOPILOT_PX4 and report.body == "copter":
        return Px4(report.body)
    return None
