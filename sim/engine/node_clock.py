"""The clock of one simulated computer: it may be off, run apart and be set, as real ones do."""

from collections.abc import Callable
from dataclasses import dataclass

from agents.clock import Clock, Correction


@dataclass
class Computer:
    """What a computer's clock shows. Processes read its time of day when they start and never again."""

    offset: float = 0.0  # of its time of day, s; may be set while it runs
    drift: float = 0.0  # seconds that it gains per second


class NodeClock(Clock):
    """Team time as one process on a computer sees it.

    `raw` is what the computer says, `now` what the process makes of it (see agents.clock). Setting the time
    of day moves nothing in a process that runs: it goes by the monotonic clock.
    """

    def __init__(self, computer: Computer, true_time: Callable[[], float]) -> None:
        self.correction = Correction()
        self._true = true_time
        self._drift = computer.drift
        born = true_time()
        self._offset = computer.offset + computer.drift * born
        self._born = born

    def __repr__(self) -> str:
        return f"NodeClock(now={self.now():.3f}, off by {self.now() - self._true():+.3f})"

    def raw(self) -> float:
        """What the computer says team time is."""
        true = self._true()
        return true + self._offset + self._drift * (true - self._born)

    def now(self) -> float:
        return self.correction.team(self.raw())

    def delay_until(self, team_time: float) -> float:
        """True seconds until this clock shows a time; 0 when it has passed."""
        return self.correction.wait(team_time, self.raw()) / (1.0 + self._drift)

    async def sleep_until(self, team_time: float) -> None:
        raise RuntimeError("virtual time is moved by its engine; nothing sleeps in it")
