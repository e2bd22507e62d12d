"""A pilot and a simulated vehicle in virtual time, joined by bytes: a minute of flight in a second."""

from collections.abc import Callable, Iterable

import numpy as np

from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.event import Event
from bridges.mavlink.pilot import Pilot
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.pilot_report import PilotReport, report_of
from bridges.mavlink.port import LinkState
from bridges.mavlink.wanted import GoTo, Task, Wanted
from bridges.mavlink.wire import Wire
from sim.mavlink.settings import Fault, Settings
from sim.mavlink.vehicle import MavlinkVehicle

STEP = 0.02
STATION = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3)


class Air:
    """`fly` lets time pass; both sides see the same clock but for their own offsets."""

    def __init__(self, settings: Settings, config: PilotConfig | None = None, tells: bool = True) -> None:
        self.vehicle = MavlinkVehicle(settings)
        self.pilot = Pilot(config or PilotConfig(system=settings.system_id, take_off_height=5.0))
        self.wire = Wire((1, 191))
        self.now = 100.0
        self.wanted = Wanted()
        self.robot_age = 0.0
        self.cut = False
        self.station = Wire((255, 190)) if settings.autopilot == "px4" else None  # it hears a PX4's texts
        self._beat = 0.0
        self.sent: list[tuple[float, Message]] = []
        self.events: list[Event] = []

    @property
    def autopilot(self):  # type: ignore[no-untyped-def]
        return self.vehicle.autopilot

    @property
    def report(self) -> PilotReport:
        return report_of(self.now, self.pilot, self.wire.counters)

    def said(self) -> str:
        return "\n".join(event.text for event in self.events)

    def want(self, task: Task) -> None:
        self.wanted = Wanted(task)

    def step(self) -> None:
        self.now += STEP
        back = getattr(self, "_back", b"")
        heard: list[tuple[str, bytes]] = [("pilot", back)] if back and not self.cut else []
        if self.station is not None and self.now - self._beat >= 1.0:
            self._beat = self.now
            heard.append(("station", self.station.pack(STATION)))
        frames = self.vehicle.step(self.now, heard)
        data = b"" if self.cut else b"".join(frames)
        received = list(self.wire.parse(data, "vehicle"))
        self.wire.source = self.pilot.us
        out = self.pilot.step(self.now, received, self.wanted, self.robot_age, self.state())
        self.sent += [(self.now, message) for message in out]
        self._back = b"".join(self.wire.pack(message) for message in out)
        self.events += self.pilot.events
        self.pilot.events.clear()

    def state(self) -> LinkState:
        return LinkState(arrived=self.wire.arrived, missed=self.wire.missed)

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.step()

    def until(self, condition: Callable[[], bool], seconds: float) -> bool:
        for _ in range(round(seconds / STEP)):
            self.step()
            if condition():
                return True
        return False

    def fault(self, kind: str, value: float | str = 1.0, lasts: float = np.inf) -> None:
        since = self.autopilot.switched_on()
        self.autopilot.faults.add(Fault(kind, since, since + lasts, value))  # type: ignore[arg-type]

    def airborne(self, north: float = 0.0, east: float = 0.0, height: float = 5.0) -> None:
        """Start it and fly to a place."""
        there = np.array([north, east, -height])
        self.want(GoTo(there))
        assert self.until(lambda: self.at(there), 60.0), (self.report, self.said())

    def at(self, place: Iterable[float], within: float = 1.0) -> bool:
        position = self.report.position
        return (
            self.pilot.phase == "flying"
            and position is not None
            and float(np.linalg.norm(position - np.asarray(place))) < within
        )

    def count(self, kind: str, since: float = 0.0) -> int:
        return sum(message.get_type() == kind and time > since for time, message in self.sent)

    def commands(self, number: int, since: float = 0.0) -> list[Message]:
        return [
            message
            for time, message in self.sent
            if message.get_type() == "COMMAND_LONG" and message.command == number and time > since
        ]


ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
