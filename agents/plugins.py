"""Find a kind by its name through Python entry points, ours and other people's packages' alike."""

import difflib
from functools import cache
from importlib.metadata import entry_points
from typing import Any

from agents.errors import MissionError


@cache
def _installed() -> Any:
    """All entry points. To look through the installed packages takes 15 ms, and a mission asks a dozen times.

    (Python 3.11 has another type for them than those after it; both can `select`.)
    """
    return entry_points()


@cache
def kinds(group: str) -> tuple[str, ...]:
    """All kinds installed in one group ("vehicles", "sensors", "worlds", "filters", "planners", ...)."""
    return tuple(sorted({point.name for point in _installed().select(group=f"searchparty.{group}")}))


@cache
def load(group: str, kind: str) -> Any:
    """The plugin of one kind.

    Raises:
        MissionError: if no installed package offers it, with the nearest that is.
    """
    for point in _installed().select(group=f"searchparty.{group}"):
        if point.name == kind:
            return point.load()
    near = difflib.get_close_matches(kind, kinds(group), n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise MissionError(f"no {group} kind {kind!r}; installed are {', '.join(kinds(group)) or 'none'}{hint}")
