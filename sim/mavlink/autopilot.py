"""A simulated autopilot: a pure state machine, messages in and messages out at times that it is told.

What ArduPilot and PX4 have in common is here; `ardupilot` and `px4` say how each arms, changes modes, takes
setpoints and fails safe. Times are the driver's; the vehicle's own clock starts at 0 when it boots.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable

from bridges.mavlink.dialect import Message, mavlink
from sim.mavlink import telemetry
from sim.mavlink.battery import Battery
from sim.mavlink.body import Body, Copter, Rover, Vector
from sim.mavlink.commands import Command, Desk
from sim.mavlink.geodesy import Projection
from sim.mavlink.guidance import Guidance
from sim.mavlink.inbox import receive
from sim.mavlink.mission_run import MissionRun
from sim.mavlink.parameters import Parameters
from sim.mavlink.plans import Item, Plans
from sim.mavlink.settings import FaultKind, Faults, Settings
from sim.mavlink.streams import Streams

TICK = 0.02  # s
STEPS = 4  # control steps a tick
CRITICAL, ERROR, WARNING, NOTICE, INFO = 2, 3, 4, 5, 6
Geodetic = tuple[float, float, float]


class Autopilot(ABC):
    """One vehicle. `step` it with growing times; everything else it tells in messages."""

    wire_autopilot: int
    capabilities: int
    version: int
    home_is_item_0: int  # 1 where the mission protocol counts home as item 0
    mission_yaws: bool  # whether waypoints' yaws are flown
    builders: dict[int, telemetry.Builder]
    commands: dict[int, Callable[[Command], int]]  # what is done about a command; the result is a MAV_RESULT

    def __init__(
        self,
        settings: Settings,
        parameters: Parameters,
        projection: Projection,
        plans: Plans,
        battery: Battery,
    ) -> None:
        self.settings, self.parameters, self.projection, self.plans = settings, parameters, projection, plans
        self.battery = battery
        self.faults = Faults(settings.faults)
        self.origin: Geodetic = settings.home
        self.home: Geodetic | None = None
        self.body: Body = self._made_body()
        self.guidance = Guidance(self.body)
        self.streams = Streams()
        self.mission = MissionRun(self)
        self.desk = Desk(self)
        self.armed = False
        self.mode = ""
        self.critical = False  # a failsafe has struck
        self.now = 0.0
        self._started: float | None = None
        self._booted = 0.0
        self._ticked = 0.0
        self._next_heartbeat = 0.0
        self._out: list[Message] = []
        self._text_id = 0

    def __repr__(self) -> str:
        return f"{type(self).__name__}(id={self.settings.system_id}, {self.mode}, armed={self.armed})"

    # --- driving it ---

    def step(self, now: float, messages: Iterable[Message] = ()) -> list[Message]:
        """Live until `now`, hear `messages`, and return what it says, in order."""
        if self._started is None:
            self._started = self._ticked = self.now = now
            self.boot()
        while self._ticked + TICK <= now + 1e-9:
            self._ticked += TICK
            self.now = self._ticked
            self._tick()
        for message in messages:
            receive(self, message)
        said, self._out = self._out, []
        return said

    def boot(self) -> None:
        """Begin as after power-on; parameters and plans are kept, streams are not."""
        self._booted = self._next_heartbeat = self.now
        self.streams = Streams()
        self.desk.clear()
        self.armed, self.critical, self.home = False, False, None
        self.mode = self.first_mode()
        self.mission.stop()
        self.guidance.rest()
        if self.settings.default_streams and self.wire_autopilot == 12:
            for key, rate in telemetry.ONBOARD_RATES.items():
                self.streams.set(key, 1.0 / rate, self.now)

    def switched_on(self) -> float:
        """Seconds since it was switched on: the time scale of faults."""
        return self.now - (self._started or 0.0)

    def fault(self, kind: FaultKind) -> bool:
        return self.faults.active(kind, self.switched_on()) is not None

    # --- its own state, for the messages and the modes ---

    def boot_ms(self) -> int:
        return round((self.now - self._booted + self.settings.clock_offset) * 1000) % 2**32

    def unix_us(self) -> int:
        return round((self.settings.unix_start + self.switched_on()) * 1e6)

    def has_position(self) -> bool:
        return self.now - self._booted >= self.settings.ready_after and not self.fault("no_position")

    def geodetic(self, position: Vector) -> Geodetic:
        """Degrees and m AMSL of a local position."""
        latitude, longitude = self.projection.to_degrees(position[0], position[1])
        return latitude, longitude, self.origin[2] - position[2]

    def local(self, latitude: float, longitude: float, altitude: float) -> Vector:
        """Local position of degrees and m AMSL."""
        return *self.projection.to_metres(latitude, longitude), self.origin[2] - altitude

    def home_local(self) -> Vector:
        return self.local(*(self.home or self.origin))

    def first_home(self) -> Geodetic:
        """The home that it gives itself where it stands."""
        return self.geodetic(self.body.position)

    def item_target(self, item: Item) -> Vector:
        """Where a mission item is; degrees of 0, 0 mean here."""
        north, east, down = self.body.position
        if (item.x, item.y) != (0.0, 0.0) and math.isfinite(item.x) and math.isfinite(item.y):
            north, east = self.projection.to_metres(item.x, item.y)
        base = self.home_local()[2] if item.frame in (3, 6) else self.origin[2]
        down = base - item.z
        return north, east, down

    def say(self, severity: int, text: str) -> None:
        """A STATUSTEXT, in pieces if it is longer than one holds."""
        raw = text.encode()
        if len(raw) <= 50:
            self._out.append(mavlink.MAVLink_statustext_message(severity, raw))
            return
        self._text_id = self._text_id % 65535 + 1
        pieces = [raw[i : i + 50] for i in range(0, len(raw), 50)]
        if len(pieces[-1]) == 50:
            pieces.append(b"")  # a piece that is not full ends the text
        for sequence, piece in enumerate(pieces):
            self._out.append(mavlink.MAVLink_statustext_message(severity, piece, self._text_id, sequence))

    def send(self, message: Message | None) -> None:
        if message is not None:
            self._out.append(message)

    def send_all(self, messages: Iterable[Message]) -> None:
        self._out.extend(messages)

    def reached_item(self, index: int) -> None:
        self._out.append(mavlink.MAVLink_mission_item_reached_message(index))

    # --- arming ---

    def arm(self) -> None:
        self.armed, self.critical = True, False
        self.armed_at = self.now
        self.body.cut = False

    def disarm(self) -> None:
        """Motors off, wherever it is."""
        self.armed = False
        self.body.cut = not self.body.on_ground or not self.body.flies
        self.mission.stop()
        self.guidance.rest()

    def refusal(self) -> str | None:
        """The pre-arm failure that a fault tells, if there is one."""
        fault = self.faults.active("refuse_arming", self.switched_on())
        if fault is None:
            return None
        return fault.value if isinstance(fault.value, str) else "Accels inconsistent"

    # --- what each autopilot does its own way ---

    @abstractmethod
    def first_mode(self) -> str: ...

    @abstractmethod
    def base_mode(self) -> int: ...

    @abstractmethod
    def custom_mode(self) -> int: ...

    @abstractmethod
    def arming_trouble(self) -> str | None:
        """What keeps it from arming now."""

    @abstractmethod
    def set_mode(self, mode: str, why: str = "") -> str | None:
        """Change the mode; a text says why it would not."""

    @abstractmethod
    def begin_return(self) -> None:
        """Go home in the way that it returns."""

    @abstractmethod
    def change_speed(self, speed: float) -> None: ...

    @abstractmethod
    def setpoint(self, message: Message) -> None:
        """A SET_POSITION_TARGET_* message for this vehicle."""

    @abstractmethod
    def heard_heartbeat(self, message: Message) -> None: ...

    @abstractmethod
    def fly(self) -> None:
        """One tick of the present mode and of the failsafes."""

    @property
    def wire_type(self) -> int:
        return 2 if self.settings.type == "copter" else 10

    def system_status(self) -> int:
        if self.critical:
            return 5
        return 4 if self.armed and not self.body.on_ground else 3

    # --- inside ---

    def _made_body(self) -> Body:
        yaw = math.radians(self.settings.heading_deg)
        return Copter(yaw, self.acceleration()) if self.settings.type == "copter" else Rover(yaw, 1.0)

    def acceleration(self) -> float:
        return 2.5

    def _tick(self) -> None:
        for fault in self.faults.due(self.switched_on()):
            self._strike(fault.kind, fault.value)
        if self.home is None and self.has_position():
            self.home = self.first_home()
            self.send(telemetry.home_position(self))
            self.send(telemetry.gps_global_origin(self))
        self.battery.spend(TICK, self.armed and not self.body.on_ground)
        self.fly()
        self.guidance.tick(STEPS)
        self.desk.tick()
        self._out.extend(self.parameters.tick())
        self._out.extend(self.plans.tick(self.now))
        if self.now >= self._next_heartbeat - 1e-9:
            self._next_heartbeat += 1.0
            self._out.append(telemetry.heartbeat(self))
        for key in self.streams.due(self.now):
            self.send(self.builders[key](self))

    def _strike(self, kind: FaultKind, value: float | str) -> None:
        if kind == "operator_mode":
            self.set_mode(str(value), "RC")
        elif kind == "battery":
            self.battery.left = float(value) / 100.0
        elif kind == "disarm":
            self.disarm()
        elif kind == "reboot":
            self.boot()

    def plans_changed(self, kinds: set[int]) -> None:
        """A mission (0), a fence (1) or rally points (2) are new."""
        if 0 in kinds:
            self.mission.stop()
            self.mission.index = 0
