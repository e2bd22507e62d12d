"""What a real vehicle asks of the process of its robot: to be tended, listened to, and brought down."""

import time
from collections.abc import Sequence

from agents.devices import LiveVehicle, VehicleHealth
from agents.machine import Delayed, Event, Heard
from agents.process.shell import Shell
from agents.team import Team
from agents.wire.messages import ResumeMessage
from agents.wire.topics import RESUME

TEND_S = 0.1
LEAVE_S = 1.2  # wall time that a launcher gives us before it makes an end (agents.swarm.supervisor)


class Piloting:
    """A vehicle that is found before its robot joins; use it as a context manager. Without one, nothing."""

    def __init__(self, team: Team, robot: str) -> None:
        self.vehicle: LiveVehicle | None = team.connect(robot, team.mission.seed)
        self._shell: Shell | None = None
        self._heard = time.monotonic()
        self._leaving = 0.0  # since when
        self._finished = False
        self._resumed: set[str] = set()  # messages

    def __repr__(self) -> str:
        return f"Piloting({self.vehicle!r})"

    def __enter__(self) -> "Piloting":
        return self

    def __exit__(self, *_: object) -> None:
        """However the robot ends, the vehicle is told what to do without it."""
        if self.vehicle is None:
            return
        try:
            self.finish()
        finally:
            self.vehicle.close()

    def finish(self) -> None:
        """Bring the vehicle's flight to an end; wait, but not long, until it shows."""
        vehicle = self.vehicle
        if vehicle is None or self._finished:
            return
        self._finished = True
        self.leave()
        until = self._leaving + LEAVE_S
        while not (left := vehicle.leave()) and time.monotonic() < until:
            time.sleep(0.02)
        if self._shell is not None:
            doubt = "" if left else " (told to, but it does not show yet)"
            self._shell.log(f"leaves its vehicle: {vehicle.health().words}{doubt}")

    def leave(self) -> None:
        """Tell the vehicle at once to end its flight; `finish` waits for it."""
        if self.vehicle is not None and self._leaving == 0.0:
            self._leaving = time.monotonic()
            self.vehicle.leave()

    def prepare(self) -> None:
        """See that the vehicle may fly; see LiveVehicle.prepare."""
        if self.vehicle is not None:
            self.vehicle.prepare()

    def begin(self, shell: Shell) -> None:
        """The team has begun; from now on it is tended."""
        if self.vehicle is None:
            return
        self._shell = shell
        self._heard = time.monotonic()
        self.vehicle.join(shell.clock)
        shell.transport.subscribe(RESUME)
        shell.every(TEND_S, self._tend)

    def hear(self, events: Sequence[Event]) -> None:
        """Whoever says anything shows that the team is there."""
        heard = [event.message for event in events if isinstance(event, Heard)]
        if heard:
            self._heard = time.monotonic()
        for message in heard:
            if isinstance(message, ResumeMessage):
                self._resume(message)

    def _resume(self, message: ResumeMessage) -> None:
        shell, vehicle = self._shell, self.vehicle
        if shell is None or vehicle is None or message.robot != shell.name:
            return
        about = f"{message.sender}/{message.boot}/{message.sequence}"
        if about not in self._resumed:  # it is said again until we have answered
            self._resumed.add(about)
            vehicle.resume()
        shell.announce(f"flies its vehicle again, as {message.sender} says", about=about)

    def health(self) -> VehicleHealth | None:
        """How the vehicle is."""
        return None if self.vehicle is None else self.vehicle.health()

    def _tend(self) -> None:
        shell, vehicle = self._shell, self.vehicle
        assert shell is not None
        assert vehicle is not None
        if self._leaving:
            return
        vehicle.tend(shell.clock.now(), time.monotonic() - self._heard)
        if vehicle.astray(shell.clock.now()):
            shell.tell(Delayed())
        for level, text in vehicle.news():
            shell.announce(text, level)
