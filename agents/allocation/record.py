"""How one robot's part in the allocation looks from outside: what it holds, what is held twice, what changed.

A task is held twice, as far as this robot knows, while it holds it and another's last word says the same of
itself. Between two robots in reach of each other that ends with the next word.
"""

from collections import Counter
from collections.abc import Iterable

import numpy as np

from agents.allocation.others import TeamWords
from agents.machine import Publish, Stamp
from agents.wire.messages import EventMessage
from agents.wire.topics import EVENT
from planner.allocation.cbba import AllocationState
from planner.allocation.slots import task_of

MOST = 1000  # tasks whose former holder is remembered


class Record:
    """Grows by `look`."""

    def __init__(self, robot: str, settled_s: float) -> None:
        """A task that was held for `settled_s` has changed hands; before that robots are still bidding."""
        self.counters: Counter[str] = Counter()
        self.double_owned_s = 0.0  # task-seconds
        self.double_owned_max_s = 0.0  # of one task
        self.tasks_owned = 0
        self._robot = robot
        self._settled = settled_s
        self._at = np.inf
        self._double: dict[str, float] = {}  # slots held twice, and since when
        self._own: frozenset[str] = frozenset()
        self._holder: dict[str, str] = {}  # the other robot that last held a slot
        self._gained: dict[str, tuple[float, str]] = {}  # own slots of others before, since when, and whose
        self._texts: list[str] = []

    def __repr__(self) -> str:
        return f"Record({self._robot}, owned={self.tasks_owned}, double={self.double_owned_s:.3f} s)"

    def gauges(self) -> dict[str, float]:
        """For health."""
        return {
            "tasks_owned": float(self.tasks_owned),
            "double_owned_s": self.double_owned_s,
            "double_owned_max_s": self.double_owned_max_s,
        }

    def done(self, requests: Iterable[str]) -> None:
        """Requests are done by this robot's last look; it alone tells of it."""
        for name in requests:
            self.counters["requests_done"] += 1
            self._texts.append(f"{name} is done")

    def look(self, now: float, state: AllocationState, team: TeamWords) -> list[str]:
        """Take note of how things stand; answer what people may want to read."""
        claims = team.claims()
        own = frozenset(state.bundle)
        self.double_owned_s += len(self._double) * max(0.0, now - self._at)
        self._at = now
        longest = max((now - since for since in self._double.values()), default=0.0)
        self.double_owned_max_s = max(self.double_owned_max_s, longest)
        twice = {slot for theirs in claims.values() for slot in theirs & own}
        self._double = {slot: self._double.get(slot, now) for slot in sorted(twice)}
        self.tasks_owned = len({task_of(slot) for slot in own})
        for slot in own - self._own:
            if slot in self._holder:
                self._gained[slot] = (now, self._holder.pop(slot))
        for robot, theirs in claims.items():
            self._holder |= dict.fromkeys(sorted(theirs - own), robot)
        self._holder = dict(list(self._holder.items())[-MOST:])
        self._gained = {slot: gain for slot, gain in self._gained.items() if slot in own}
        self._own = own
        return self._news(now, state, team)

    def next_news(self) -> float:
        """When `look` will have something to tell."""
        return min((since for since, _ in self._gained.values()), default=np.inf) + self._settled

    def event(self, stamp: Stamp, now: float, text: str) -> Publish:
        """A piece of news as a message."""
        return Publish(EVENT, EventMessage(**stamp.header(EVENT, now), level="info", text=text))

    def _news(self, now: float, state: AllocationState, team: TeamWords) -> list[str]:
        """Of what changed hands between the living people are told only what is begun now; all is counted."""
        texts, self._texts = self._texts, []
        settled = {s: gain for s, gain in self._gained.items() if now >= gain[0] + self._settled}
        for robot in sorted({robot for _, robot in settled.values()}):
            slots = [slot for slot, (_, former) in settled.items() if former == robot]
            gone = not team.here(robot)
            self.counters["tasks_taken_over" if gone else "tasks_handed_over"] += len(slots)
            told = sorted({task_of(slot) for slot in slots if gone or slot in state.path[:1]})
            if told:
                texts.append(f"takes over {', '.join(told)} from {robot}{', which is gone' if gone else ''}")
        self._gained = {slot: gain for slot, gain in self._gained.items() if slot not in settled}
        return texts
