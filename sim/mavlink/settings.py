"""What a simulated MAVLink vehicle is, and what goes wrong with it when."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from math import inf
from typing import Literal, get_args

from agents.errors import MissionError

AutopilotName = Literal["ardupilot", "px4"]
VehicleType = Literal["copter", "rover"]
FaultKind = Literal[
    # the vehicle
    "no_position",  # the estimator has no position
    "arms_without_position",  # arming does not ask for one; take-off then fails, as ArduPilot was seen to
    "refuse_arming",  # value: the pre-arm failure that it tells
    "in_progress",  # value: s for which arming, take-off, landing and mode changes are IN_PROGRESS first
    "busy",  # commands are TEMPORARILY_REJECTED
    "stuck_mode",  # mode changes are accepted, and do not happen
    "nan_telemetry",  # position, velocity and attitude are NaN
    "bad_estimate",  # the estimator's variances are too large, its flags unhealthy
    "operator_mode",  # once; value: the mode to which an operator switches by RC
    "battery",  # once; value: per cent that are left
    "disarm",  # once: motors stop, wherever it is
    "reboot",  # once: starts anew, its streams forgotten
    # the wire
    "lost_acks",  # value: probability
    "lost_messages",  # value: probability, either way
    "deaf",  # hears nothing
    "mute",  # says nothing
    "no_heartbeat",  # says everything but that
    "garbage",  # value: bytes a second between frames
    "truncated",  # value: probability that a frame loses its end
    "flood",  # value: messages a second that nobody asked for
    "repeated",  # value: probability that a frame comes twice
]
ONCE = frozenset({"operator_mode", "battery", "disarm", "reboot"})


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that is wrong from `start` until `end`, seconds since the vehicle was switched on."""

    kind: FaultKind
    start: float = 0.0
    end: float = inf
    value: float | str = 1.0

    @staticmethod
    def parse(text: str) -> "Fault":
        """From `KIND[:VALUE][@START[-END]]`, as in `lost_acks:0.5@10-20`.

        Raises:
            MissionError: if it is not of that form.
        """
        what, _, when = text.partition("@")
        kind, _, value = what.partition(":")
        begin, _, end = when.partition("-")
        if kind not in get_args(FaultKind):
            raise MissionError(f"no fault {kind!r}; the faults are: {', '.join(get_args(FaultKind))}")
        try:
            times = float(begin or 0.0), float(end or inf)
        except ValueError:
            raise MissionError(f"fault {text!r}: expected KIND:VALUE@START-END with times in s") from None
        return Fault(kind, *times, _number(value) if value else 1.0)  # type: ignore[arg-type]


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


class Faults:
    """The faults of one vehicle; more may come while it runs. Times are seconds since it was switched on."""

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self._faults = list(faults)

    def __repr__(self) -> str:
        return f"Faults({self._faults})"

    def add(self, fault: Fault) -> None:
        self._faults.append(fault)

    def clear(self, kind: FaultKind) -> None:
        """End all faults of a kind."""
        self._faults = [fault for fault in self._faults if fault.kind != kind]

    def active(self, kind: FaultKind, time: float) -> Fault | None:
        for fault in self._faults:
            if fault.kind == kind and fault.start <= time < fault.end:
                return fault
        return None

    def amount(self, kind: FaultKind, time: float) -> float:
        """The value of an active fault as a number; 0: there is none."""
        fault = self.active(kind, time)
        return 0.0 if fault is None else float(fault.value)

    def due(self, time: float) -> list[Fault]:
        """Those that happen once and whose time has come; each is returned one time only."""
        ready = [fault for fault in self._faults if fault.kind in ONCE and fault.start <= time]
        self._faults = [fault for fault in self._faults if fault not in ready]
        return ready


@dataclass(frozen=True, slots=True)
class Settings:
    """One vehicle. It stands at `home` when it is switched on, and looks along `heading_deg`."""

    autopilot: AutopilotName = "ardupilot"
    type: VehicleType = "copter"
    system_id: int = 1
    home: tuple[float, float, float] = (47.397742, 8.545594, 488.0)  # deg, deg, m AMSL
    heading_deg: float = 0.0  # from north, clockwise
    ready_after: float = 1.0  # s from boot until the estimator has a position
    flight_time: float = 1200.0  # s that a full battery lasts in the air
    warm_up: float = 1.5  # s of setpoints that PX4 wants before OFFBOARD
    clock_offset: float = 0.0  # s by which its clock since boot is ahead of the driver's
    unix_start: float = 1_750_000_000.0  # s since 1970 when it is switched on, by its GPS
    default_streams: bool = False  # True: a PX4 on its onboard link streams without being asked
    version_1: bool = False  # speaks and understands MAVLink 1 only
    signing_key: bytes | None = None  # 32 bytes; unsigned and wrongly signed frames are dropped silently
    seed: int = 0
    parameters: dict[str, float] = field(default_factory=dict)  # that differ from the defaults
    faults: tuple[Fault, ...] = ()

    def __post_init__(self) -> None:
        if self.autopilot == "px4" and self.type == "rover":
            raise MissionError("a PX4 rover is not simulated; choose type copter, or autopilot ardupilot")
        if not 1 <= self.system_id <= 254:
            raise MissionError(f"system id {self.system_id} is not in 1..254")
        if self.signing_key is not None and len(self.signing_key) != 32:
            raise MissionError(f"a signing key has 32 bytes, not {len(self.signing_key)}")

    def but(self, **changes: object) -> "Settings":
        """The same with some fields changed."""
        return replace(self, **changes)  # type: ignore[arg-type]
