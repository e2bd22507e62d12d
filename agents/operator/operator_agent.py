"""The operator's end of a statement: say it, offer it until the fusion has it, hear what became of it.

A state machine like the Robot, for the command `observe` and for scripted statements in virtual time.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count

from agents.machine import Action, Event, Heard, Publish, Stamp
from agents.mission.mission import Mission
from agents.operator.statements import Said
from agents.robot.unacknowledged import Unacknowledged
from agents.wire.messages import EventMessage, PosteriorMessage, SoftObservationMessage
from agents.wire.topics import SOFT_OBSERVATION


@dataclass(frozen=True, slots=True)
class Answer:
    """What the fusion said of a statement."""

    taken: bool  # false: refused, or it changes nothing
    text: str


class Operator:
    """Says planned statements at their times."""

    def __init__(self, mission: Mission, id: str, boot: str, *, patience: float = 1.0) -> None:
        """`patience` is how many times longer to wait for an acknowledgement: team time may run fast."""
        self.id = id
        self.stamp = Stamp(mission.team, id, boot)
        self.answers: dict[int, Answer] = {}  # by sequence
        self._waiting: Unacknowledged[SoftObservationMessage] = Unacknowledged(
            boot, mission.settings.reoffer_after_s * max(1.0, patience)
        )
        self._planned: list[tuple[float, int, Said]] = []
        self._order = count()

    def __repr__(self) -> str:
        return f"Operator({self.id}, planned={len(self._planned)}, waiting={self.waiting})"

    @property
    def waiting(self) -> int:
        """Statements that were said and that neither a watermark covers nor the fusion refused."""
        return len(self._waiting)

    @property
    def planned(self) -> int:
        """Statements that are still to be said."""
        return len(self._planned)

    def plan(self, time: float, said: Said) -> None:
        """Say this at a team time, or at the next step if that is over."""
        heapq.heappush(self._planned, (time, next(self._order), said))

    def next_wake(self) -> float:
        """The team time at which `step` must be called even if nothing happens."""
        first = self._planned[0][0] if self._planned else float("inf")
        return min(first, self._waiting.next_offer())

    def step(self, now: float, events: Sequence[Event]) -> list[Action]:
        """Take in what happened up to `now`; answer what to publish."""
        for event in events:
            if isinstance(event, Heard):
                self._hear(event.message)
        actions: list[Action] = [Publish(SOFT_OBSERVATION, m) for m in self._waiting.due(now)]
        while self._planned and self._planned[0][0] <= now:
            time, _, said = heapq.heappop(self._planned)
            message = SoftObservationMessage(**self.stamp.header(SOFT_OBSERVATION, time), **said)
            self._waiting.add(message)
            actions.append(Publish(SOFT_OBSERVATION, message))
        return actions

    def _hear(self, message: object) -> None:
        if isinstance(message, PosteriorMessage):
            self._waiting.acknowledge(self.id, message)
        elif isinstance(message, EventMessage):
            stream, _, sequence = message.about.rpartition("/")
            if stream == f"{self.id}/{self.stamp.boot}" and sequence.isdigit():
                self.answers.setdefault(int(sequence), Answer(message.level == "info", message.text))
                if message.level != "info":
                    self._waiting.drop(int(sequence))
