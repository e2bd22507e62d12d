"""A simulated robot process. Its body is another thing: it flies on when the process has died."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from agents.health.health import health_message
from agents.health.histogram import Histogram
from agents.machine import Action, Event
from agents.robot.body import RobotBody
from agents.robot.plan_request import RobotSetup
from agents.robot.robot import Robot
from agents.wire.messages import HealthMessage
from agents.wire.topics import (
    BID,
    PICTURE,
    PLAN,
    POSE,
    POSTERIOR,
    REQUEST,
    SET,
    SOFT_OBSERVATION,
    START,
    STATE,
)
from sim.engine.clock_keeper import ClockKeeper
from sim.engine.node_clock import NodeClock
from sim.engine.nodes import Life, Node
from sim.steady import SETPOINTS_S, SteadySensor, SteadyVehicle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sim.engine.engine import Engine


class RobotNode(Node):
    """A robot process."""

    def __init__(self, engine: Engine, robot: str) -> None:
        super().__init__(engine, "robot", robot)
        team = engine.team
        self.vehicle = SteadyVehicle(team.vehicle(robot, engine.seed, engine.world), engine.clock.now)
        self.sensor = SteadySensor(team.sensor(robot, engine.seed, engine.world), engine.clock.now)
        self._silences = 0

    def _begin(self) -> None:
        self._early: list[Event] = []
        self._keeper = ClockKeeper(self, self.clock) if isinstance(self.clock, NodeClock) else None
        if self._keeper is None:
            self._join()

    def _join(self) -> None:
        """The clock is known: the robot begins."""
        team, now = self.engine.team, self.clock.now()
        self.vehicle.boot(self.clock)
        self.sensor.boot(self.clock)
        setup = RobotSetup(
            mission=team.mission,
            robot=self.name,
            boot=self.boot,
            vehicle=team.vehicle_models[self.name],
            vehicles=team.vehicle_models,
            ground=team.ground,
            sensors=team.sensor_models,
            area=team.area,
            periods=team.measure_periods,
            follows_plans=self.vehicle.follows_plans,
            first_capture=self.sensor.next_capture(now - 1e-9),
            stagger_s=0.0 if self.engine.planning.joint else 0.1,
            desk=team.desk(self.name),
            left=self.engine.left_in_outbox(self.name),
            alone=team.alone(self.engine.seed),
        )
        self.robot = Robot(setup, now)
        self.body = RobotBody(self.robot, self.vehicle, self.sensor, self.clock, self._perform)

    def kill(self) -> None:
        super().kill()
        self._left_alone()

    def stop(self) -> None:
        super().stop()
        self._left_alone()

    def _left_alone(self) -> None:
        """The vehicle goes on as it was told last, until its autopilot misses the robot's word."""
        self._silences += 1
        silence, boot = self._silences, self.boot

        def look() -> None:
            if silence == self._silences and (self.life is not Life.RUNNING or self.boot != boot):
                self.vehicle.hold()

        self.engine.after(SETPOINTS_S, look)

    def _subscribe(self) -> None:
        if self.engine.clocks:
            self.transport.subscribe(START)
        for topic in (POSE, SET, PICTURE, POSTERIOR, STATE, SOFT_OBSERVATION):
            self.transport.subscribe(topic, urgent=False)
        self.transport.subscribe(PLAN)
        if self.engine.team.desk(self.name) is not None:
            self.transport.subscribe(BID)
            self.transport.subscribe(REQUEST)

    def _perform(self, action: Action) -> None:
        self.engine.perform(self, action)

    def step(self, events: list[Event]) -> None:
        keeper = self._keeper
        if keeper is not None:
            joined = keeper.joined
            self._early += events + keeper.hear(events)
            if not keeper.joined:
                return
            events, self._early = self._early, []
            if not joined:
                self._join()
        self.body.step(events)

    def next_wake(self) -> float:
        if self._keeper is not None and not self._keeper.joined:
            return math.inf
        return self.body.next_wake()

    def sizes(self) -> dict[str, int]:
        return {"unacknowledged": len(self.robot.unacknowledged)}

    def health(self) -> HealthMessage:
        robot = self.robot
        return health_message(
            robot.stamp,
            self.clock.now(),
            "robot",
            robot.state,
            self.mailbox,
            self.transport.statistics(),
            {
                "sets": robot.stamp.sent(SET),
                "reoffered": robot.unacknowledged.reoffered,
                **(robot.allocation.counters() if robot.allocation else {}),
            },
            robot.allocation.gauges() if robot.allocation else {},
            {
                "measure_clock_lateness_ms": self.body.lateness_ms,
                # All robots share one plan service here: the first tells for all.
                "plan_ms": self.engine.planning.plan_ms if self is self.engine.robots[0] else Histogram(),
            },
        )


def neighbours(robots: Sequence[RobotNode], reach: float) -> dict[str, frozenset[str]]:
    """By robot, who is truly no farther from it than `reach` metres."""
    if not robots:
        return {}
    from scipy.spatial import cKDTree  # noqa: PLC0415 - slow to import, and only needed with `reach_m`

    tree = cKDTree(np.stack([node.vehicle.truly().pose[:3] for node in robots]))
    near: dict[str, set[str]] = {node.name: set() for node in robots}
    for i, j in tree.query_pairs(reach):
        near[robots[i].name].add(robots[j].name)
        near[robots[j].name].add(robots[i].name)
    return {name: frozenset(others) for name, others in near.items()}
