"""Reliable topics as the Zenoh transport carries them: numbered and cached by the publisher, fetched again.

A publisher keeps its last messages of a topic. A receiver that sees a gap, from the next message or from the
heartbeat, asks for what is missing; what came after the gap waits for the answer, so that the order holds.
The same cache answers those who join late, and those who were cut off. What it does not hold any more is
missed, and counted. See bridges.zenoh.transport.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from agents.wire.topics import Topic
from agents.wire.transport import Received

if TYPE_CHECKING:
    from sim.network.transport import SimulatedTransport


class Outlet:
    """One publisher's end of one topic."""

    __slots__ = ("born", "cache", "owner", "sent", "topic")

    def __init__(self, owner: SimulatedTransport, topic: Topic, now: float) -> None:
        self.owner = owner
        self.topic = topic
        self.born = now  # heartbeats count from here
        self.sent = 0
        self.cache: deque[tuple[int, Received]] = deque(maxlen=max(1, topic.history))

    def add(self, item: Received) -> int:
        """The number of the next message."""
        number = self.sent
        self.sent += 1
        self.cache.append((number, item))
        return number


class Inlet:
    """One receiver's end of one outlet."""

    __slots__ = ("asking", "last", "missed", "pending", "troubled", "unheard")

    def __init__(self, last: int) -> None:
        self.last = last  # the newest number that was handed on; all before it were too, or are missed
        self.pending: dict[int, Received] = {}  # came after a gap
        self.asking = False  # a question to the cache is underway
        self.unheard = False  # and did not get there
        self.troubled = False  # something was lost: gaps are to be looked for at once
        self.missed = 0

    def arrive(self, number: int, item: Received) -> list[Received]:
        """What can be handed on now that a message came; nothing, if it came before."""
        if number <= self.last:
            return []
        self.pending[number] = item
        return self._in_order()

    def answered(self, cached: list[tuple[int, Received]]) -> list[Received]:
        """The cache's answer came: all that it holds is handed on, and what it does not hold is missed."""
        self.asking = self.unheard = False
        for number, item in cached:
            if number > self.last:
                self.pending.setdefault(number, item)
        handed = []
        for number in sorted(self.pending):
            self.missed += number - self.last - 1
            self.last = number
            handed.append(self.pending[number])
        self.pending.clear()
        self.troubled = False
        return handed

    def _in_order(self) -> list[Received]:
        handed = []
        while self.last + 1 in self.pending and not self.asking:
            self.last += 1
            handed.append(self.pending.pop(self.last))
        return handed
