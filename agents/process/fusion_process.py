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
from agents.team import Team
from agents.wire.messages import ClockMessage, LedgerEntry, MeasurementSetMessage, StartMessage
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
START_DELAY_S = 0.5  # from the start message to team time 0, so that all hear of it before


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
        self._speed = speed
        self._latency_ms = Histogram()
        self._robots: set[str] = set()
        self._early: list[Event] = []
        self._answers = ClockAnswers()
        self._gather_s = 0.0
        self._others: StartMessage | None = None  # of a fusion that started the team before
        self._warned = False
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

    async def run(self) -> None:
        """Until the process is told to end."""
        shell = self._shell
        if not await self._start_team():
            return
        rate = self._speed * sum(1.0 / period for period in self._team.measure_periods.values())
        self._gather_s = min(GATHER_S, 0.0025 * self._speed) if self._speed > 1.0 else 0.0
        if rate > CROWD_HZ:
            self._gather_s = max(self._gather_s, CROWD_GATHER_S)
        shell.every(HEALTH_PERIOD_S, self._publish_start)
        shell.every(HEALTH_PERIOD_S, self._publish_health)
        while not shell.stopping:
            began = time.monotonic()
            events, self._early = self._early + shell.events(), []
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
        shell, ledger = self._shell, self._ledger
        epoch = ledger.fact("epoch")
        if epoch is not None:
            self._speed = float(ledger.fact("speed") or 1.0)
            shell.clock = TeamClock(float(epoch), self._speed)
            began = time.perf_counter()
            self._fusion.restore()
            estimate, took = self._fusion.estimate, time.perf_counter() - began
            said = f" and {estimate.statements} soft observations" if estimate.statements else ""
            shell.announce(f"goes on with a ledger of {estimate.sets} sets{said} after {took:.2f} s")
            self._step([])  # the posterior is out before anything else is done
            rehearse_fusion(self._team)
            return True
        wanted = {robot.id for robot in shell.mission.robots}
        first = shell.name == shell.mission.fusions()[0]
        deadline = time.monotonic() + shell.mission.settings.start_timeout_s * (1.0 if first else 1.5)
        while not shell.stopping and self._others is None and time.monotonic() < deadline:
            self._note(shell.events())
            if first and wanted <= self._robots:
                break
            await asyncio.sleep(0.02)
        if shell.stopping:
            return False
        if self._others is not None:
            self._join(self._others)
            return True
        missing = sorted(wanted - self._robots)
        if missing:
            shell.announce(f"starts without {', '.join(missing)}: they may join later", "warning")
        start = time.time() + START_DELAY_S
        self._remember(start)
        shell.clock = TeamClock(start, self._speed)
        return True

    def _join(self, start: StartMessage) -> None:
        """Another fusion has started the team."""
        shell, mission = self._shell, self._shell.mission
        if start.mission_hash != mission_hash(mission) or start.seed != mission.seed:
            raise MissionError(
                f"{shell.name} has another mission file or seed than {start.sender}: "
                "give every fusion of the team the same"
            )
        self._speed = start.speed
        self._remember(start.epoch)
        shell.adopt(start)
        shell.announce(f"joins the team that {start.sender} has started")

    def _remember(self, epoch: float) -> None:
        mission = self._shell.mission
        facts = {
            "epoch": repr(epoch),
            "speed": repr(self._speed),
            "seed": str(mission.seed),
            "mission": mission.name,
            "mission_hash": mission_hash(mission),
            "rollback_s": repr(mission.fusion.rollback_s),
            "fusion": self._shell.name,
        }
        for name in reversed(facts):  # the epoch last: with it the ledger is one to go on with
            self._ledger.remember(name, facts[name])

    def _note(self, events: Sequence[Event]) -> None:
        for event in events:
            if isinstance(event, Heard) and isinstance(event.message, StartMessage):
                self._others = event.message
            if isinstance(event, PeerChange) and event.peer.role == "robot":
                (self._robots.add if event.alive else self._robots.discard)(event.peer.id)
            elif isinstance(event, Heard):
                self._early.append(event)

    def _step(self, events: Sequence[Event]) -> None:
        shell = self._shell
        for event in events:
            if isinstance(event, PeerChange) and event.peer.role == "robot" and self._fusion.replicas.leads:
                verb = "is here" if event.alive else "is gone"
                shell.announce(f"{event.peer.id} {verb}", "info" if event.alive else "warning")
            elif isinstance(event, Heard) and isinstance(event.message, StartMessage):
                self._compare(event.message)
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

    def _compare(self, start: StartMessage) -> None:
        """Two fusions of one team that were started apart have two times: sets of one make no sense in the
        other. People must choose."""
        clock = self._shell.clock
        assert isinstance(clock, TeamClock)
        if abs(start.epoch - clock.epoch) > 1e-3 and not self._warned:
            self._warned = True
            self._shell.announce(
                f"{start.sender} runs the same team with another start: end one of the two fusions", "error"
            )

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
