"""A simulated vehicle and a client of it in virtual time, with real frames between them."""

from typing import Any

from bridges.mavlink.dialect import mavlink
from sim.mavlink.autopilot import Autopilot
from sim.mavlink.settings import Fault, Settings
from sim.mavlink.vehicle import MavlinkVehicle

DT = 0.1
GUIDED, AUTO, RTL, LAND_MODE, STABILIZE = 4, 3, 6, 9, 0


class Bench:
    """`say` something, `run` for a while, look at what was `heard`."""

    def __init__(
        self, settings: Settings, system: int = 255, component: int = 190, station: bool | None = None
    ) -> None:
        self.vehicle = MavlinkVehicle(settings)
        self.client = self.parser(system, component, settings.signing_key)
        self.now = 100.0  # any clock will do
        self.heard: list[Any] = []
        self.system_id = settings.system_id
        self._parser = self.parser(0, 0, settings.signing_key)
        self._outbox = b""
        # A PX4 gives its texts to ground stations only; an ArduPilot does not care.
        self.station = settings.autopilot == "px4" if station is None else station
        self._beat = 0.0
        self.run(DT)

    @staticmethod
    def parser(system: int, component: int, key: bytes | None) -> Any:
        made = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        made.robust_parsing = True
        if key is not None:
            made.signing.secret_key, made.signing.sign_outgoing = key, True
            made.signing.timestamp = round((1_750_000_000.0 - 1_420_070_400.0) * 1e5)
            made.signing.allow_unsigned_callback = lambda *_: False
        return made

    @property
    def pilot(self) -> Autopilot:
        return self.vehicle.autopilot

    def say(self, message: Any, **options: Any) -> None:
        self._outbox += message.pack(self.client, **options)
        self.client.seq = (self.client.seq + 1) % 256

    def say_raw(self, data: bytes) -> None:
        self._outbox += data

    def run(self, seconds: float, every: Any = None) -> list[Any]:
        """What was heard in these seconds; `every` is said ten times a second."""
        heard: list[Any] = []
        for _ in range(round(seconds / DT)):
            self.now += DT
            if self.station and self.now - self._beat >= 1.0:
                self._beat = self.now
                self.say(self.heartbeat())
            if every is not None:
                self.say(every)
            data, self._outbox = self._outbox, b""
            frames = self.vehicle.step(self.now, [("client", data)] if data else [])
            for frame in frames:
                heard += self._parser.parse_buffer(frame) or []
        self.heard += heard
        return heard

    def command(self, command: int, *params: float, seconds: float = DT) -> int | None:
        """The last acknowledgement that came within so many seconds."""
        filled = [*params, *[0.0] * (7 - len(params))]
        self.say(mavlink.MAVLink_command_long_message(self.system_id, 1, command, 0, *filled))
        acks = [m.result for m in self.run(seconds) if m.get_type() == "COMMAND_ACK" and m.command == command]
        return acks[-1] if acks else None

    def ask(self, message_id: int, hertz: float) -> int | None:
        return self.command(511, message_id, 1e6 / hertz)

    def mode(self, *numbers: float) -> int | None:
        return self.command(176, 1, *numbers)

    def of(self, kind: str) -> list[Any]:
        return [m for m in self.heard if m.get_type() == kind]

    def texts(self) -> str:
        return " | ".join(m.text for m in self.of("STATUSTEXT"))

    def heartbeat(self, kind: int = 6) -> Any:
        return mavlink.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3)

    def fly(self, height: float = 10.0, every: Any = None) -> None:
        """Arm and take off, each autopilot in its own way."""
        self.run(2.0)
        if self.pilot.wire_autopilot == 3:
            assert self.mode(GUIDED) == 0
            assert self.command(400, 1) == 0
            assert self.command(22, 0, 0, 0, 0, 0, 0, height) == 0
        else:
            assert self.command(400, 1) == 0
            assert self.command(22, 0, 0, 0, float("nan"), 0, 0, self.pilot.origin[2] + height) == 0
        self.run(15.0, every)
        assert abs(-self.pilot.body.position[2] - height) < 0.5

    def position_setpoint(self, north: float, east: float, down: float, mask: int = 0b110111111000) -> Any:
        rest = (0.0,) * 8
        return mavlink.MAVLink_set_position_target_local_ned_message(
            0, self.system_id, 1, 1, mask, north, east, down, *rest
        )

    def velocity_setpoint(self, north: float, east: float, down: float, mask: int = 0b110111000111) -> Any:
        return mavlink.MAVLink_set_position_target_local_ned_message(
            0, self.system_id, 1, 1, mask, 0.0, 0.0, 0.0, north, east, down, 0.0, 0.0, 0.0, 0.0, 0.0
        )

    def fault(self, kind: str, value: float | str = 1.0, start: float = 0.0, end: float = 1e9) -> None:
        """From now on."""
        since = self.pilot.switched_on()
        self.pilot.faults.add(Fault(kind, since + start, since + end, value))  # type: ignore[arg-type]
