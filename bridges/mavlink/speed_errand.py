"""Tell an ArduPilot how fast the mission lets it go; a PX4 goes no faster than setpoints are streamed."""

from bridges.mavlink.commands import Command
from bridges.mavlink.dialect import Message, mavlink

TRIES, AGAIN_S = 3, 1.0
CHANGE_SPEED = mavlink.MAV_CMD_DO_CHANGE_SPEED


class SpeedErrand:
    """`bridges.mavlink.pilot.Errand`: ground speed in m/s, until it is acknowledged."""

    def __init__(self, system: int, speed: float) -> None:
        self._command = Command(CHANGE_SPEED, f"speed {speed:g} m/s", (1.0, speed, -1.0))
        self._system = system
        self._tries = 0
        self._due = 0.0
        self.done = False
        self.taken = False

    def __repr__(self) -> str:
        return f"SpeedErrand({self._command.what}, tries={self._tries}, taken={self.taken})"

    def step(self, now: float, received: list[Message]) -> list[Message]:
        for message in received:
            if message.get_type() == "COMMAND_ACK" and message.command == CHANGE_SPEED:
                self.done, self.taken = True, message.result == mavlink.MAV_RESULT_ACCEPTED
        if self.done or now < self._due:
            return []
        if self._tries >= TRIES:
            self.done = True
            return []
        self._tries, self._due = self._tries + 1, now + AGAIN_S
        return [self._command.message(self._system, 1, self._tries - 1)]
