"""Team time: seconds since the team's start, the same in every process.

Capture times are read here at the measurement and travel in the message; no other clock is used for
estimation. A scaled clock makes a team of processes run faster or slower than the wall.
"""

import asyncio
import time
from abc import ABC, abstractmethod

SAME_S = 1e-3  # starts of a team that differ by less are one


class Correction:
    """Added to a clock that is off, so that what it shows is team time, without ever going back.

    A clock that is behind is put forward at once; one that is ahead shows half as much time as passes until
    it is right. `raw` is what the clock itself shows.
    """

    def __init__(self) -> None:
        self._offset = 0.0
        self._ahead = 0.0  # at raw time `_since`, still to be lost
        self._since = 0.0

    def __repr__(self) -> str:
        return f"Correction({self._offset:+.6f}, ahead={self._ahead:.6f})"

    def start(self, offset: float) -> None:
        """Begin with this offset, before anybody has looked at the clock."""
        self._offset, self._ahead = offset, 0.0

    def set(self, offset: float, raw: float) -> None:
        """From now on the clock shows `raw + offset`, or soon does."""
        shown = self.team(raw)
        self._offset, self._ahead, self._since = offset, max(0.0, shown - raw - offset), raw

    def team(self, raw: float) -> float:
        """Team time when the clock shows `raw`."""
        return raw + self._offset + self._still_ahead(raw)

    def wait(self, team: float, raw: float) -> float:
        """How much later than `raw` the clock will show when it is `team`; 0 when that has passed."""
        missing = team - self.team(raw)
        return max(0.0, missing + min(missing, self._still_ahead(raw)))

    def _still_ahead(self, raw: float) -> float:
        return max(0.0, self._ahead - 0.5 * (raw - self._since)) if self._ahead else 0.0


class Clock(ABC):
    """What a driver needs to know of time."""

    speed: float = 1.0  # team seconds per wall second

    @abstractmethod
    def now(self) -> float:
        """Team time in seconds."""

    @abstractmethod
    async def sleep_until(self, team_time: float) -> None:
        """Return at `team_time`, at once when it has passed."""


class TeamClock(Clock):
    """Team time of real processes: `speed` times the wall time since `epoch` (Unix seconds).

    The offset between the wall and the monotonic clock is read once, so a later step of the system's
    clock does not move team time.
    """

    def __init__(self, epoch: float, speed: float = 1.0) -> None:
        self.epoch = epoch
        self.speed = speed
        self.correction = Correction()
        self._monotonic_epoch = epoch - (time.time() - time.monotonic())

    def __repr__(self) -> str:
        return f"TeamClock(epoch={self.epoch:.3f}, speed={self.speed:g}, now={self.now():.3f})"

    def later_than(self, epoch: float) -> float:
        """By how many seconds this clock's start was after another one; 0 if it is that one, or earlier."""
        after = self.epoch - epoch
        return after if after > SAME_S else 0.0

    def raw(self) -> float:
        """What this machine's clock says team time is, uncorrected."""
        return (time.monotonic() - self._monotonic_epoch) * self.speed

    def now(self) -> float:
        return self.correction.team(self.raw())

    def delay_until(self, team_time: float) -> float:
        """Wall seconds until then; 0 when it has passed."""
        return self.correction.wait(team_time, self.raw()) / self.speed

    async def sleep_until(self, team_time: float) -> None:
        await asyncio.sleep(self.delay_until(team_time))


class VirtualClock(Clock):
    """Time that stands still until the virtual-time engine moves it."""

    def __init__(self) -> None:
        self._now = 0.0

    def now(self) -> float:
        return self._now

    def advance_to(self, team_time: float) -> None:
        """Move time forward; going back is a defect of the engine."""
        if team_time < self._now:
            raise ValueError(f"time would go back from {self._now} to {team_time}")
        self._now = team_time

    async def sleep_until(self, team_time: float) -> None:
        raise RuntimeError("virtual time is moved by its engine; nothing sleeps in it")
