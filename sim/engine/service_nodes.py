"""The simulated processes that are no robots: fusion, operator, viewer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.fusion.fusion import Fusion, FusionSetup
from agents.health.health import health_message
from agents.machine import Event, Publish, Stamp
from agents.operator.operator_agent import Operator
from agents.operator.requester import Requester
from agents.operator.statements import said
from agents.wire.messages import HealthMessage, PosteriorMessage
from agents.wire.topics import (
    BID,
    CLOCK,
    EVENT,
    HEALTH,
    LEDGER,
    PICTURE,
    PLAN,
    POSE,
    POSTERIOR,
    RELAY,
    SET,
    SOFT_OBSERVATION,
    TRUTH,
)
from sim.engine.clock_keeper import TimeTeller
from sim.engine.nodes import Node

if TYPE_CHECKING:
    from sim.engine.engine import Engine


class FusionNode(Node):
    """A fusion process. Its ledger is the engine's: it outlives the process."""

    def __init__(self, engine: Engine, name: str = "fusion") -> None:
        super().__init__(engine, "fusion", name)

    def _begin(self) -> None:
        engine, team = self.engine, self.engine.team
        ledger = engine.ledgers[self.name]
        setup = FusionSetup(team.mission, self.name, self.boot, team.search(), team.sensor_models, ledger)
        self.fusion = Fusion(setup, engine.seed)
        self.fusion.restore()
        self._teller = TimeTeller(self, self.fusion.stamp) if engine.clocks else None

    def _subscribe(self) -> None:
        if self.engine.clocks:
            self.transport.subscribe(CLOCK)
        for topic in (SET, SOFT_OBSERVATION):
            self.transport.subscribe(topic)
        for topic in (LEDGER, RELAY):
            self.transport.subscribe(topic, urgent=False)

    def step(self, events: list[Event]) -> None:
        now = self.clock.now()
        if self._teller is not None:
            self._teller.hear(events)
        for action in self.fusion.step(now, events):
            if isinstance(action, Publish) and isinstance(action.message, PosteriorMessage) and events:
                self.engine.capture_to_posterior_ms.add((now - action.message.time) * 1e3)
            self.engine.perform(self, action)

    def next_wake(self) -> float:
        return self.fusion.next_wake()

    def health(self) -> HealthMessage:
        return health_message(
            self.fusion.stamp,
            self.clock.now(),
            "fusion",
            "running",
            self.mailbox,
            self.transport.statistics(),
            self.fusion.counters,
            {},
            {"capture_to_posterior_ms": self.engine.capture_to_posterior_ms},
        )


class OperatorNode(Node):
    """Somebody who says what the mission's statements tell and asks for its requests, each at its time."""

    def __init__(self, engine: Engine) -> None:
        super().__init__(engine, "operator", "operator")

    def _begin(self) -> None:
        mission = self.engine.team.mission
        self.operator = Operator(mission, "operator", self.boot)
        for table in mission.statements:
            self.operator.plan(table.at_s, said(table))
        self.requester = Requester(mission, "operator", self.boot)
        self.requester.stamp = self.operator.stamp
        for request in mission.requests:
            self.requester.plan(request.at_s, request)

    def _subscribe(self) -> None:
        for topic in (POSTERIOR, EVENT, BID):
            self.transport.subscribe(topic, urgent=False)

    def step(self, events: list[Event]) -> None:
        now = self.clock.now()
        for action in [*self.operator.step(now, events), *self.requester.step(now, events)]:
            self.engine.perform(self, action)

    def next_wake(self) -> float:
        return min(self.operator.next_wake(), self.requester.next_wake())

    def health(self) -> HealthMessage:
        return health_message(
            self.operator.stamp,
            self.clock.now(),
            "operator",
            "speaking",
            self.mailbox,
            self.transport.statistics(),
            {"soft_observations": self.operator.stamp.sent(SOFT_OBSERVATION)},
            {},
            {},
        )


class ViewerNode(Node):
    """Somebody who wants to hear everything and says nothing; there to be slow, frozen or dead."""

    PERIOD_S = 0.25

    def __init__(self, engine: Engine) -> None:
        super().__init__(engine, "watch", "watch")

    def _begin(self) -> None:
        self._look_at = self.clock.now()

    def _subscribe(self) -> None:
        for topic in (POSE, SET, PLAN, POSTERIOR, PICTURE, EVENT, HEALTH, TRUTH):
            self.transport.subscribe(topic, urgent=False)

    def step(self, events: list[Event]) -> None:
        self._look_at = self.clock.now() + self.PERIOD_S

    def next_wake(self) -> float:
        return self._look_at

    def health(self) -> HealthMessage:
        stamp = Stamp(self.engine.team.mission.team, self.name, self.boot)
        link = self.transport.statistics()
        return health_message(stamp, self.clock.now(), "watch", "showing", self.mailbox, link, {}, {}, {})
