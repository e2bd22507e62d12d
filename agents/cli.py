"""The command `searchparty`.

Only typer is imported here: what a command needs, it imports itself, so that --help and completion are quick
and a robot's process holds nothing that it does not use.
"""

# ruff: noqa: PLC0415

import os
import sys
import tempfile
import traceback
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from agents.completion import complete_mission, complete_robot
from agents.errors import SearchpartyError
from agents.lazy_commands import LazyGroup

app = typer.Typer(
    cls=LazyGroup,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


class View(StrEnum):
    """How a person looks at the team."""

    AUTO = "auto"  # spawn where there is a screen, else none
    NONE = "none"
    SPAWN = "spawn"
    WEB = "web"


MissionArgument = Annotated[
    str,
    typer.Argument(
        metavar="MISSION",
        help="A mission file, or the name of an installed example such as quickstart.",
        autocompletion=complete_mission,
    ),
]
Seed = Annotated[int | None, typer.Option(min=0, help="Take this seed instead of the mission's.")]
Speed = Annotated[float, typer.Option(min=0.01, max=1e4, help="Team seconds per second.")]
Connect = Annotated[
    list[str] | None,
    typer.Option(
        metavar="ENDPOINT", help="Where the team's router is, such as tcp/192.0.2.1:7447. Repeatable."
    ),
]


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"searchparty {version('searchparty')}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """A team of robots, one process each, finds and tracks an unknown number of targets.

    \b
    Examples:
      searchparty swarm quickstart
      searchparty check missions/quickstart.toml
      searchparty simulate quickstart --seeds 0:20
    """


@app.command(short_help="Launch the whole team here, one process per robot.")
def swarm(
    mission: MissionArgument,
    seed: Seed = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="The run directory; else a new one in runs/.")
    ] = None,
    speed: Speed = 1.0,
    duration: Annotated[
        float | None, typer.Option(min=0.001, help="Take this many team seconds instead of the mission's.")
    ] = None,
    view: Annotated[View, typer.Option(help="Where to show the team; it is recorded always.")] = View.AUTO,
) -> None:
    """Launch the whole team on this machine, one process per robot, and look after it.

    Ctrl-C ends everything. The exit status is 0 if every target was found.

    \b
    Examples:
      searchparty swarm quickstart
      searchparty swarm missions/quickstart.toml --seed 3 --speed 4 --out runs/third --view none
    """
    from contextlib import nullcontext

    from agents.process.nursery import Nursery

    with Nursery.start(mission) or nullcontext() as nursery:  # first of all: it loads while we do
        from agents.mission.mission_file import load

        resolved = load(mission, seed=seed, duration=duration)
        from agents.swarm import swarm as launcher

        status = launcher.run(resolved, out=out, speed=speed, view=view.value, nursery=nursery)
    raise typer.Exit(status)


@app.command(short_help="Run one robot of a team.")
def robot(
    mission: MissionArgument,
    robot_id: Annotated[
        str,
        typer.Option(
            "--id", metavar="ID", help="Which of the mission's robots.", autocompletion=complete_robot
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(metavar="DIR", help="Where it keeps the sets that no fusion has; give the same again."),
    ] = Path("runs", "robots"),
    connect: Connect = None,
) -> None:
    """Run one robot: what swarm starts for each, here by hand on the robot's own computer.

    Killed and started again with the same --out it offers again what it had measured before.

    \b
    Example:
      searchparty robot mission.toml --id r1 --connect tcp/192.0.2.1:7447
    """
    from agents.mission.mission_file import load

    resolved = load(mission)  # a wrong mission is told before anything else is imported
    from agents.process import robot_process
    from agents.swarm.run_directory import RunDirectory

    outbox = RunDirectory(out).outbox_of(robot_id)
    raise typer.Exit(robot_process.run(resolved, robot_id, outbox=outbox, connect=connect or []))


@app.command(short_help="Run the fusion service of a team.")
def fusion(
    mission: MissionArgument,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where the ledger is, or will be; else a new directory in runs/."),
    ] = None,
    name: Annotated[
        str, typer.Option("--id", metavar="ID", help="Which of the mission's fusions, if it has several.")
    ] = "fusion",
    connect: Connect = None,
    seed: Seed = None,
    speed: Speed = 1.0,
) -> None:
    """Run the fusion service, which keeps the ledger and the team's posterior, and starts the team.

    Started again with the same --out it goes on where it was. Where the mission has several
    (fusion.replicas), each has its own ledger; they are fusion, fusion-2 and so on.

    \b
    Example:
      searchparty fusion mission.toml --out runs/today --connect tcp/192.0.2.1:7447
    """
    from agents.mission.mission_file import load

    resolved = load(mission, seed=seed)
    from agents.process import fusion_process
    from agents.swarm.run_directory import RunDirectory

    directory = _existing(out) if out is not None else RunDirectory.create(resolved, None).path
    ledger = RunDirectory(directory).ledger_of(name)
    raise typer.Exit(
        fusion_process.run(resolved, ledger=ledger, connect=connect or [], speed=speed, name=name)
    )


def _existing(directory: Path) -> Path:
    from agents.errors import StorageError

    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"cannot make {directory}: {error.strerror}; choose another --out") from error
    return directory


@app.command(short_help="Validate a mission and print it with every key resolved.")
def check(
    mission: MissionArgument,
    as_json: Annotated[bool, typer.Option("--json", help="Print what a program would read.")] = False,
) -> None:
    """Validate a mission and print it with every key resolved; exit status 2 if it is wrong.

    \b
    Examples:
      searchparty check missions/quickstart.toml
      searchparty check quickstart > my_mission.toml
      searchparty check quickstart --json
    """
    from agents.mission.mission_check import check as run

    raise typer.Exit(run(mission, as_json=as_json))


@app.command(short_help="Compile the numeric kernels, once.")
def warm(
    mission: Annotated[
        str | None,
        typer.Argument(
            metavar="[MISSION]",
            help="Only what this mission needs; else everything.",
            autocompletion=complete_mission,
        ),
    ] = None,
) -> None:
    """Compile the numeric kernels once, to the disk, so that robots start quickly.

    \b
    Examples:
      searchparty warm
      searchparty warm missions/quickstart.toml
    """
    from rich.console import Console

    from agents.mission.mission_file import load
    from agents.process import warm as kernels

    kernels.ensure(Console(stderr=True), None if mission is None else load(mission))


def main() -> None:
    """Entry point: errors become one sentence on stderr and an exit status."""
    try:
        app(prog_name="searchparty")
    except SearchpartyError as error:
        _complain(str(error))
        sys.exit(error.exit_code)
    except Exception as error:
        _complain(_unexpected(error))
        sys.exit(1)


def _complain(text: str) -> None:
    print(f"searchparty: {text}", file=sys.stderr)


def _unexpected(error: Exception) -> str:
    """One sentence for the user, and the traceback in a file for whoever mends it."""
    sentence = f"unexpected error: {type(error).__name__}: {error}"
    if isinstance(error, OSError) and error.filename is not None:
        sentence = f"{error.filename}: {error.strerror}"
    try:
        handle, path = tempfile.mkstemp(prefix="searchparty-", suffix=".log")
        with os.fdopen(handle, "w") as file:
            traceback.print_exception(error, file=file)
    except OSError:
        traceback.print_exception(error)
        return sentence
    return f"{sentence} (details in {path})"


if __name__ == "__main__":
    main()
