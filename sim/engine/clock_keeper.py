"""What the process shell does about clocks, in virtual time: join with a known clock, ask on, correct it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from agents.machine import ClockTrust, Event, Heard, Stamp
from agents.mission.mission_file import mission_hash
from agents.process.clock_sync import ClockAnswers, ClockState, ClockSync
from agents.process.shell import FIRST_ANSWER_S, FIRST_ASK_S
from agents.wire.messages import ClockMessage, StartMessage
from agents.wire.topics import CLOCK, START
from sim.engine.node_clock import NodeClock
from sim.engine.nodes import Killed, Life

if TYPE_CHECKING:
    from sim.engine.nodes import Node

START_PERIOD_S = 1.0  # of the fusion's start message


class ClockKeeper:
    """The asker's side of one boot of a process."""

    def __init__(self, node: Node, clock: NodeClock) -> None:
        self.joined = False
        self._node = node
        self._clock = clock
        self._boot = node.boot
        self._stamp = Stamp(node.engine.team.mission.team, node.name, node.boot)
        self._sync: ClockSync | None = None
        self._adopted_at = 0.0

    def __repr__(self) -> str:
        return f"ClockKeeper({self._node.name}, joined={self.joined}, {self._sync!r})"

    def hear(self, events: list[Event]) -> list[Event]:
        """Take what fusions say of the time; a change of trust is an event.

        Raises:
            Killed: if the clock is too far off to join.
        """
        news: list[Event] = []
        for event in events:
            if isinstance(event, Heard) and isinstance(event.message, StartMessage):
                news += self._set(event.message)
        sync, engine = self._sync, self._node.engine
        if self.joined or sync is None:
            return news
        waited = engine.clock.now() - self._adopted_at >= FIRST_ANSWER_S
        if sync.state is not ClockState.UNKNOWN or waited:
            if not sync.trusted:
                engine.events.append(
                    f"{engine.clock.now():8.2f} {self._node.name}: {sync.sentence(self._node.name)}"
                )
                self._node.kill()
                raise Killed
            self._clock.correction.start(sync.correction)
            self.joined = True
        return news

    def _set(self, message: StartMessage) -> list[Event]:
        raw = self._clock.raw()
        if self._sync is None:
            mission = self._node.engine.team.mission
            self._sync = ClockSync(self._node.name, self._node.boot, mission.clock)
            self._adopted_at = self._node.engine.clock.now()
            self._ask()
        sync = self._sync
        before, correction = sync.state, sync.correction
        if not sync.hear(message, raw):
            return []
        if self.joined and sync.correction != correction:
            self._clock.correction.set(sync.correction, raw)
        if before is ClockState.UNKNOWN or (before is ClockState.REFUSED) == (not sync.trusted):
            return []
        return [ClockTrust(sync.trusted)]

    def _ask(self) -> None:
        node, sync = self._node, self._sync
        if sync is None or node.life is Life.OFF or node.boot != self._boot:
            return
        raw = self._clock.raw()
        if node.life is Life.RUNNING and (sync.state is ClockState.UNKNOWN or sync.due(raw)):
            header = self._stamp.header(CLOCK, self._clock.now())
            node.engine.publish(node, CLOCK, ClockMessage(**header, shown=raw))
        node.wake()
        node.engine.after(FIRST_ASK_S, self._ask)


class TimeTeller:
    """The fusion's side."""

    def __init__(self, node: Node, stamp: Stamp) -> None:
        self._node = node
        self._boot = node.boot
        self._stamp = stamp
        self._answers = ClockAnswers()
        node.engine.after(0.0, partial(self._tell, True))

    def __repr__(self) -> str:
        return f"TimeTeller({self._node.name}, {self._answers!r})"

    def hear(self, events: list[Event]) -> None:
        """Answer a process's first question at once, the others with the next start message."""
        now = self._node.clock.now()
        first = [
            self._answers.hear(event.message, now)
            for event in events
            if isinstance(event, Heard) and isinstance(event.message, ClockMessage)
        ]
        if any(first):
            self._tell(False)

    def _tell(self, again: bool) -> None:
        node = self._node
        if node.life is Life.OFF or node.boot != self._boot:
            return
        if node.life is Life.RUNNING:
            mission = node.engine.team.mission
            header = self._stamp.header(START, node.clock.now())
            message = StartMessage(
                **header,
                epoch=0.0,
                speed=1.0,
                seed=node.engine.seed,
                mission_hash=mission_hash(mission),
                answers=self._answers.take(),
            )
            node.engine.publish(node, START, message)
        if again:
            node.engine.after(START_PERIOD_S, partial(self._tell, True))
