"""Commands that are asked until they are answered, and their answers in words.

An acknowledgement says that a command was understood, not that it is done: who asks must look at the vehicle.
"""

from collections import deque
from dataclasses import dataclass

from bridges.mavlink.dialect import Message, mavlink

TRIES = 5
PATIENCE = 0.6  # s for an answer
BUSY_PATIENCE = 5.0  # s for the next word after IN_PROGRESS
LONGEST = 60.0  # s for a command in all
SETTLE = 0.25  # s after a refusal in which the text that explains it may still come

WORDS = {
    mavlink.MAV_RESULT_ACCEPTED: "accepted",
    mavlink.MAV_RESULT_TEMPORARILY_REJECTED: "refused for now (busy, or not ready)",
    mavlink.MAV_RESULT_DENIED: "denied (a parameter is invalid)",
    mavlink.MAV_RESULT_UNSUPPORTED: "unknown to this autopilot",
    mavlink.MAV_RESULT_FAILED: "failed",
    mavlink.MAV_RESULT_IN_PROGRESS: "in progress",
    6: "cancelled",
    mavlink.MAV_RESULT_COMMAND_LONG_ONLY: "only taken as COMMAND_LONG",
    mavlink.MAV_RESULT_COMMAND_INT_ONLY: "only taken as COMMAND_INT",
    9: "refused: the coordinate frame is not supported",
    10: "refused: another station is in control",
}


@dataclass(frozen=True, slots=True)
class Command:
    """One command; `place` (latitude and longitude in 1e-7 degrees, altitude) makes it a COMMAND_INT."""

    number: int
    what: str  # for people: "arm", "take off to 10 m"
    parameters: tuple[float, ...] = ()  # up to seven
    place: tuple[int, int, float] | None = None
    frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT

    def message(self, system: int, component: int, confirmation: int) -> Message:
        """On the wire."""
        values = [*self.parameters, *[0.0] * (7 - len(self.parameters))]
        if self.place is None:
            return mavlink.MAVLink_command_long_message(
                system, component, self.number, min(confirmation, 255), *values
            )
        return mavlink.MAVLink_command_int_message(
            system, component, self.frame, self.number, 0, 0, *values[:4], *self.place
        )


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a command ended."""

    command: Command
    result: int | None  # None: never answered
    words: str  # "arm: failed: PreArm: GPS 1: Bad fix"

    @property
    def ok(self) -> bool:
        return self.result == int(mavlink.MAV_RESULT_ACCEPTED)


@dataclass(slots=True)
class _Asked:
    command: Command
    first: float
    due: float
    tries: int = 0
    result: int | None = None  # a refusal that waits for its text
    extra: int = 0


class Commands:
    """Asks up to `width` different commands at a time; of one number, one after the other."""

    def __init__(self, system: int, component: int = 1, width: int = 4) -> None:
        self.system = system
        self.component = component
        self._width = width
        self._waiting: deque[Command] = deque()
        self._asked: dict[int, _Asked] = {}
        self.resent = 0
        self.stray = 0  # answers to what nobody asked

    def __repr__(self) -> str:
        names = [asked.command.what for asked in self._asked.values()]
        return f"Commands(asked={names}, waiting={len(self._waiting)}, resent={self.resent})"

    @property
    def busy(self) -> bool:
        return bool(self._waiting or self._asked)

    def pending(self, number: int) -> bool:
        """Whether a command of this number is asked or waits to be."""
        return number in self._asked or any(command.number == number for command in self._waiting)

    def ask(self, command: Command, urgent: bool = False) -> None:
        """Queue a command; an urgent one is asked before all that wait."""
        if urgent:
            self._waiting.appendleft(command)
        else:
            self._waiting.append(command)

    def forget(self) -> None:
        """Ask nothing any more."""
        self._waiting.clear()
        self._asked.clear()

    def hear(self, now: float, message: Message, us: tuple[int, int]) -> Outcome | None:
        """Take in a COMMAND_ACK; the outcome, if it settles a command."""
        if message.target_system not in (0, us[0]) or message.target_component not in (0, us[1]):
            return None  # somebody else's
        asked = self._asked.get(message.command)
        if asked is None or asked.result is not None:
            self.stray += 1
            return None
        if message.result == mavlink.MAV_RESULT_IN_PROGRESS:
            asked.due = now + BUSY_PATIENCE
            asked.tries = max(asked.tries, TRIES)  # it has it: asking again would begin anew
            return None
        if message.result == mavlink.MAV_RESULT_ACCEPTED:
            del self._asked[message.command]
            return Outcome(asked.command, message.result, f"{asked.command.what}: accepted")
        asked.result, asked.extra, asked.due = message.result, message.result_param2, now + SETTLE
        return None

    def step(self, now: float, texts: "list[tuple[float, str]]") -> tuple[list[Message], list[Outcome]]:
        """What to send now, and what has ended; `texts` are the autopilot's with their times."""
        out: list[Message] = []
        ended: list[Outcome] = []
        for number, asked in list(self._asked.items()):
            if now < asked.due:
                continue
            if asked.result is None and asked.tries < TRIES and now - asked.first < LONGEST:
                self._send(asked, now, out)
                self.resent += 1
                continue
            del self._asked[number]
            ended.append(Outcome(asked.command, asked.result, _words(asked, texts)))
        for command in list(self._waiting):
            if len(self._asked) >= self._width:
                break
            if command.number not in self._asked:
                self._waiting.remove(command)
                self._asked[command.number] = fresh = _Asked(command, now, now)
                self._send(fresh, now, out)
        return out, ended

    def _send(self, asked: _Asked, now: float, out: list[Message]) -> None:
        out.append(asked.command.message(self.system, self.component, asked.tries))
        asked.tries += 1
        asked.due = now + PATIENCE


def _words(asked: _Asked, texts: list[tuple[float, str]]) -> str:
    what = asked.command.what
    if asked.result is None:
        return f"{what}: no answer after {asked.tries} tries"
    words = WORDS.get(asked.result, f"refused with result {asked.result}")
    if asked.extra:
        words += f" ({asked.extra})"
    said = [text for time, text in texts if time >= asked.first - 0.1]
    return f"{what}: {words}" + (f": {'; '.join(dict.fromkeys(said))}" if said else "")
