"""`searchparty vehicle`: look at a MAVLink vehicle, check it, fly a test square, show and set its fence."""

# ruff: noqa: PLC0415 - pymavlink and numpy are imported when the command runs, not when it is listed

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from bridges.mavlink.pilot_config import PilotConfig
    from bridges.mavlink.visit import Visit


SETTLE = 8.0  # s for what stops it from flying to go away, or to be explained


class Expected(StrEnum):
    """An autopilot."""

    AUTO = "auto"
    ARDUPILOT = "ardupilot"
    PX4 = "px4"


class Body(StrEnum):
    """What it drives."""

    ANY = "any"
    COPTER = "copter"
    ROVER = "rover"


def vehicle(
    url: Annotated[
        str,
        typer.Argument(
            metavar="URL",
            help="udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:..., serial:DEVICE:BAUD.",
        ),
    ],
    info: Annotated[
        bool, typer.Option("--info", help="Who it is, what it can do, how it is. The default.")
    ] = False,
    arm_check: Annotated[bool, typer.Option("--arm-check", help="What would stop it from flying.")] = False,
    fly_square: Annotated[
        float | None,
        typer.Option(
            "--fly-square", metavar="M", min=2.0, max=200.0, help="Fly a square of this side and land."
        ),
    ] = None,
    download: Annotated[
        bool, typer.Option("--download", help="Show the mission and the fence on board.")
    ] = False,
    fence: Annotated[
        str | None,
        typer.Option(
            "--fence", metavar="MISSION", help="Put the fence of this mission on board in place of its own."
        ),
    ] = None,
    height: Annotated[
        float, typer.Option(metavar="M", min=1.0, max=120.0, help="Metres above the ground for --fly-square.")
    ] = 5.0,
    yes: Annotated[
        bool, typer.Option("--yes", help="Ask nothing before arming or replacing a fence.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print what a program would read.")] = False,
    system_id: Annotated[
        int | None, typer.Option(min=1, max=255, help="Of the vehicle; else the only one there.")
    ] = None,
    autopilot: Annotated[Expected, typer.Option(help="Refuse any other.")] = Expected.AUTO,
    body: Annotated[Body, typer.Option("--type", help="Refuse any other.")] = Body.ANY,
    keys: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The secret of a vehicle that wants signed messages.")
    ] = None,
    our_system: Annotated[
        int | None, typer.Option(min=1, max=255, help="System id to speak as; else the vehicle's own.")
    ] = None,
    our_component: Annotated[int, typer.Option(min=1, max=255, help="Component id to speak as.")] = 191,
    patience: Annotated[
        float, typer.Option(metavar="S", min=1.0, max=300.0, help="Wait this long for it to answer.")
    ] = 10.0,
) -> None:
    """Say who a MAVLink vehicle is and what stops it from flying, fly a small square, or see to its fence.

    --fly-square arms, takes off, flies the corners and lands; Ctrl-C lands it at once. It asks before arming.
    The exit status is 0 if all is well, 1 if something stops it from flying or went wrong, 3 if it cannot be
    reached or is another than expected.

    \b
    Examples:
      searchparty vehicle udpin:0.0.0.0:14550
      searchparty vehicle tcp:127.0.0.1:5760 --arm-check --json
      searchparty vehicle serial:/dev/ttyACM0:115200 --system-id 3 --fly-square 10 --height 8
      searchparty vehicle udpin:0.0.0.0:14550 --download
      searchparty vehicle udpin:0.0.0.0:14550 --fence missions/field.toml
    """
    from agents.errors import MissionError
    from bridges.mavlink.pilot_config import Fallbacks, PilotConfig

    chosen = [
        name
        for name, given in (
            ("--info", info),
            ("--arm-check", arm_check),
            ("--fly-square", fly_square is not None),
            ("--download", download),
            ("--fence", fence is not None),
        )
        if given
    ]
    if len(chosen) > 1:
        raise MissionError(f"{' and '.join(chosen)} cannot be done at once; choose one")
    if as_json and (fly_square is not None or fence is not None):
        raise MissionError(f"--json goes with --info, --arm-check and --download, not with {chosen[0]}")
    config = PilotConfig(
        system=system_id,
        source_system=our_system,
        source_component=our_component,
        autopilot=autopilot.value,
        body=None if body is Body.ANY else "copter" if body is Body.COPTER else "rover",
        take_off_height=height,
        fly=fly_square is not None,
        # Who flies by hand is here: what is not understood ends on the ground, not in the air.
        fallbacks=Fallbacks(on_pose_stale="land", on_robot_silent="land"),
        url=url,
    )
    with _visit(url, config, keys, patience) as visit:
        if fly_square is not None:
            status = _fly(visit, fly_square, height, yes)
        elif download:
            status = _download(visit, as_json)
        elif fence is not None:
            from bridges.mavlink.fence_upload import put_on_board

            status = put_on_board(visit, fence, yes)
        elif arm_check:
            status = _arm_check(visit, as_json)
        else:
            status = _info(visit, url, as_json)
    raise typer.Exit(status)


def _visit(url: str, config: "PilotConfig", keys: Path | None, patience: float) -> "Visit":
    from bridges.mavlink.signing import read_keys
    from bridges.mavlink.visit import Visit

    def say(level: str, text: str) -> None:
        if level != "info":
            typer.echo(f"{level}: {text}", err=True)
        elif config.fly:
            typer.echo(text, err=True)

    return Visit(url, config, None if keys is None else read_keys(keys), patience, say)


def _info(visit: "Visit", url: str, as_json: bool) -> int:
    import json

    from bridges.mavlink import portrait

    visit.meet()
    report, rates = visit.listen()
    found = portrait.info(report, url, rates)
    if as_json:
        print(json.dumps(found, indent=2))
    else:
        _rows(portrait.info_lines(found))
    return 0


def _arm_check(visit: "Visit", as_json: bool) -> int:
    import json
    import time

    from bridges.mavlink import portrait

    visit.meet()
    report, _ = visit.listen()
    end = time.monotonic() + SETTLE
    while report.reasons and time.monotonic() < end:  # an estimator takes a while, and explains itself late
        report, _ = visit.listen(0.5)
    stops, notes = list(report.reasons), portrait.warnings(report)
    if report.armed:
        stops.append(f"it is armed already, in mode {report.mode}: somebody flies it")
    if as_json:
        print(json.dumps({"ok": not stops, "stops": stops, "warnings": notes}, indent=2))
        return 1 if stops else 0
    for reason in stops:
        print(f"stops it: {reason}")
    for note in notes:
        print(f"beware:   {note}")
    print(f"{_who(visit)} {'would not be armed' if stops else 'may be armed'}")
    return 1 if stops else 0


def _fly(visit: "Visit", size: float, height: float, yes: bool) -> int:
    from agents.errors import LinkError
    from bridges.mavlink import portrait
    from bridges.mavlink.square_run import Interrupts, fly

    with Interrupts() as interrupts:
        visit.meet()
        report, _ = visit.listen()
        if report.armed:
            raise LinkError(
                f"{_who(visit)} is armed already, in mode {report.mode}; it is left to who flies it"
            )
        for note in portrait.warnings(report):
            typer.echo(f"beware: {note}", err=True)
        up = f"climb to {height:g} m, " if report.body == "copter" else ""
        what = f"{_who(visit)} will arm, {up}go round a square of {size:g} m to the north and east, and "
        typer.echo(what + ("land where it began." if report.body == "copter" else "stop where it began."))
        if not yes and not _confirmed("Is nobody near it? Arm it now?"):
            typer.echo("nothing was armed", err=True)
            return 1
        return fly(visit, size, interrupts)


def _confirmed(question: str) -> bool:
    import sys

    from agents.errors import MissionError

    if not sys.stdin.isatty():
        raise MissionError("nobody can be asked here; give --yes if it may be done")
    return typer.confirm(question, default=False)


def _download(visit: "Visit", as_json: bool) -> int:
    import json

    from bridges.mavlink import portrait
    from bridges.mavlink.mission_items import PlanKind

    visit.meet()
    found = {kind.word: visit.download(kind) for kind in (PlanKind.MISSION, PlanKind.FENCE)}
    if as_json:
        print(json.dumps({word: portrait.plan_json(items) for word, items in found.items()}, indent=2))
        return 0
    for word, items in found.items():
        print(f"{word} on board: {len(items)} items" if items else f"{word} on board: none")
        for line in portrait.plan_lines(items):
            print(line)
    return 0


def _who(visit: "Visit") -> str:
    report = visit.bridge.report()
    return f"system {report.system}, a {report.body} with {report.autopilot} {report.version},"


def _rows(rows: list[tuple[str, str]]) -> None:
    """A table of two columns, wrapped to the terminal."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, show_header=False, padding=(0, 1), pad_edge=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    for name, text in rows:
        table.add_row(Text(name), Text(text))
    Console(highlight=False).print(table)
