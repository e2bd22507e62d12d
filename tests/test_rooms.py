"""The house stays in order: lower rooms never import higher ones."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MAY_IMPORT = {
    "estimator": set[str](),
    "planner": {"estimator"},
    "agents": {"estimator", "planner"},
    "bridges": {"estimator", "planner", "agents"},
    "sim": {"estimator", "planner", "agents", "bridges"},
}
READS_A_CLOCK = ROOT / "planner" / "deadline.py"  # the one file of the pure rooms that may
FILES = [path for room in MAY_IMPORT for path in sorted((ROOT / room).rglob("*.py"))]


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_a_file_imports_only_from_its_own_room_and_lower_ones(path: Path) -> None:
    room = path.relative_to(ROOT).parts[0]
    higher = (imported(path) & MAY_IMPORT.keys()) - MAY_IMPORT[room] - {room}
    assert not higher


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_only_bridges_know_the_outside_world(path: Path) -> None:
    if path.relative_to(ROOT).parts[0] != "bridges":
        assert not imported(path) & {"zenoh", "rerun", "pymavlink"}


@pytest.mark.parametrize(
    "path",
    [p for p in FILES if p.relative_to(ROOT).parts[0] in ("estimator", "planner")],
    ids=lambda p: str(p.relative_to(ROOT)),
)
def test_pure_rooms_read_no_clock_and_print_nothing(path: Path) -> None:
    impure = {"time", "logging", "asyncio", "socket", "threading", "random"}
    assert imported(path) & impure == ({"time"} if path == READS_A_CLOCK else set())
