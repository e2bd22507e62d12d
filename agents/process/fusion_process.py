"""The fusion process: one Fusion with its ledger on the real network. It also starts the team's clock."""

import asyncio
import gc
import platform
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from agents.clock import TeamClock
from agents.errors import MissionError
from agents.fusion.fusion import Fusion, FusionSetup
from agents.health.health import health_message
from agents.health.histogram import Histogram
from agents.ledger.ledger import Ledger
from agents.ledger.snapshot import fingerprint
from agents.machine import Event, Heard, Keep, Publish, Store
from agents.mission.mission import Mission
from agents.mission.mission_file import mission_hash
from agents.process.clock_sync import ClockAnswers
from agents.process.rehearsal import rehearse_fusion
from agents.process.shell import HEALTH_PERIOD_S, Shell, run_until_done
from agents.process.starts import TeamStart
from agents.team import Team
from agents.wire.messages import ClockMessage, LedgerEntry, MeasurementSetMessage, StartMessage
from agents.wire.presence import Presence
from agents.wire.topics import (
    CLOCK,
    EVENT,
    HEALTH,
    LEDGER,
    PICTURE,
    POSTERIOR,
    RELAY,
    SET,
    SOFT_OBSERVATION,
    START,
    STATE,
)
from agents.wire.transport import PeerChange

NAME = "fusion"
BATCH = 256  # events in one step: a long backlog is acknowledged piece by piece
# A team that runs faster than the wall is late by as much more of its own time: sets of many instants arrive
# in any order, and each would make the fusion apply the others again. So it lets some come together first.
GATHER_S = 0.05
CROWD_HZ = 20.0  # sets of a team in a wall second, from which on
CROWD_GATHER_S = 0.06  # those of this time are stored and shown together: one commit, one posterior for all
LINGER_S = 0.25  # robots that end with the fusion may have sent a set just before


def run(
    mission: Mission,
    *,
    ledger: Path,
    connect: Sequence[str] = (),
    speed: float = 1.0,
    name: str = NAME,
) -> int:
    """Run the fusion until it is told to end; the exit status.

    Raises:
        SearchpartyError: with what to do about it.
    """
    if name not in mission.fusions():
        raise MissionError(
            f"the mission has no fusion {name!r}; its fusions are {', '.join(mission.fusions())} "
            "(fusion.replicas says how many)"
        )
    return run_until_done(partial(_main, mission, ledger, connect, speed, name))


async def _main(mission: Mission, path: Path, connect: Sequence[str], speed: float, name: str) -> int:
    team = Team.of(mission)
    with Ledger(path, synchronous=mission.fusion.synchronous) as ledger:
        if ledger.fact("epoch") is None:  # else the team waits: what is applied again loads the kernels
            rehearse_fusion(team)
        gc.collect()
        gc.freeze()  # what lives now lives to the end: no collection needs to look at it
        async with Shell(mission, "fusion", name, connect) as shell:
            for topic in (SET, SOFT_OBSERVATION, CLOCK, START):
                shell.transport.subscribe(topic)
            for topic in (LEDGER, RELAY):
                shell.transport.subscribe(topic, urgent=False)
            for topic in (START, POSTERIOR, PICTURE, STATE, LEDGER, HEALTH, EVENT):
                shell.transport.prepare(topic)
            process = FusionProcess(shell, team, ledger, speed)
            await process.run()
    return 0


class FusionProcess:
    """The loop around one Fusion."""

    def __init__(self, shell: Shell, team: Team, ledger: Ledger, speed: float) -> None:
        self._shell = shell
        self._team = team
        self._ledger = ledger
        self._start = TeamStart(shell, ledger, speed)
        self._robots = Presence("robot")
        self._latency_ms = Histogram()
        self._answers = ClockAnswers()
        self._gather_s = 0.0
        search = team.search()
        setup = FusionSetup(
            team.mission,
            shell.name,
            shell.boot,
            search,
            team.sensor_models,
            ledger,
            fingerprint(team.mission, team.mission.seed, search.filter),
            platform.node(),
        )
        self._fusion = Fusion(setup, team.mission.seed)
        self._fusion.stamp = shell.stamp

    @property
    def _speed(self) -> float:
        return self._start.speed

    async def run(self) -> None:
        """Until the process is told to end."""
        shell = self._shell
        if not await self._start_team():
            return
        speed = self._speed
        rate = speed * sum(1.0 / period for period in self._team.measure_periods.values())
        self._gather_s = min(GATHER_S, 0.0025 * speed) if speed > 1.0 else 0.0
        if rate > CROWD_HZ:
            self._gather_s = max(self._gather_s, CROWD_GATHER_S)
        shell.every(HEALTH_PERIOD_S, self._publish_start)
        shell.every(HEALTH_PERIOD_S, self._publish_health)
        while not shell.stopping:
            began = time.monotonic()
            events, self._start.early = self._start.early + shell.events(), []
            events.sort(key=_capture_time)
            for first in range(0, max(1, len(events)), BATCH):
                self._step(events[first : first + BATCH])
            rest = self._gather_s - (time.monotonic() - began)
            if rest > 0.0:
                await asyncio.sleep(rest)
            await shell.sleep_until(self._fusion.next_wake())
        until = time.monotonic() + LINGER_S
        while time.monotonic() < until:
            self._step(shell.events())
            await asyncio.sleep(0.02)
        self._publish_health()

    async def _start_team(self) -> bool:
        """Go on with an earlier life's ledger, or wait for the robots and start the clock.

        False if the process was told to end meanwhile.
        """
        shell, start = self._shell, self._start
        if not start.goes_on():
            return await start.wait()
        began = time.perf_counter()
        self._fusion.restore()
        estimate, took = self._fusion.estimate, time.perf_counter() - began
        said = f" and {estimate.statements} soft observations" if estimate.statements else ""
        shell.announce(f"goes on with a ledger of {estimate.sets} sets{said} after {took:.2f} s")
        self._step([])  # the posterior is out before anything else is done
        rehearse_fusion(self._team)
        return True

    def _step(self, events: Sequence[Event]) -> None:
        shell = self._shell
        for event in events:
            if isinstance(event, PeerChange):
                came = self._robots.take(event)
                if came is not None and self._fusion.replicas.leads:
                    verb = "is here" if came else "is gone"
                    shell.announce(f"{event.peer.id} {verb}", "info" if came else "warning")
            elif isinstance(event, Heard) and isinstance(event.message, StartMessage):
                self._start.compare(event.message)
        now = shell.clock.now()
        first = [
            self._answers.hear(event.message, now)
            for event in events
            if isinstance(event, Heard) and isinstance(event.message, ClockMessage)
        ]
        if any(first):
            self._publish_start()
        stored: list[LedgerEntry] = []
        for action in self._fusion.step(now, events):
            if isinstance(action, Store):
                self._ledger.store(action.entries, action.expired, action.revived)
                stored += action.entries
            elif isinstance(action, Keep):
                self._ledger.keep(action.checkpoint, action.kept)
            elif isinstance(action, Publish):
                shell.publish(action.topic, action.message)
                if action.topic is POSTERIOR:  # what follows it is not urgent
                    self._measure_latency(stored)
                    stored = []
        self._measure_latency(stored)

    def _measure_latency(self, entries: Sequence[LedgerEntry]) -> None:
        """Of sets that the posterior holds since now; what was offered again is counted once."""
        now = self._shell.clock.now()
        for entry in entries:
            if isinstance(entry, MeasurementSetMessage):
                self._latency_ms.add((now - entry.time) / self._speed * 1e3)

    def _publish_start(self) -> None:
        shell, clock = self._shell, self._shell.clock
        assert isinstance(clock, TeamClock)
        message = StartMessage(
            **shell.stamp.header(START, clock.now()),
            epoch=clock.epoch,
            speed=clock.speed,
            seed=shell.mission.seed,
            mission_hash=mission_hash(shell.mission),
            answers=self._answers.take(),
        )
        shell.publish(START, message)

    def _publish_health(self) -> None:
        shell = self._shell
        message = health_message(
            shell.stamp,
            shell.clock.now(),
            "fusion",
            "running",
            shell.mailbox,
            shell.transport.statistics(),
            self._fusion.counters,
            shell.gauges(),
            {"capture_to_posterior_ms": self._latency_ms},
        )
        shell.publish(HEALTH, message)


def _capture_time(event: Event) -> float:
    """For the order in which a backlog is taken; what is not for the ledger comes first."""
    if isinstance(event, Heard) and isinstance(event.message, LedgerEntry):
        return event.message.time
    return float("-inf")
