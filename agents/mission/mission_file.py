"""Read a mission file, refuse a wrong one with everything that is wrong in it, and write the resolved one.

The resolved mission holds every key, also those that the file left to their defaults, in the plugins' tables
too. Paths in it stay as written; they begin at `Mission.directory`, the directory of the file they were
written in, which is no part of what the mission is.
"""

import hashlib
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import tomli_w

from agents import plugins
from agents.errors import MissionError
from agents.mission.mission import ExplorationTable, Mission
from agents.mission.mission_checks import GROUPS, ROBOT_GROUPS, check_kind_table, check_mission, kind_tables
from agents.mission.tables import Problem, check, convert, nearest, not_finite

# A list of numbers as tomli_w writes it, one a line.
_NUMBERS = re.compile(r"= \[\n((?: +[-+0-9.e]+,\n)+)\]")


class WrongMissionError(MissionError):
    """A mission file with all that is wrong in it."""

    def __init__(self, file: str, problems: Sequence[Problem]) -> None:
        super().__init__("\n".join(f"{file}: {problem}" for problem in problems))
        self.file = file
        self.problems = tuple(problems)


def load(path_or_name: str | Path, *, seed: int | None = None, duration: float | None = None) -> Mission:
    """The resolved mission of a file, or of an installed example by its name.

    Args:
        path_or_name: a path, or a name out of `examples()` such as "quickstart".
        seed: takes the place of the file's.
        duration: takes the place of the file's duration_s, seconds.

    Raises:
        WrongMissionError: naming for each mistake the key, what was found, what is allowed and what is near.
        MissionError: if there is no such file.
    """
    path = find(path_or_name)
    raw = _read(path)
    if seed is not None:
        raw["seed"] = seed
    if duration is not None:
        raw["duration_s"] = duration
    _fit_exploration(raw)
    problems = not_finite(raw)
    found = check(raw, Mission)
    right_so_far = not problems and not found
    for where, group, table in kind_tables(raw):
        found += check_kind_table(where, group, table)
    if right_so_far:
        mission = convert(raw, Mission)
        found += check_mission(mission)
    seen = {problem.key for problem in problems}
    problems += [problem for problem in found if problem.key not in seen]
    if problems:
        raise WrongMissionError(str(path), problems)
    directory = path.resolve().parent / Path(mission.directory).expanduser()
    return _resolved(mission, str(directory))


def dumps(mission: Mission) -> str:
    """The mission as TOML that `load` reads back as the same mission.

    The directory is written only where a relative path depends on it.
    """
    text = tomli_w.dumps(_plain(mission, keep_directory=_has_relative_path(mission)))
    return _NUMBERS.sub(lambda found: f"= [{', '.join(found[1].replace(',', '').split())}]", text)


def mission_hash(mission: Mission) -> str:
    """64 hexadecimal digits that two processes share if and only if their resolved missions are the same.

    The seed does not count: the fusion may have been given another, and tells it to everyone.
    """
    plain = _plain(mission, keep_directory=False)
    del plain["seed"]
    return hashlib.sha256(msgspec.json.encode(plain, order="deterministic")).hexdigest()


def examples() -> tuple[str, ...]:
    """The names of the missions that come with searchparty."""
    return tuple(sorted(path.stem for path in _examples_directory().glob("*.toml")))


def find(path_or_name: str | Path) -> Path:
    """The file that is meant.

    Raises:
        MissionError: if there is none.
    """
    path = Path(path_or_name).expanduser()
    if path.is_file():
        return path
    name = str(path_or_name)
    if name in examples():
        return _examples_directory() / f"{name}.toml"
    if path.is_dir():
        raise MissionError(f"{path} is a directory; give the mission file in it")
    near = nearest(path.stem, examples())
    hint = f"; nearest is {near}" if near else ""
    raise MissionError(
        f"{path}: no such mission file; give a path, or an example's name: {', '.join(examples())}{hint}"
    )


def _examples_directory() -> Path:
    here = Path(__file__).resolve().parent.parent
    installed = here / "missions"  # where the wheel puts them
    return installed if installed.is_dir() else here.parent / "missions"


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_bytes().decode())
    except OSError as error:
        raise MissionError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        problem = Problem("", f"byte {error.start} is not UTF-8", "TOML in UTF-8")
    except tomllib.TOMLDecodeError as error:
        problem = Problem("", f"not TOML: {error}")  # ends in "(at line 3, column 5)"
    except RecursionError:
        problem = Problem("", "not a mission: nested too deeply")
    raise WrongMissionError(str(path), [problem])


def _fit_exploration(raw: dict[str, Any]) -> None:
    """Give an exploration grid that the file leaves open as many dimensions as the area."""
    area = raw.get("area")
    low = area.get("min") if isinstance(area, dict) else None
    table = raw.setdefault("exploration", {})
    if isinstance(table, dict) and isinstance(low, list) and 2 <= len(low) <= 3:
        table.setdefault("points", ExplorationTable().points[:1] * len(low))


def _resolved(mission: Mission, directory: str) -> Mission:
    robots = [
        msgspec.structs.replace(
            robot, **{key: _full(getattr(robot, key), g) for key, g in ROBOT_GROUPS.items()}
        )
        for robot in mission.robots
    ]
    tables = {key: _full(getattr(mission, key), group) for key, group in GROUPS.items()}
    return msgspec.structs.replace(mission, robots=robots, directory=directory, **tables)


def _full(table: dict[str, Any], group: str) -> dict[str, Any]:
    """A plugin's table with its defaults."""
    body = {key: value for key, value in table.items() if key != "kind"}
    config = convert(body, plugins.load(group, table["kind"]).Config)
    plain: dict[str, Any] = _without_none(msgspec.to_builtins(config, enc_hook=_text))
    return {"kind": table["kind"], **plain}


def _plain(mission: Mission, *, keep_directory: bool) -> dict[str, Any]:
    plain: dict[str, Any] = _without_none(msgspec.to_builtins(mission, enc_hook=_text))
    if not keep_directory:
        del plain["directory"]
    return plain


def _has_relative_path(mission: Mission) -> bool:
    if mission.map is not None and _relative_path_in(Path(mission.map.file)):
        return True
    if mission.link.keys and _relative_path_in(Path(mission.link.keys)):
        return True
    ground = mission.ground
    zones = [] if ground is None else [*ground.obstacles, *ground.keep_out, *ground.geofence]
    if any(zone.file is not None and _relative_path_in(Path(zone.file)) for zone in zones):
        return True
    for _, group, table in kind_tables(msgspec.to_builtins(mission)):
        body = {key: value for key, value in table.items() if key != "kind"}
        if _relative_path_in(convert(body, plugins.load(group, table["kind"]).Config)):
            return True
    return False


def _relative_path_in(value: Any) -> bool:
    if isinstance(value, Path):
        return not value.expanduser().is_absolute()
    if isinstance(value, msgspec.Struct):
        return any(_relative_path_in(getattr(value, name)) for name in value.__struct_fields__)
    if isinstance(value, dict):
        return any(map(_relative_path_in, value.values()))
    return isinstance(value, list | tuple) and any(map(_relative_path_in, value))


def _text(value: Any) -> str:
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a mission cannot hold a {type(value).__name__}")


def _without_none(value: Any) -> Any:
    """TOML has no null: a key that is None is left out, which reads back as None."""
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value
