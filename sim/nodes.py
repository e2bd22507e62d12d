"""Simulated processes: an agent, its end of the network, its mailbox, and when it must be woken."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from agents.body import RobotBody
from agents.fusion import Fusion, FusionSetup
from agents.health import health_message
from agents.histogram import Histogram
from agents.machine import Action, Event, Publish
from agents.mailbox import Mailbox
from agents.messages import HealthMessage, PosteriorMessage
from agents.operator_agent import Operator
from agents.plan_request import RobotSetup
from agents.robot import Robot
from agents.statements import said
from agents.topics import EVENT, PICTURE, PLAN, POSE, POSTERIOR, SET, SOFT_OBSERVATION
from agents.transport import Peer, PeerChange
from sim.network import SimulatedTransport

if TYPE_CHECKING:
    from sim.engine import Engine

BOOT = "b0"  # in virtual time a boot's name is no surprise


class Node(ABC):
    """What all simulated processes share."""

    def __init__(self, engine: Engine, role: str, name: str) -> None:
        self.name = name
        self.engine = engine
        self.transport = SimulatedTransport(engine.network)
        self.mailbox = Mailbox(
            engine.team.mission.team, lambda text: engine.events.append(f"{name}: {text}"), engine.decode
        )
        self.peers: list[PeerChange] = []
        self._told: list[Event] = []
        self._wake_at = float("inf")
        self._subscribe()
        self.transport.open(Peer(role, name, BOOT), self.wake)

    def wake(self) -> None:
        """Step as soon as everything that happens at this time has happened."""
        self._schedule(self.engine.clock.now())

    def tell(self, event: Event) -> None:
        """Hand the agent an event."""
        self._told.append(event)
        self.wake()

    def _schedule(self, time: float) -> None:
        now = self.engine.clock.now()
        if self._wake_at <= time and self._wake_at >= now:
            return
        self._wake_at = time
        self.engine.after(max(0.0, time - now), lambda: self._run(time))

    def _run(self, due: float) -> None:
        if due != self._wake_at:
            return  # superseded by an earlier wake
        self._wake_at = float("inf")
        events: list[Event] = [*self.transport.drain_peer_changes()]
        events += self.mailbox.open(self.transport.drain())
        told, self._told = self._told, []
        self.step(events + told)
        self._schedule(max(self.next_wake(), self.engine.clock.now()))

    @abstractmethod
    def _subscribe(self) -> None: ...

    @abstractmethod
    def step(self, events: list[Event]) -> None:
        """Let the agent see the events and carry out its actions."""

    @abstractmethod
    def next_wake(self) -> float:
        """When the agent wants to be woken at the latest."""

    @abstractmethod
    def health(self) -> HealthMessage:
        """As of now."""


class RobotNode(Node):
    """A robot process."""

    def __init__(self, engine: Engine, robot: str) -> None:
        super().__init__(engine, "robot", robot)
        team = engine.team
        vehicle = team.vehicle(robot, engine.seed, engine.world)
        sensor = team.sensor(robot, engine.seed, engine.world)
        setup = RobotSetup(
            mission=team.mission,
            robot=robot,
            boot=BOOT,
            vehicle=team.vehicle_models[robot],
            vehicles=team.vehicle_models,
            sensors=team.sensor_models,
            area=team.area,
            periods=team.measure_periods,
            follows_plans=vehicle.follows_plans,
            first_capture=sensor.next_capture(-1.0),
            stagger_s=0.0 if engine.planning.joint else 0.1,
        )
        self.robot = Robot(setup, 0.0)
        self.body = RobotBody(self.robot, vehicle, sensor, engine.clock, self._perform)

    def _subscribe(self) -> None:
        for topic in (POSE, SET, PICTURE, POSTERIOR):
            self.transport.subscribe(topic, urgent=False)
        self.transport.subscribe(PLAN)

    def _perform(self, action: Action) -> None:
        self.engine.perform(self, action)

    def step(self, events: list[Event]) -> None:
        self.body.step(events)

    def next_wake(self) -> float:
        return self.body.next_wake()

    def health(self) -> HealthMessage:
        robot = self.robot
        return health_message(
            robot.stamp,
            self.engine.clock.now(),
            "robot",
            robot.state,
            self.mailbox,
            self.transport.statistics(),
            {"sets": robot.stamp.sent(SET), "reoffered": robot.unacknowledged.reoffered},
            {},
            {
                "measure_clock_lateness_ms": self.body.lateness_ms,
                # All robots share one plan service here: the first tells for all.
                "plan_ms": self.engine.planning.plan_ms if self is self.engine.robots[0] else Histogram(),
            },
        )


class FusionNode(Node):
    """The fusion process."""

    def __init__(self, engine: Engine) -> None:
        super().__init__(engine, "fusion", "fusion")
        team = engine.team
        self.fusion = Fusion(
            FusionSetup(team.mission, "fusion", BOOT, team.search(), team.sensor_models), engine.seed
        )

    def _subscribe(self) -> None:
        self.transport.subscribe(SET)
        self.transport.subscribe(SOFT_OBSERVATION)

    def step(self, events: list[Event]) -> None:
        now = self.engine.clock.now()
        for action in self.fusion.step(now, events):
            if isinstance(action, Publish) and isinstance(action.message, PosteriorMessage) and events:
                self.engine.capture_to_posterior_ms.add((now - action.message.time) * 1e3)
            self.engine.perform(self, action)

    def next_wake(self) -> float:
        return self.fusion.next_wake()

    def health(self) -> HealthMessage:
        return health_message(
            self.fusion.stamp,
            self.engine.clock.now(),
            "fusion",
            "running",
            self.mailbox,
            self.transport.statistics(),
            self.fusion.counters,
            {},
            {"capture_to_posterior_ms": self.engine.capture_to_posterior_ms},
        )


class OperatorNode(Node):
    """Somebody who says what the mission's statements tell, each at its time."""

    def __init__(self, engine: Engine) -> None:
        super().__init__(engine, "operator", "operator")
        mission = engine.team.mission
        self.operator = Operator(mission, "operator", BOOT)
        for table in mission.statements:
            self.operator.plan(table.at_s, said(table))

    def _subscribe(self) -> None:
        for topic in (POSTERIOR, EVENT):
            self.transport.subscribe(topic, urgent=False)

    def step(self, events: list[Event]) -> None:
        for action in self.operator.step(self.engine.clock.now(), events):
            self.engine.perform(self, action)

    def next_wake(self) -> float:
        return self.operator.next_wake()

    def health(self) -> HealthMessage:
        return health_message(
            self.operator.stamp,
            self.engine.clock.now(),
            "operator",
            "speaking",
            self.mailbox,
            self.transport.statistics(),
            {"soft_observations": self.operator.stamp.sent(SOFT_OBSERVATION)},
            {},
            {},
        )
