"""Team time: seconds since the team's start, the same in every process.

Capture times are read here at the measurement and travel in the message; no other clock is used for
estimation. A scaled clock makes a team of processes run faster or slower than the wall.
"""

import asyncio
import time
from abc import ABC, abstractmethod


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
        self._monotonic_epoch = epoch - (time.time() - time.monotonic())

    def __repr__(self) -> str:
        return f"TeamClock(epoch={self.epoch:.3f}, speed={self.speed:g}, now={self.now():.3f})"

    def now(self) -> float:
        return (time.monotonic() - self._monotonic_epoch) * self.speed

    async def sleep_until(self, team_time: float) -> None:
        await asyncio.sleep(max(0.0, (team_time - self.now()) / self.speed))


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
