"""What `searchparty check` prints."""

import json
import sys
from typing import Any

import msgspec
from rich.console import Console
from rich.syntax import Syntax

from agents.errors import DataError, MissionError
from agents.mission.mission import Mission
from agents.mission.mission_file import WrongMissionError, dumps, find, load, mission_hash
from agents.team import Team


def check(path_or_name: str, *, as_json: bool) -> int:
    """Print the resolved mission on stdout, so that it can be kept as a file, or its mistakes; exit status.

    Raises:
        MissionError: if the mission is wrong and a person is to read why.
    """
    try:
        mission = load(path_or_name)
        lacking = _refused_by_plugins(mission)
    except MissionError as error:
        if not as_json:
            raise
        print(json.dumps(_mistakes(path_or_name, error), indent=2))
        return error.exit_code
    if as_json:
        plain = msgspec.to_builtins(mission)
        head = {"ok": True, "file": str(find(path_or_name)), "hash": mission_hash(mission)}
        print(json.dumps({**head, "lacking": lacking, "mission": plain}, indent=2))
    else:
        _print(mission)
        for sentence in lacking:
            print(f"but not to be run here: {sentence}", file=sys.stderr)
    return 0


def _refused_by_plugins(mission: Mission) -> list[str]:
    """What this machine lacks for a mission that is right; raises MissionError if it is not."""
    try:
        Team.of(mission).world(mission.seed)
    except DataError as error:
        return [str(error)]
    return []


def _mistakes(path_or_name: str, error: MissionError) -> dict[str, Any]:
    if isinstance(error, WrongMissionError):
        file, problems = error.file, [msgspec.to_builtins(problem) for problem in error.problems]
    else:
        file, problems = path_or_name, [{"key": "", "found": str(error), "allowed": "", "nearest": ""}]
    return {"ok": False, "file": file, "problems": problems}


def _print(mission: Mission) -> None:
    text = dumps(mission)
    if sys.stdout.isatty():
        Console().print(Syntax(text, "toml", background_color="default"))
    else:
        print(text, end="")
    d, robots = mission.box().dimension, len(mission.robots)
    note = f"{mission.name}: right; {robots} robot{'s' * (robots > 1)} in {d}D, {mission_hash(mission)[:12]}"
    print(note, file=sys.stderr)
