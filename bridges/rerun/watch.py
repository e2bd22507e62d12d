"""`searchparty watch`: hears a whole team, shows it in Rerun and in the terminal, and records the picture.

Nothing in a team depends on this process. Rerun's calls may wait for a slow viewer, so they run in a thread
of their own behind a bounded queue: what it cannot take is dropped and counted, and the terminal goes on.
"""

# ruff: noqa: PLC0415 - Rerun and the network are imported when the command runs, not when it is listed

import gc
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agents.cli import Connect, MissionArgument, View
from agents.machine import Heard
from agents.mission.mission import Mission
from agents.wire.messages import StartMessage
from agents.wire.transport import PeerChange

if TYPE_CHECKING:
    from rich.console import Console

    from agents.process.shell import Shell
    from agents.swarm.status_table import TeamStatus
    from bridges.rerun.view import RerunView

DRAW_PERIOD_S = 0.2  # wall time
CLOSE_S = 1.2  # wall time for the recording's end; with the rest below the 2 s that every process has
NICENESS = 8  # where the team's processes share the machine, they come first
_QUEUE = 20_000  # messages that wait for a slow viewer


def watch(
    mission: MissionArgument,
    connect: Connect = None,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Record the picture; `rerun FILE` shows it again.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="A run directory: record to view.rrd in it.")
    ] = None,
    view: Annotated[View, typer.Option(help="auto: a window if there is a screen, else none.")] = View.AUTO,
    quiet: Annotated[bool, typer.Option("--quiet", help="No table in the terminal.")] = False,
) -> None:
    """Show a running team in Rerun and in the terminal, and record the picture.

    \b
    Examples:
      searchparty watch quickstart --connect tcp/127.0.0.1:7447
      searchparty watch missions/quickstart.toml --view web --record view.rrd
    """
    import asyncio

    from agents.mission import mission_file

    loaded = mission_file.load(mission)
    target = record if record is not None else None if out is None else out / "view.rrd"
    asyncio.run(_main(loaded, tuple(connect or ()), target, view, quiet))
    gc.freeze()  # the interpreter's last collection takes half a second of the two that an end may take


class Drawer:
    """The thread that draws. `put` never waits; `close` waits no longer than it says."""

    def __init__(self, view: "RerunView", complain: Callable[[str], None]) -> None:
        self.dropped = 0
        self._view = view
        self._complain = complain
        self._waiting: deque[Heard | PeerChange] = deque()
        self._now: float | None = None
        self._ready = threading.Condition()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="drawer", daemon=True)
        self._thread.start()

    def __repr__(self) -> str:
        return f"Drawer(waiting={len(self._waiting)}, dropped={self.dropped})"

    def put(self, events: list[Any], now: float | None) -> None:
        """Draw these soon, at team time `now`; when too many wait, the oldest are dropped and counted."""
        with self._ready:
            self._waiting.extend(event for event in events if isinstance(event, Heard | PeerChange))
            while len(self._waiting) > _QUEUE:
                self._waiting.popleft()
                self.dropped += 1
            self._now = now
            self._ready.notify()

    def close(self, timeout: float) -> None:
        """Draw what waits, write the recording's end and close the viewer."""
        with self._ready:
            self._closing = True
            self._ready.notify()
        self._thread.join(timeout / 3.0)
        self._view.close(timeout * 2.0 / 3.0)

    def _run(self) -> None:
        while True:
            with self._ready:
                self._ready.wait_for(lambda: self._waiting or self._closing)
                events, now = list(self._waiting), self._now
                self._waiting.clear()
                closing = self._closing
            try:
                self._draw(events, now)
            except Exception as error:  # one bad picture must not end the recording
                self._complain(f"could not draw: {type(error).__name__}: {error}")
            if closing:
                return

    def _draw(self, events: list[Heard | PeerChange], now: float | None) -> None:
        for event in events:
            if isinstance(event, Heard):
                self._view.on_message(event.topic.name, event.message)
            else:
                self._view.on_peer(event)
        self._view.show(now)


class Watcher:
    """The loop between the network, the table and the drawer."""

    def __init__(self, shell: "Shell", view: "RerunView", console: "Console", *, quiet: bool) -> None:
        from agents.health.team_health import HealthBoard
        from agents.swarm.status_board import StatusBoard

        self._shell = shell
        self._view = view
        self._console = console
        self._table = not quiet and console.is_terminal
        self._board = StatusBoard(shell.mission)
        self._health = HealthBoard(shell.mission, shell.vitals)
        self._drawer = Drawer(view, shell.log)
        self._started = False

    async def run(self) -> None:
        """Until the process is told to end."""
        from rich.live import Live

        from agents.process.shell import HEALTH_PERIOD_S
        from agents.swarm.status_table import status_table
        from agents.wire.topics import TOPICS

        shell = self._shell
        for topic in TOPICS.values():
            shell.transport.subscribe(topic, urgent=False)
        shell.every(HEALTH_PERIOD_S, self._tell_health)
        if self._view.output.url is not None:
            self._console.print(f"the picture: {self._view.output.url}", soft_wrap=True)
        with Live(console=self._console, auto_refresh=False) as live:
            while not shell.stopping:
                self._take()
                if self._table:
                    live.update(status_table(self._status()), refresh=True)
                await shell.sleep_until(shell.clock.now() + DRAW_PERIOD_S * shell.clock.speed)
            self._take()

    def close(self) -> None:
        """Write the recording's end; returns within `CLOSE_S`, whatever the viewer does."""
        self._drawer.close(CLOSE_S)

    def _now(self) -> float | None:
        return max(0.0, self._shell.clock.now()) if self._started else None

    def _status(self) -> "TeamStatus":
        from dataclasses import replace

        wall = time.monotonic()
        problems = self._health.recent(wall, self._shell.clock.speed) if self._started else ()
        return replace(self._board.status(wall, self._now()), problems=problems)

    def _take(self) -> None:
        events = self._shell.events()
        wall = time.monotonic()
        for event in events:
            if isinstance(event, PeerChange):
                self._board.on_peer(event)
                self._health.on_peer(event)
            elif isinstance(event, Heard):
                self._board.on_message(event.topic.name, event.message, wall)
                self._health.on_message(event.message)
                if isinstance(event.message, StartMessage):
                    self._start(event.message)
        self._drawer.put(events, self._now())

    def _start(self, message: StartMessage) -> None:
        from agents.mission.mission_file import mission_hash

        if not self._started and message.mission_hash != mission_hash(self._shell.mission):
            # Worth a warning only: a person may look at a run with another seed or duration.
            text = "the team runs another version of this mission file"
            self._shell.log(text)
            self._board.note(text)
        if not self._started or message.epoch != self._shell.clock.epoch:
            self._shell.adopt(message)  # people look at the team's time, not at this computer's
        self._started = True

    def _tell_health(self) -> None:
        from agents.health.health import health_message
        from agents.wire.topics import HEALTH

        shell = self._shell
        message = health_message(
            shell.stamp,
            shell.clock.now(),
            "watch",
            "watching",
            shell.mailbox,
            shell.transport.statistics(),
            {"view_dropped": self._drawer.dropped, "view_ignored": self._view.ignored},
            shell.gauges(),
            {},
        )
        shell.publish(HEALTH, message)


async def _main(
    mission: Mission, connect: tuple[str, ...], record: Path | None, wish: View, quiet: bool
) -> None:
    from rich.console import Console

    from agents.process.priority import stand_back
    from agents.process.shell import Shell
    from agents.team import Team
    from bridges.rerun.output import Mode, has_display
    from bridges.rerun.view import RerunView

    modes: dict[View, Mode] = {
        View.AUTO: "spawn" if has_display() else "none",
        View.NONE: "none",
        View.SPAWN: "spawn",
        View.WEB: "web",
    }
    outlines = {robot: model.outline for robot, model in Team.of(mission).sensor_models.items()}
    console = Console()
    # The viewer is started before the network: a process with a Zenoh session must not fork.
    view = RerunView(mission, outlines=outlines, record=record, mode=modes[wish])
    close: Callable[[], None] = partial(view.close, CLOSE_S)
    try:
        async with Shell(mission, "watch", "watch", connect) as shell:
            stand_back(NICENESS)  # from now on; while it was loading, the team waited for it
            watcher = Watcher(shell, view, console, quiet=quiet)
            close = watcher.close
            await watcher.run()
    finally:
        close()
    if record is not None:
        console.print(f"recorded {record}; look at it again with: rerun {record}", soft_wrap=True)
