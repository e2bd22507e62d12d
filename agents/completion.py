"""What the shell offers while a command is typed. Quick: what it needs, it imports itself."""

# ruff: noqa: PLC0415

from pathlib import Path

import typer

from agents.errors import SearchpartyError


def complete_mission(incomplete: str) -> list[str]:
    """Names of examples, mission files, and directories on the way to them."""
    from agents.mission.mission_file import examples

    head, _, tail = incomplete.rpartition("/")
    directory = Path(head or ("/" if incomplete.startswith("/") else ".")).expanduser()
    prefix = incomplete[: len(incomplete) - len(tail)]
    names = [name for name in examples() if name.startswith(incomplete)]
    try:
        entries = sorted(directory.iterdir())
    except OSError:
        return names
    for entry in entries:
        if entry.name.startswith(tail) and not (entry.name.startswith(".") and not tail):
            if entry.is_dir():
                names.append(f"{prefix}{entry.name}/")
            elif entry.suffix == ".toml":
                names.append(prefix + entry.name)
    return names


def complete_robot(ctx: typer.Context, incomplete: str) -> list[str]:
    """The ids of the robots in the mission that was typed before."""
    from agents.mission.mission_file import load

    try:
        robots = load(ctx.params["mission"]).robots
    except (KeyError, SearchpartyError):
        return []
    return [robot.id for robot in robots if robot.id.startswith(incomplete)]
