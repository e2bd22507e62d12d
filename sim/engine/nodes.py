"""Simulated processes: an agent, its end of the network, its mailbox, its clock, and when it must be woken.

A process may be killed at any moment, or between any two actions, and started again; what it then knows is
what was durable. It may be stopped and go on, or be slow.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum
from typing import TYPE_CHECKING

from agents.clock import Clock
from agents.machine import Event
from agents.wire.mailbox import Mailbox
from agents.wire.messages import HealthMessage
from agents.wire.transport import Peer
from sim.engine.node_clock import Computer, NodeClock
from sim.network.network import SimulatedTransport

if TYPE_CHECKING:
    from sim.engine.engine import Engine


AT_ONCE = 1000  # steps of one process at one instant: more are an agent's defect


class Killed(Exception):
    """The process that was being stepped is no more; nobody but its node's loop sees this."""


class Life(Enum):
    """How a process is."""

    OFF = "off"
    RUNNING = "running"
    STOPPED = "stopped"  # SIGSTOP


def boot_name(number: int) -> str:
    """The id of a process's start; in virtual time a boot's name is no surprise."""
    return f"b{number}"


class Node(ABC):
    """What all simulated processes share."""

    def __init__(self, engine: Engine, role: str, name: str) -> None:
        self.role = role
        self.name = name
        self.engine = engine
        self.life = Life.OFF
        self.boot = ""
        self.computer = Computer()
        self.clock: Clock = engine.clock
        self.lag_s = 0.0  # it looks at what has come no more often than this
        self._boots = 0
        self._told: list[Event] = []
        self._wake_at = float("inf")
        self._busy_until = 0.0
        self._ran_at, self._at_once = -1.0, 0

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name}/{self.boot}, {self.life.value})"

    # From outside

    def start(self) -> None:
        """A new process of this name, which knows only what was durable."""
        assert self.life is Life.OFF, f"{self.name} runs"
        engine, name = self.engine, self.name
        self.boot = boot_name(self._boots)
        self._boots += 1
        computer = self.computer
        looked_at = engine.clocks and self.role == "robot"
        self.clock = NodeClock(computer, engine.clock.now) if looked_at else engine.clock
        self._told, self._wake_at, self._busy_until = [], float("inf"), 0.0
        self.transport = SimulatedTransport(engine.network)
        self.mailbox = Mailbox(
            engine.team.mission.team, lambda text: engine.events.append(f"{name}: {text}"), engine.decode
        )
        self._subscribe()
        self.life = Life.RUNNING
        self._begin()
        engine.onlooker.lived(self, "up")
        self.transport.open(Peer(self.role, name, self.boot), self.wake)

    def kill(self) -> None:
        """SIGKILL: all that is not durable is gone."""
        self.life = Life.OFF
        self._wake_at = float("inf")
        self.transport.close()
        self.engine.onlooker.lived(self, "down")

    def stop(self) -> None:
        """SIGSTOP."""
        self.life = Life.STOPPED
        self.engine.onlooker.lived(self, "stopped")

    def go_on(self) -> None:
        """SIGCONT."""
        self.life = Life.RUNNING
        self.engine.onlooker.lived(self, "going")
        self.wake()

    # From the engine and the network

    def wake(self) -> None:
        """Step as soon as everything that happens at this time has happened."""
        self._schedule(self.engine.clock.now())

    def tell(self, event: Event) -> None:
        """Hand the agent an event."""
        self._told.append(event)
        self.wake()

    def _schedule(self, time: float) -> None:
        if self.life is not Life.RUNNING:
            return
        now = self.engine.clock.now()
        time = max(time, self._busy_until)
        if self._wake_at <= time and self._wake_at >= now:
            return
        self._wake_at = time
        self.engine.after(max(0.0, time - now), lambda: self._run(time))

    def _run(self, due: float) -> None:
        if due != self._wake_at or self.life is not Life.RUNNING:
            return  # superseded by an earlier wake
        self._wake_at = float("inf")
        self._at_once = self._at_once + 1 if due == self._ran_at else 0
        self._ran_at = due
        if self._at_once > AT_ONCE:
            raise RuntimeError(f"{self.name} wants to be woken at {due} again and again: time stands still")
        if self.lag_s:
            self._busy_until = due + self.lag_s
        events: list[Event] = [*self.transport.drain_peer_changes()]
        events += self.mailbox.open(self.transport.drain())
        told, self._told = self._told, []
        try:
            self.step(events + told)
        except Killed:
            return
        self._schedule(max(self._true(self.next_wake()), self.engine.clock.now()))

    def _true(self, time: float) -> float:
        """When it is truly, when this node's clock shows a time."""
        if isinstance(self.clock, NodeClock):
            return self.engine.clock.now() + self.clock.delay_until(time) + 1e-9
        return time

    # What a process is

    @abstractmethod
    def _subscribe(self) -> None: ...

    @abstractmethod
    def _begin(self) -> None:
        """Make the agent, from what is durable."""

    @abstractmethod
    def step(self, events: list[Event]) -> None:
        """Let the agent see the events and carry out its actions."""

    @abstractmethod
    def next_wake(self) -> float:
        """When the agent wants to be woken at the latest, on its own clock."""

    @abstractmethod
    def health(self) -> HealthMessage:
        """As of now."""

    def sizes(self) -> dict[str, int]:
        """How much it keeps of what could grow, by name."""
        return {}
