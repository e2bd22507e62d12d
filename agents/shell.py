"""What every process of a team shares: its end of the network, its clock, its health, and how it ends.

A process shell is thin: it drains the network, steps its agent, carries out the actions, and sleeps until
the agent's next wake or until something arrives.
"""

import asyncio
import contextlib
import os
import secrets
import signal
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import psutil

from agents import codec, lifeline
from agents.clock import Clock, TeamClock
from agents.errors import LinkError, MissionError
from agents.machine import Event, Stamp
from agents.mailbox import Mailbox
from agents.messages import EventMessage, Message, StartMessage
from agents.mission import Mission
from agents.mission_file import mission_hash
from agents.plugins import load
from agents.topics import EVENT, START, Topic
from agents.transport import Peer, Transport

HEALTH_PERIOD_S = 1.0  # wall time
SWITCH_INTERVAL_S = 0.0005  # a planner's Python part lets the measure clock in this quickly


def new_boot() -> str:
    """A name that no other start of any process has."""
    return secrets.token_hex(6)


class Shell:
    """One process's end of the team. Use as an async context manager."""

    def __init__(self, mission: Mission, role: str, name: str, connect: Sequence[str]) -> None:
        self.mission = mission
        self.role = role
        self.name = name
        self.boot = new_boot()
        self.stamp = Stamp(mission.team, name, self.boot)
        self.mailbox = Mailbox(mission.team, self.log)
        self.clock: Clock = TeamClock(time.time())
        self._stopping = False
        self.wake = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._told: list[Event] = []
        transport = load("transports", mission.link.kind)
        endpoints = tuple(connect) or tuple(mission.link.endpoints) or None
        self.transport: Transport = transport(mission.link, mission.team, endpoints=endpoints)

    def __repr__(self) -> str:
        return f"Shell({self.role} {self.name}, {self.clock!r})"

    async def __aenter__(self) -> "Shell":
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        lifeline.start()
        for number in (signal.SIGTERM, signal.SIGINT):
            self._loop.add_signal_handler(number, self.stop)
        self.transport.open(Peer(self.role, self.name, self.boot), self._wake_from_any_thread)
        return self

    async def __aexit__(self, *exc: object) -> None:
        self.transport.close()

    @property
    def stopping(self) -> bool:
        """Whether this process was told to end."""
        return self._stopping

    def stop(self) -> None:
        """End soon; the signal handlers call this."""
        self._stopping = True
        self.wake.set()

    def log(self, text: str) -> None:
        """A line in this process's log file."""
        print(f"{self.clock.now():10.3f} {self.role} {self.name}: {text}", file=sys.stderr, flush=True)

    def tell(self, event: Event) -> None:
        """Hand the agent an event at the next step."""
        self._told.append(event)
        self.wake.set()

    def events(self) -> list[Event]:
        """All that happened since the last call."""
        events: list[Event] = [*self.transport.drain_peer_changes()]
        events += self.mailbox.open(self.transport.drain())
        told, self._told = self._told, []
        return events + told

    def publish(self, topic: Topic, message: Message) -> None:
        """Send a message to the team."""
        self.transport.publish(topic, codec.encode(message))

    def announce(self, text: str, level: str = "info") -> None:
        """Tell people, here and in the viewer."""
        self.log(text)
        self.publish(
            EVENT, EventMessage(**self.stamp.header(EVENT, self.clock.now()), level=level, text=text)
        )

    async def sleep_until(self, team_time: float) -> None:
        """Until then, or until something arrives."""
        delay = (team_time - self.clock.now()) / self.clock.speed
        if delay > 0 and not self.stopping:
            timer = self._loop.call_later(delay, self.wake.set)
            await self.wake.wait()
            timer.cancel()
        else:
            await asyncio.sleep(0)
        self.wake.clear()

    def every(self, period: float, action: Callable[[], None]) -> None:
        """Do something every `period` seconds of wall time until the process ends."""

        def again() -> None:
            if not self.stopping:
                action()
                self._loop.call_later(period, again)

        self._loop.call_soon(again)

    async def join_team(self) -> int:
        """Wait for the fusion's start message, take over its clock; the run's seed.

        Raises:
            MissionError: if the fusion runs another mission than this process.
        """
        self.transport.subscribe(START)
        told = 0.0
        while not self.stopping:
            for event in self.events():
                message = getattr(event, "message", None)
                if isinstance(message, StartMessage):
                    if message.mission_hash != mission_hash(self.mission):
                        raise MissionError(
                            f"{self.name} has another mission file than {message.sender}: "
                            "give every process of the team the same file"
                        )
                    self.clock = TeamClock(message.epoch, message.speed)
                    return message.seed
            if time.monotonic() - told > 10.0:
                told = time.monotonic()
                self.log("waiting for the fusion to start the team")
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self.wake.wait(), 1.0)
            self.wake.clear()
        raise LinkError("stopped before the team started")

    def gauges(self) -> dict[str, float]:
        """What the operating system says of this process."""
        return {"memory_mb": _process().memory_info().rss / 1e6, "cpu_s": sum(_process().cpu_times()[:2])}

    def _wake_from_any_thread(self) -> None:
        # A closed loop means the process is ending: nobody is left to wake.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self.wake.set)


def _process() -> psutil.Process:
    return psutil.Process(os.getpid())


def run_until_done(main: Callable[[], Any]) -> int:
    """Run a process's coroutine function; its result is the exit status."""
    return int(asyncio.run(main()) or 0)
