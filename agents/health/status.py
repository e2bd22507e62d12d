"""`searchparty status`: how the processes of a running team are, seen from any of its computers."""

# ruff: noqa: PLC0415 - the network and numpy are imported when the command runs, not when it is listed

from typing import TYPE_CHECKING, Annotated

import typer

from agents.cli import Connect, MissionArgument

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from agents.health.team_health import HealthBoard, TeamHealth
    from agents.mission.mission import Mission
    from agents.process.shell import Shell
    from agents.wire.messages import StartMessage

LOOK_S = 0.05  # between two looks at what has come


def status(
    mission: MissionArgument,
    as_json: Annotated[bool, typer.Option("--json", help="Print what a program would read.")] = False,
    watch: Annotated[bool, typer.Option("--watch", help="Go on until Ctrl-C.")] = False,
    seconds: Annotated[
        float, typer.Option(metavar="S", min=1.0, max=600.0, help="Listen this long before saying anything.")
    ] = 4.0,
    connect: Connect = None,
) -> None:
    """Say how every process of a running team is: alive, heard at its rate, valid; queues, drops, refusals,
    lateness, memory, clock.

    The exit status is 0 if all is well, 1 if not, and 3 if nobody is there.

    \b
    Examples:
      searchparty status mission.toml
      searchparty status mission.toml --json --connect tcp/192.0.2.1:7447
      searchparty status mission.toml --watch
    """
    import asyncio

    from agents.mission.mission_file import load

    raise typer.Exit(asyncio.run(_main(load(mission), as_json, watch, seconds, tuple(connect or ()))))


async def _main(
    mission: "Mission", as_json: bool, watch: bool, seconds: float, connect: tuple[str, ...]
) -> int:
    import time

    import msgspec
    from rich.console import Console
    from rich.live import Live

    from agents.errors import LinkError
    from agents.health.team_health import HealthBoard
    from agents.process.shell import Shell
    from agents.wire.roles import ROLES
    from agents.wire.topics import TOPICS

    console = Console()
    async with Shell(mission, "status", "status", connect) as shell:
        board = HealthBoard(mission, shell.vitals)
        for name in ROLES["status"].hears:
            if name != "state":  # a whole filter's state: nobody needs to look at that
                shell.transport.subscribe(TOPICS[name], urgent=False)
        if not await _listen(shell, board, time.monotonic() + seconds):
            where = " or ".join(connect or mission.link.endpoints)
            raise LinkError(
                f"nobody of the team {mission.team} is at {where}: start it, or correct --connect"
            )
        report = _report(shell, board)
        if not watch:
            _print(console, report, as_json)
            return 0 if report.healthy else 1
        with Live(console=console, auto_refresh=False) as live:
            while not shell.stopping:
                if as_json:
                    print(msgspec.json.encode(report).decode(), flush=True)
                else:
                    live.update(table(report), refresh=True)
                await _listen(shell, board, time.monotonic() + 1.0)
                report = _report(shell, board)
    return 0 if report.healthy else 1


async def _listen(shell: "Shell", board: "HealthBoard", until: float) -> bool:
    """Take in what the team says; False if nobody is there."""
    import asyncio
    import time

    from agents.machine import Heard
    from agents.wire.messages import StartMessage
    from agents.wire.transport import PeerChange

    while time.monotonic() < until and not shell.stopping:
        for event in shell.events():
            if isinstance(event, PeerChange):
                board.on_peer(event)
            elif isinstance(event, Heard):
                board.on_message(event.message)
                if isinstance(event.message, StartMessage):
                    _start(shell, board, event.message)
        await asyncio.sleep(LOOK_S)
    return any(role != "status" for role in board.peers.values())


def _start(shell: "Shell", board: "HealthBoard", message: "StartMessage") -> None:
    from agents.mission.mission_file import mission_hash

    if shell.sync is None:
        shell.adopt(message)
    if message.mission_hash != mission_hash(shell.mission) and not board.warnings:
        board.warnings.append(f"{message.sender} runs another version of this mission file")


def _report(shell: "Shell", board: "HealthBoard") -> "TeamHealth":
    import time

    known = shell.sync is not None
    now = shell.clock.now() if known else None
    return board.report(time.monotonic(), shell.clock.speed, now)


def _print(console: "Console", report: "TeamHealth", as_json: bool) -> None:
    import json

    import msgspec

    if as_json:
        print(json.dumps(msgspec.to_builtins(report), indent=2))
    else:
        console.print(table(report))


def table(report: "TeamHealth") -> "RenderableType":
    """For people, a row for each process, and below it what is wrong."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    rows = Table(box=None, padding=(0, 1), header_style="dim", pad_edge=False)
    rows.add_column("process", no_wrap=True, min_width=10)
    rows.add_column("state", no_wrap=True)
    for name in ("heard", "queue", "dropped", "refused", "late ms", "clock ms", "MB"):
        rows.add_column(name, justify="right", no_wrap=True)
    for p in report.processes:
        alive = [t for t in p.topics.values() if t.alive]
        good = sum(t.rate_ok and t.valid for t in alive)
        offset, error = p.clock.get("offset_ms"), p.clock.get("error_ms", 0.0)
        late = max(p.late_ms.values(), default=None)
        rows.add_row(
            Text(p.id if p.role == p.id else f"{p.role} {p.id}"),
            Text(p.state or "-") if p.alive else Text("gone", style="bold red"),
            Text(f"{good}/{len(alive)}", style="" if good == len(alive) else "yellow"),
            _number(sum(p.queues.values())),
            _number(sum(p.dropped.values())),
            _number(sum(p.rejected.values())),
            Text("-" if late is None else f"{late:.0f}"),
            Text("-" if offset is None else f"{offset:+.1f}±{error:.1f}"),
            Text("-" if p.memory_mb is None else f"{p.memory_mb:.0f}"),
        )
    clock = "no team time" if report.time_s is None else f"{report.time_s:.0f} s"
    sets = "-" if report.sets_applied is None else str(report.sets_applied)
    head = Text.assemble(
        (report.mission, "bold"),
        f"  {clock}  sets {sets}  ",
        ("healthy", "bold green") if report.healthy else (f"{len(report.problems)} problems", "bold yellow"),
    )
    below = [
        Text(f"{p.id}: {p.vehicle}", style="dim", no_wrap=True, overflow="ellipsis")
        for p in report.processes
        if p.vehicle and p.alive
    ]
    below += [Text(f"! {problem}", style="yellow") for problem in report.problems[:20]]
    hidden = len(report.problems) - 20
    if hidden > 0:
        below.append(Text(f"and {hidden} more", style="dim"))
    return Group(head, rows, *below)


def _number(value: float) -> "RenderableType":
    from rich.text import Text

    return Text(f"{value:.0f}", style="yellow" if value else "dim")
