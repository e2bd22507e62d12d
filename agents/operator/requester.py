"""The operator's end of a request: ask, ask again until a robot passes it on, and hear who takes it.

A state machine like the Robot, for the command `request` and for scripted requests in virtual time. Nothing
acknowledges a request: it shows in the robots' bids, with who holds it and who has looked.
"""

import heapq
from collections.abc import Sequence
from itertools import count

from agents.allocation.requests import PREFIX
from agents.machine import Action, Event, Heard, Publish, Stamp
from agents.mission.mission import Mission, RequestTable
from agents.wire.messages import BidMessage, RequestMessage, Wish
from agents.wire.topics import REQUEST
from planner.allocation.slots import task_of

AGAIN_S = 0.5  # between two times of asking, until a robot passes it on


def wish(table: RequestTable, asked: float) -> Wish:
    """What a mission's or a command's table asks for, at a team time."""
    return Wish(
        name=PREFIX + table.name,
        place=list(table.at),
        worth=table.worth,
        robots=table.robots,
        needs=list(table.needs),
        asked=asked,
    )


class Requester:
    """Asks planned requests at their times."""

    def __init__(self, mission: Mission, id: str, boot: str, *, patience: float = 1.0) -> None:
        """`patience` is how many times longer to wait before asking again: team time may run fast."""
        self.id = id
        self.stamp = Stamp(mission.team, id, boot)
        self.known: dict[str, set[str]] = {}  # request -> robots that pass it on
        self.holders: dict[str, set[str]] = {}  # request -> robots that hold it or part of it
        self.looked: dict[str, set[str]] = {}  # request -> robots that have looked
        self._again = AGAIN_S * max(1.0, patience)
        self._planned: list[tuple[float, int, RequestTable]] = []
        self._order = count()
        self._asking: dict[str, tuple[Wish, float]] = {}  # and when to ask again

    def __repr__(self) -> str:
        return f"Requester({self.id}, planned={len(self._planned)}, asking={sorted(self._asking)})"

    def plan(self, time: float, table: RequestTable) -> None:
        """Ask this at a team time, or at the next step if that is over."""
        heapq.heappush(self._planned, (time, next(self._order), table))

    def next_wake(self) -> float:
        """The team time at which `step` must be called even if nothing happens."""
        first = self._planned[0][0] if self._planned else float("inf")
        return min([first, *(again for _, again in self._asking.values())])

    def step(self, now: float, events: Sequence[Event]) -> list[Action]:
        """Take in what happened up to `now`; answer what to publish."""
        for event in events:
            if isinstance(event, Heard) and isinstance(event.message, BidMessage):
                self._hear(event.message)
        while self._planned and self._planned[0][0] <= now:
            _, _, table = heapq.heappop(self._planned)
            asked = wish(table, now)
            self._asking[asked.name] = (asked, now)
            self.known[asked.name], self.holders[asked.name], self.looked[asked.name] = set(), set(), set()
        actions: list[Action] = []
        for name, (asked, again) in self._asking.items():
            if now >= again:
                self._asking[name] = (asked, now + self._again)
                header = self.stamp.header(REQUEST, now)
                actions.append(Publish(REQUEST, RequestMessage(**header, wish=asked)))
        return actions

    def _hear(self, message: BidMessage) -> None:
        passed_on = {w.name: w for w in message.wishes}
        for name in self.known:
            theirs = passed_on.get(name)
            asked = self._asking.get(name)
            if theirs is None or (asked is not None and theirs.asked < asked[0].asked):
                continue
            self._asking.pop(name, None)
            self.known[name].add(message.sender)
            self.looked[name] |= set(theirs.looked)
        for name, holders in self.holders.items():
            held = any(task_of(s) == name and z == message.sender for s, z in message.winning_agents.items())
            (holders.add if held else holders.discard)(message.sender)
