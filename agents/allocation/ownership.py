"""Who held which task when, as robots said it themselves, for an observer who hears all their words.

A robot holds a task from the word in which it first says so to the one in which it no longer does. If it
falls silent it has held it until its last word: of what a dead robot believed nobody knows.
"""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from agents.wire.messages import BidMessage

SILENT_S = 2.0  # a robot's words come at least this often, or it was gone meanwhile


@dataclass(frozen=True, slots=True)
class Holding:
    """One robot held one task, or one part of a task for several robots."""

    slot: str
    robot: str
    start: float  # seconds, of the observer's clock
    end: float
    silent: bool  # it ended because the robot fell silent


class Ownership:
    """Grows by `hear`."""

    def __init__(self, silent_s: float = SILENT_S) -> None:
        self._silent = silent_s
        self._since: dict[str, dict[str, float]] = {}  # robot -> slot -> when it was first said
        self._spoke: dict[str, float] = {}
        self._ended: list[Holding] = []

    def __repr__(self) -> str:
        return f"Ownership({ {robot: sorted(slots) for robot, slots in self._since.items()} })"

    def hear(self, message: BidMessage, now: float) -> None:
        """A robot's word, heard at `now`; calls come with growing times."""
        robot = message.sender
        said = {slot for slot, winner in message.winning_agents.items() if winner == robot}
        held, last = self._since.setdefault(robot, {}), self._spoke.get(robot, now)
        silent = now - last > self._silent
        for slot in sorted(held.keys() if silent else held.keys() - said):
            self._ended.append(Holding(slot, robot, held.pop(slot), last if silent else now, silent))
        for slot in sorted(said):
            held.setdefault(slot, now)
        self._spoke[robot] = now

    def holdings(self, now: float) -> list[Holding]:
        """All that was held up to `now`, by start."""
        open_ones = [
            Holding(slot, robot, since, last if silent else now, silent)
            for robot, held in self._since.items()
            for last in (self._spoke[robot],)
            for silent in (now - last > self._silent,)
            for slot, since in held.items()
        ]
        return sorted([*self._ended, *open_ones], key=lambda h: (h.start, h.slot, h.robot))

    def summary(self, now: float) -> dict[str, Any] | None:
        """For summary.json; None where no robot ever bid. Its keys are documented in docs/summary.md."""
        if not self._spoke:
            return None
        by_slot: dict[str, list[Holding]] = defaultdict(list)
        for holding in self.holdings(now):
            by_slot[holding.slot].append(holding)
        changes = [change for some in by_slot.values() for change in _changes(some)]
        taken = [gap for gap, silent in changes if silent]
        twice = [spell for some in by_slot.values() for spell in _twice(some)]
        return {
            "held": len(by_slot),
            "handed_over": len(changes) - len(taken),
            "taken_over": len(taken),
            "takeover_max_s": max(taken, default=None),
            "double_owned_s": sum(twice),
            "double_owned_max_s": max(twice, default=0.0),
        }


def _changes(holdings: list[Holding]) -> Iterable[tuple[float, bool]]:
    """For each time that one task came to another robot: how long nobody held it, and whether by silence."""
    for before, after in pairwise(holdings):
        if before.robot != after.robot:
            yield max(0.0, after.start - before.end), before.silent


def _twice(holdings: list[Holding]) -> Iterable[float]:
    """The lengths of the spells in which two robots or more held one task."""
    edges = sorted(
        [(h.start, 1) for h in holdings] + [(h.end, -1) for h in holdings], key=lambda e: (e[0], e[1])
    )
    count, since = 0, 0.0
    for time, step in edges:
        if count == 1 and step == 1:
            since = time
        if count == 2 and step == -1:
            yield time - since
        count += step
