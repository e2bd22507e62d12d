"""Keep a process's clock at the team's: who asks, who answers, and what is done with what was learnt.

The fusion's clock is the team's. Every other process asks it about once a second what time it is (topic
`clock`), and the fusion's start message brings the answers. Both sides are state machines that the process
shell and the virtual-time engine drive alike; what they say of a clock is a correction that
`clock.Correction` carries out.

A clock is left alone while nothing shows that it is wrong, so on one machine nothing is ever corrected. What
is off by more than the mission's limit is refused, not corrected: something else is wrong then.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from agents.mission.mission import ClockTable
from agents.process.clock_offset import ClockOffset, Exchange
from agents.wire.messages import Array, ClockMessage, StartMessage

ANSWERS = 1000  # in one start message: more askers than that are no team
SILENT_PERIODS = 5.0  # a fusion that has not answered for this many periods gives way to another


class ClockState(Enum):
    """What is known of a process's clock."""

    UNKNOWN = "unknown"  # no answer yet
    RIGHT = "right"  # nothing shows that it is wrong
    CORRECTED = "corrected"
    REFUSED = "refused"  # off by more than the mission allows


@dataclass
class _Reference:
    offset: ClockOffset
    heard: float


class ClockSync:
    """The asker's side. Times are of its own uncorrected clock, team seconds; `speed` of them in a second."""

    def __init__(self, name: str, boot: str, table: ClockTable, speed: float = 1.0) -> None:
        self.correction = 0.0  # to be added to the clock, team seconds
        self.state = ClockState.UNKNOWN
        self._key = f"{name}/{boot}"
        self._table = table
        self._speed = speed
        self._period = table.ask_every_s * speed
        self._ask_at = -np.inf
        self._references: dict[str, _Reference] = {}
        self._bounds: tuple[float, float] | None = None
        self._width = np.inf  # of the bounds when the correction was last set

    def __repr__(self) -> str:
        return f"ClockSync({self._key}, {self.state.value}, correction={self.correction:.6f})"

    @property
    def next_ask(self) -> float:
        """When the next question is due."""
        return self._ask_at

    @property
    def offset(self) -> float | None:
        """What the team's clock shows more than this one, team seconds; None if unknown."""
        return None if self._bounds is None else 0.5 * (self._bounds[0] + self._bounds[1])

    @property
    def trusted(self) -> bool:
        """Whether capture times may be taken from the corrected clock."""
        return self.state is not ClockState.REFUSED

    def due(self, now: float) -> bool:
        """Whether to ask now; the next question is then due a period later."""
        if now < self._ask_at:
            return False
        self._ask_at = now + self._period
        return True

    def hear(self, message: StartMessage, now: float) -> bool:
        """A fusion's start message, heard at `now`; whether it answered a question of this process."""
        answer = message.answers.get(self._key)
        if answer is None:
            return False
        known = self._references.setdefault(
            message.sender, _Reference(ClockOffset(self._table.drift_ppm * 1e-6), now)
        )
        asked, received = float(answer[0]), float(answer[1])
        if not known.offset.add(Exchange(asked, received, message.time, now)):
            return False
        known.heard = now
        self._decide(now)
        return True

    def gauges(self, now: float) -> dict[str, float]:
        """For health: the offset and how far it may be from the truth, what is corrected; ms of wall time."""
        if self._bounds is None:
            return {}
        low, high = self._bounds
        scale = 1e3 / self._speed
        return {
            "clock_offset_ms": 0.5 * (low + high) * scale,
            "clock_error_ms": 0.5 * (high - low) * scale,
            "clock_corrected_ms": self.correction * scale,
            "clock_age_s": (now - max(r.heard for r in self._references.values())) / self._speed,
        }

    def sentence(self, name: str) -> str:
        """What a person must do about a refused clock."""
        off = (self.offset or 0.0) / self._speed
        return (
            f"the clock of {name} is {abs(off):.3f} s {'behind' if off > 0 else 'ahead of'} the team's, and "
            f"clock.correct_up_to_s is {self._table.correct_up_to_s:g}: set it, best by NTP, and start again"
        )

    def _decide(self, now: float) -> None:
        alive = SILENT_PERIODS * self._period
        # Of several fusions that answer, all follow the same one, though each hears others at other times.
        name = min(name for name, ref in self._references.items() if now - ref.heard <= alive)
        bounds = self._references[name].offset.bounds(now)
        assert bounds is not None
        self._bounds = low, high = bounds
        limit = self._table.correct_up_to_s * self._speed
        if low > limit or high < -limit:
            self.state = ClockState.REFUSED
            return
        wrong = not low <= self.correction <= high
        if wrong or (self.correction != 0.0 and high - low < 0.5 * self._width):
            self.correction, self._width = 0.5 * (low + high), high - low
        self.state = ClockState.RIGHT if self.correction == 0.0 else ClockState.CORRECTED


class ClockAnswers:
    """The fusion's side: collects questions until the next start message."""

    def __init__(self) -> None:
        self._asked: dict[str, tuple[float, float]] = {}
        self._known: set[str] = set()
        self.refused = 0

    def __repr__(self) -> str:
        return f"ClockAnswers(waiting={len(self._asked)}, known={len(self._known)})"

    def hear(self, message: ClockMessage, now: float) -> bool:
        """A question that came at `now`; whether it is the asker's first, which better waits for nothing."""
        key = f"{message.sender}/{message.boot}"
        if key not in self._asked and len(self._asked) >= ANSWERS:
            self.refused += 1
            return False
        self._asked[key] = (message.shown, now)
        if key in self._known or len(self._known) >= ANSWERS:
            return False
        self._known.add(key)
        return True

    def take(self) -> dict[str, Array]:
        """The answers for the start message that is sent now."""
        asked, self._asked = self._asked, {}
        return {key: np.array(times) for key, times in asked.items()}
