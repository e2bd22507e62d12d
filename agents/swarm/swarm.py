"""The launcher: starts a team's processes on this machine, watches them, keeps score, and ends them all."""

import asyncio
import os
import signal
import sys
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from rich.console import Console, RenderableType
from rich.live import Live

from agents.allocation.ownership import SILENT_S, Ownership
from agents.clock import TeamClock
from agents.errors import DataError, LinkError, MissionError, SearchpartyError
from agents.health.team_health import HealthBoard
from agents.machine import Event, Heard
from agents.mission.mission import Mission, link_of
from agents.mission.mission_file import load
from agents.plugins import load as load_plugin
from agents.process import warm
from agents.process.nursery import Nursery
from agents.process.shell import Shell, run_until_done
from agents.swarm.processes import Launch, commands
from agents.swarm.run_directory import RunDirectory
from agents.swarm.scoreboard import Scoreboard
from agents.swarm.status_board import StatusBoard
from agents.swarm.status_table import ProcessStatus, status_table
from agents.swarm.supervisor import State, Status, Supervisor
from agents.team import Team
from agents.wire.messages import EventMessage, StartMessage, TruthMessage
from agents.wire.topics import BELIEF, BID, EVENT, HEALTH, POSE, POSTERIOR, SET, START, TRUTH
from agents.wire.transport import PeerChange

HEARD = (POSE, SET, BID, POSTERIOR, BELIEF, HEALTH, EVENT, START)
GRACE_S = 1.0  # wall time from the last found target to the end
REFRESH_S = 0.25
TRUTH_PERIOD_S = 1.0
REFUSALS = (MissionError.exit_code, LinkError.exit_code, DataError.exit_code)
FAREWELL_S = 0.2  # for the last health messages to arrive


def run(
    mission: Mission,
    *,
    out: Path | None,
    speed: float = 1.0,
    view: str = "auto",
    nursery: Nursery | None = None,
) -> int:
    """Run the mission with one process per robot; 0 only if every target was found.

    With a `nursery` processes are forked from it, and start the sooner.

    Raises:
        SearchpartyError: with what to do about it.
    """
    return run_until_done(lambda: _main(mission, out, speed, view, nursery))


async def _main(mission: Mission, out: Path | None, speed: float, view: str, nursery: Nursery | None) -> int:
    console = Console()
    view = _view(view)
    warm.ensure(console, mission)  # or every robot would compile the same kernels at the same time
    directory = RunDirectory.create(mission, out)
    resolved = load(directory.mission)  # what the children will read
    with load_plugin("routers", mission.link.kind)(link_of(resolved)) as router:
        launch = Launch(directory.mission, directory.path, tuple(router.endpoints), speed, view)
        async with Shell(resolved, "swarm", "swarm", router.endpoints) as shell:
            swarm = Swarm(shell, Team.of(resolved), launch, directory, console, nursery)
            return await swarm.run()


def _view(wish: str) -> str:
    """What "auto" means here: a window where there is a screen, else only the recording."""
    if wish == "spawn" and not _screen():
        raise SearchpartyError(
            "no display for the viewer's window: use --view web, or --view none and open view.rrd afterwards"
        )
    if wish != "auto":
        return wish
    return "spawn" if _screen() else "none"


def _screen() -> bool:
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or sys.platform == "darwin")


class Swarm:
    """One local run."""

    def __init__(
        self,
        shell: Shell,
        team: Team,
        launch: Launch,
        directory: RunDirectory,
        console: Console,
        nursery: Nursery | None = None,
    ) -> None:
        self._shell = shell
        self._team = team
        self._mission = team.mission
        self._directory = directory
        self._console = console
        self._roles: set[str] = set()  # of which somebody has been in the team
        self._supervisor = Supervisor(
            commands(team.mission, launch),
            directory.path,
            self._changed,
            nursery=nursery,
            joined=self._roles.__contains__,
        )
        self._world = team.world(team.mission.seed)
        self._scoreboard = Scoreboard(team.mission, team.mission.seed, "processes", self._world)
        self._scoreboard.tasks = Ownership(SILENT_S * max(1.0, launch.speed))
        self._board = StatusBoard(team.mission)
        self._health = HealthBoard(team.mission, shell.vitals)
        shell.vitals.listening = tuple(topic.name for topic in HEARD)
        self._started = False
        self._ending = False
        self._deaths: list[str] = []

    async def run(self) -> int:
        """Until all is found, the time is up, or someone asks to end; then the summary."""
        shell = self._shell
        for topic in HEARD:
            shell.transport.subscribe(topic, urgent=False)
        starting = asyncio.create_task(self._supervisor.start())
        try:
            shell.every(TRUTH_PERIOD_S, self._publish_truth)
            with Live(self._table(), console=self._console, refresh_per_second=4, transient=False) as live:
                await self._watch(live, starting)
                await self._stop()
                live.update(self._table())
        finally:
            await self._supervisor.stop()
            await asyncio.gather(starting, return_exceptions=True)
        return self._finish()

    async def _watch(self, live: Live, starting: "asyncio.Task[None]") -> None:
        shell, mission = self._shell, self._mission
        end_at: float | None = None
        while not shell.stopping:
            await shell.sleep_until(shell.clock.now() + REFRESH_S * shell.clock.speed)
            if starting.done():
                starting.result()  # what kept it from starting all is raised here
            self._take(shell.events())
            live.update(self._table())
            if self._started and shell.clock.now() >= mission.duration_s:
                return
            if not (self._scoreboard.all_found and mission.stop_when_all_found):
                end_at = None  # also when a late set took a finding back
            elif end_at is None:
                end_at = time.monotonic() + GRACE_S
            if end_at is not None and time.monotonic() >= end_at:
                return
            self._look_for_failure()

    async def _stop(self) -> None:
        self._ending = True
        stopping = asyncio.create_task(self._supervisor.stop())
        while not stopping.done():
            self._take(self._shell.events())
            await asyncio.sleep(0.02)
        await stopping
        until = time.monotonic() + FAREWELL_S
        while time.monotonic() < until:
            self._take(self._shell.events())
            await asyncio.sleep(0.02)

    def _look_for_failure(self) -> None:
        """A team that cannot go on ends with the reason, not with a timeout."""
        statuses = self._supervisor.statuses()
        robots = [s for s in statuses if s.role == "robot"]
        fusions = [s for s in statuses if s.role == "fusion"]
        dead = robots if all(s.final for s in robots) else []
        if not self._started:  # nobody has taken off: a mission that one cannot do is not begun without it
            dead = [s for s in robots if s.final and s.exit_code in REFUSALS] or dead
        # Once the team has its time, robots that may go on alone do.
        if not (self._started and self._mission.fusion.share_state_s) and all(s.final for s in fusions):
            dead = fusions
        if not dead:
            return
        first = dead[0]
        log = self._directory.path / f"{first.name}.log"
        lines = log.read_text(errors="replace").strip().splitlines() if log.exists() else []
        words = next((line for line in reversed(lines) if line.strip()), "no word in its log")
        words = words.removeprefix("searchparty: ")
        raise LinkError(f"{first.name} ended with exit status {first.exit_code}: {words} (see {log})")

    def _changed(self, status: Status) -> None:
        if status.state in (State.DIED, State.WAITING):
            how = (
                signal.Signals(-status.exit_code).name
                if status.exit_code is not None and status.exit_code < 0
                else f"exit status {status.exit_code}"
            )
            after = "will be started again" if status.state is State.WAITING else "the others go on"
            news = f"{status.name} died ({how}); {after}"
            self._deaths.append(news)
            self._board.note(news)
            header = self._shell.stamp.header(EVENT, self._shell.clock.now())
            self._shell.publish(EVENT, EventMessage(**header, level="warning", text=news))

    def _take(self, events: Iterable[Event]) -> None:
        wall = time.monotonic()
        for event in events:
            if isinstance(event, PeerChange):
                self._roles.add(event.peer.role)
                if not self._ending:  # that all go then is no news
                    self._board.on_peer(event)
                    self._health.on_peer(event)
            elif isinstance(event, Heard):
                message = event.message
                self._board.on_message(event.topic.name, message, wall)
                self._health.on_message(message)
                if isinstance(message, StartMessage):
                    self._shell.clock = TeamClock(message.epoch, message.speed)
                    self._started = True
                self._scoreboard.hear(event, self._shell.clock.now())

    def _publish_truth(self) -> None:
        shell = self._shell
        now = shell.clock.now()
        message = TruthMessage(**shell.stamp.header(TRUTH, now), targets=self._world.targets(now))
        shell.publish(TRUTH, message)

    def _table(self) -> RenderableType:
        time_s = self._shell.clock.now() if self._started else None
        status = self._board.status(time.monotonic(), time_s)
        well = not self._started or self._ending
        problems = () if well else self._health.recent(time.monotonic(), self._shell.clock.speed)
        supervised = {s.name: s for s in self._supervisor.statuses()}
        return status_table(
            replace(
                status,
                problems=problems,
                found=self._scoreboard.targets_found,
                total=self._scoreboard.targets_total,
                processes=tuple(_with(row, supervised[row.id]) for row in status.processes),
            )
        )

    def _finish(self) -> int:
        summary = self._scoreboard.summary()
        self._directory.write_summary(summary)
        console, total = self._console, summary["targets_total"]
        if not console.is_terminal:
            console.print()  # the table's last line is left open there
        for news in self._deaths:
            console.print(news, soft_wrap=True)
        found = f"{summary['targets_found']} of {total} targets found"
        if summary["all_found"]:
            console.print(
                f"[bold green]{found}[/] in {summary['time_to_all_found_s']:.1f} s with "
                f"{summary['measurements_to_all_found']} measurement sets, RMSE {summary['rmse_m']:.2f} m, "
                f"{summary['false_found']} false"
            )
        else:
            console.print(f"[bold red]{found}[/], {summary['false_found']} false")
        console.print(f"run directory: {self._directory.path}", soft_wrap=True)
        return 0 if summary["all_found"] else 1


def _with(row: ProcessStatus, status: Status) -> ProcessStatus:
    """What the team says of a process, and what the system says of it."""
    if status.state is State.RUNNING:
        return replace(row, restarts=status.restarts, state=row.state or "starting")
    return replace(row, restarts=status.restarts, state=status.state.value, alive=False)
