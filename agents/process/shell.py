"""What every process of a team shares: its end of the network, its clock, its health, and how it ends.

A process shell is thin: it drains the network, steps its agent, carries out the actions, and sleeps until
the agent's next wake or until something arrives.
"""

import asyncio
import contextlib
import math
import secrets
import signal
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import psutil

from agents.clock import TeamClock
from agents.errors import JoinError, LinkError, MissionError
from agents.health.vitals import Vitals
from agents.machine import ClockTrust, Event, Heard, Stamp
from agents.mission.mission import Mission, link_of
from agents.mission.mission_file import mission_hash
from agents.plugins import load
from agents.process import lifeline
from agents.process.clock_sync import ClockState, ClockSync
from agents.wire import codec
from agents.wire.mailbox import Mailbox
from agents.wire.messages import ClockMessage, EventMessage, Message, StartMessage
from agents.wire.roles import EXCLUSIVE
from agents.wire.topics import CLOCK, EVENT, START, Topic
from agents.wire.transport import Peer, PeerChange, Transport

HEALTH_PERIOD_S = 1.0  # wall time
FIRST_ANSWER_S = 3.0  # wall time that a process waits to be told by how much its clock is off
FIRST_ASK_S = 0.25  # and asks again meanwhile
TOGETHER_S = 3.0  # processes of one id that join within this time may not have seen each other
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
        self.clock = TeamClock(time.time())
        self.sync: ClockSync | None = None  # once the team has started; the fusion has none
        self._stopping = False
        self.wake = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._told: list[Event] = []
        self._peers: set[Peer] = set()  # alive
        self.vitals = Vitals(mission, time.monotonic())
        self.mailbox.on_refusal = lambda topic, sender: self.vitals.refused(topic, sender, time.monotonic())
        self._joined = 0.0
        self._started_by = ""  # a fusion's name
        self._process = psutil.Process()
        transport = load("transports", mission.link.kind)
        endpoints = tuple(connect) or tuple(mission.link.endpoints) or None
        self.transport: Transport = transport(link_of(mission), mission.team, endpoints=endpoints)

    def __repr__(self) -> str:
        return f"Shell({self.role} {self.name}, {self.clock!r})"

    async def __aenter__(self) -> "Shell":
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        lifeline.start()
        for number in (signal.SIGTERM, signal.SIGINT):
            self._loop.add_signal_handler(number, self.stop)
        self.transport.open(Peer(self.role, self.name, self.boot), self._wake_from_any_thread)
        self._joined = time.monotonic()
        return self

    async def __aexit__(self, *exc: object) -> None:
        self.transport.close()

    @property
    def roles_alive(self) -> set[str]:
        """The roles of the other processes whose token stands."""
        return {peer.role for peer in self._peers}

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
        for event in list(events):
            if isinstance(event, PeerChange):
                self._look_for_double(event)
                (self._peers.add if event.alive else self._peers.discard)(event.peer)
            elif isinstance(event, Heard) and isinstance(event.message, StartMessage):
                events += self._set_clock(event.message)
        wall, now, clock = time.monotonic(), self.clock.now(), self.sync is not None or self.role == "fusion"
        for event in events:
            if isinstance(event, Heard):
                late = (now - event.message.time) / self.clock.speed if clock else math.nan
                self.vitals.heard(event.topic.name, event.message, wall, late)
        told, self._told = self._told, []
        return events + told

    def publish(self, topic: Topic, message: Message) -> None:
        """Send a message to the team."""
        self.transport.publish(topic, codec.encode(message))

    def announce(self, text: str, level: str = "info", about: str = "") -> None:
        """Tell people, here and in the viewer; `about` names the message that this answers."""
        self.log(text)
        header = self.stamp.header(EVENT, self.clock.now())
        self.publish(EVENT, EventMessage(**header, level=level, text=text, about=about))

    async def sleep_until(self, team_time: float) -> None:
        """Until then, or until something arrives."""
        delay = self.clock.delay_until(team_time)
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

    def adopt(self, message: StartMessage) -> None:
        """Take over the team's time, and ask from now on how far this machine's clock is off."""
        self.clock = TeamClock(message.epoch, message.speed)
        self._started_by = message.sender
        asking = self.sync is not None
        self.sync = ClockSync(self.name, self.boot, self.mission.clock, message.speed)
        if not asking:
            self.every(self.mission.clock.ask_every_s, self._ask_time)

    def _ask_time(self) -> None:
        sync, raw = self.sync, self.clock.raw()
        if sync is not None and (sync.due(raw) or sync.state is ClockState.UNKNOWN):
            header = self.stamp.header(CLOCK, self.clock.now())
            self.publish(CLOCK, ClockMessage(**header, shown=self.clock.raw()))

    def _look_for_double(self, change: PeerChange) -> None:
        """Two processes have one id. Who finds the other there never comes this far (see the transport): so
        they joined at the same moment, and one yields; or their networks have just become one."""
        peer = change.peer
        if (peer.role, peer.id) != (self.role, self.name) or self.role not in EXCLUSIVE or not change.alive:
            return
        text = f"another process of the team is {self.role} {self.name} too (boot {peer.boot})"
        if time.monotonic() - self._joined < TOGETHER_S and peer.boot < self.boot:
            raise JoinError(f"{text} and joined at the same moment: this one ends")
        self.announce(f"{text}: end one of them", "error")

    def _set_clock(self, message: StartMessage) -> list[Event]:
        """Correct the clock if an answer says so; a change of trust is an event."""
        sync, raw = self.sync, self.clock.raw()
        if sync is None:
            return []
        if message.sender != self._started_by and self.clock.later_than(message.epoch):
            self.sync = None  # nobody is to be asked any more
            said = f"{self.name} follows {self._started_by}'s start of the team, which is later than that of"
            self.announce(f"{said} {message.sender}: start it again", "error")
            return [ClockTrust(False)]
        before, correction = sync.state, sync.correction
        if not sync.hear(message, raw):
            return []
        if sync.correction != correction:
            self.clock.correction.set(sync.correction, raw)
        if before is ClockState.UNKNOWN or (before is ClockState.REFUSED) == (not sync.trusted):
            return []
        if sync.trusted:
            self.announce(f"the clock of {self.name} is near enough to the team's again")
        else:
            self.announce(sync.sentence(self.name), "error")
        return [ClockTrust(sync.trusted)]

    async def join_team(self) -> int:
        """Wait for the fusion's start message, take over its clock; the run's seed.

        Raises:
            MissionError: if the fusion runs another mission than this process.
            JoinError: if this machine's clock is too far off.
        """
        self.transport.subscribe(START)
        told = 0.0
        peers: list[Event] = []
        while not self.stopping:
            for event in self.events():
                message = getattr(event, "message", None)
                if isinstance(message, StartMessage):
                    if message.mission_hash != mission_hash(self.mission):
                        raise MissionError(
                            f"{self.name} has another mission file than {message.sender}: "
                            "give every process of the team the same file"
                        )
                    self.adopt(message)
                    await self._first_answer()
                    self._told = peers + self._told
                    return message.seed
                if isinstance(event, PeerChange):
                    peers.append(event)
            if time.monotonic() - told > 10.0:
                told = time.monotonic()
                self.log("waiting for the fusion to start the team")
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self.wake.wait(), 1.0)
            self.wake.clear()
        raise LinkError("stopped before the team started")

    async def _first_answer(self) -> None:
        """Wait until it is known how far the clock is off; begin with that correction."""
        sync = self.sync
        assert sync is not None
        deadline = time.monotonic() + FIRST_ANSWER_S
        asked = time.monotonic()
        kept: list[Event] = []
        while sync.state is ClockState.UNKNOWN and not self.stopping and time.monotonic() < deadline:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self.wake.wait(), FIRST_ASK_S)
            self.wake.clear()
            kept += self.events()
            if time.monotonic() - asked > FIRST_ASK_S:
                asked = time.monotonic()
                self._ask_time()
        self._told = kept + self._told
        if not sync.trusted:
            raise JoinError(sync.sentence(self.name))
        if sync.state is ClockState.UNKNOWN:
            self.log("the fusion does not say what time it is: going by this machine's clock meanwhile")
        self.clock.correction.start(sync.correction)
        if sync.state is ClockState.CORRECTED:
            self.log(f"the clock is corrected by {sync.correction / self.clock.speed:+.4f} s")

    def gauges(self) -> dict[str, float]:
        """What the operating system says of this process."""
        clock = {} if self.sync is None else self.sync.gauges(self.clock.raw())
        process = self._process
        waiting = self.transport.waiting()
        peers = {peer.id: peer.role for peer in self._peers}
        return {
            **{f"queue.{topic}": float(count) for topic, count in waiting.items()},
            **self.vitals.gauges(time.monotonic(), self.clock.speed, peers),
            "memory_mb": process.memory_info().rss / 1e6,
            "cpu_s": sum(process.cpu_times()[:2]),
            **clock,
        }

    def _wake_from_any_thread(self) -> None:
        # A closed loop means the process is ending: nobody is left to wake.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self.wake.set)


def run_until_done(main: Callable[[], Any]) -> int:
    """Run a process's coroutine function; its result is the exit status."""
    return int(asyncio.run(main()) or 0)
