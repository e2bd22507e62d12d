"""The tables of docs/ that can be read off the code; the tests compare, so that the docs stay true.

`python -m tests.packaging.docs_tables` prints what the code says of missions now.
"""

import tomllib
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import msgspec

from agents import plugins
from agents.mission import mission
from agents.mission.ground_tables import GroundTable, OriginTable, ZoneTable
from agents.mission.tables import describe, show
from agents.wire import codec
from agents.wire import messages as m
from agents.wire.topics import TOPICS

ROOT = Path(__file__).resolve().parents[2]
KIND_GROUPS = ("worlds", "filters", "planners", "vehicles", "sensors")
MISSION_TABLES: dict[str, type[msgspec.Struct]] = {
    "## Top level": mission.Mission,
    "## [area]": mission.AreaTable,
    "## [origin]": OriginTable,
    "## [map]": mission.MapTable,
    "## [ground]": GroundTable,
    "## Zones": ZoneTable,
    "## [found]": mission.FoundTable,
    "## [teammates]": mission.TeammatesTable,
    "## [exploration]": mission.ExplorationTable,
    "## [trigger]": mission.TriggerTable,
    "## [fusion]": mission.FusionTable,
    "## [link]": mission.LinkTable,
    "## [settings]": mission.TeamTable,
    "## [clock]": mission.ClockTable,
    "## [restart]": mission.RestartTable,
    "## [[robots]]": mission.RobotTable,
    "## [[statements]]": mission.StatementTable,
    "## [[requests]]": mission.RequestTable,
}
DTYPES = {"<f8": "float64", "<f4": "float32", "|u1": "uint8", "<i8": "int64"}


def topic_rows() -> list[str]:
    """One row of docs/messages.md for each topic."""
    rows = []
    for topic in TOPICS.values():
        rate = f"{topic.rate_hz:g}" if topic.rate_hz else "on occasion"
        carried = f"reliable, {topic.history} kept for late joiners" if topic.reliable else "best effort"
        stale = f"{topic.stale_after_s:g} s: {topic.when_stale}" if topic.stale_after_s else topic.when_stale
        rows.append(
            f"| `{topic.name}` | {topic.message.__name__} | {carried} | {rate} | {topic.queue} | "
            f"{topic.drop.value} | {topic.max_bytes:,} | {stale} |"
        )
    return rows


def message_fields(kind: type[m.Message]) -> dict[str, str]:
    """How docs/messages.md gives the type of each field of a message, without the header's."""
    header = set(m.Message.__struct_fields__) if kind is not m.Message else set()
    hints = get_type_hints(kind)
    arrays = codec.ARRAYS.get(kind, {})
    return {
        name: _array(arrays[name]) if name in arrays else _type_name(hints[name])
        for name in kind.__struct_fields__
        if name not in header
    }


def _array(spec: codec.ArraySpec) -> str:
    axes = "g1, ..., gd" if spec.shape[0] is ... else ", ".join(map(str, spec.shape))
    return f"{DTYPES[spec.dtype]} ({axes}{',' if len(spec.shape) == 1 else ''})"


def _type_name(hint: Any) -> str:
    name = getattr(hint, "__name__", str(hint))
    return (
        name
        if "[" not in str(hint)
        else str(hint).replace("agents.wire.messages.", "").replace("typing.", "")
    )


def dependencies() -> dict[str, str]:
    """Name -> extra ("" for none) of everything that pyproject.toml asks for."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lists = {"": project["dependencies"], **project.get("optional-dependencies", {})}
    return {
        requirement.split("[")[0].split(">")[0].split("=")[0].strip(): extra
        for extra, requirements in lists.items()
        for requirement in requirements
    }


def key_rows(kind: type[msgspec.Struct], *, nested: bool = True, prefix: str = "") -> list[str]:
    """How a table of docs/mission.md begins its rows: key, what it may hold, default. Nested tables' keys are
    given with a dot, or with `nested` False left to sections of their own."""
    rows = []
    for field in msgspec.structs.fields(kind):
        name = prefix + field.encode_name
        inner = struct_in(field.type)
        if inner is not None and nested:
            rows += key_rows(inner, prefix=f"{name}.")
        elif inner is None:
            allowed = describe(field.type).replace("|", "\\|")
            rows.append(f"| `{name}` | {allowed} | {_default(field)} |")
    return rows


def struct_in(hint: Any) -> type[msgspec.Struct] | None:
    """The Struct that a key's table is, or may be."""
    for part in (hint, *get_args(hint)):
        if isinstance(part, type) and issubclass(part, msgspec.Struct):
            return part
        if isinstance(part, type(list[int])) or get_origin(part) is Annotated:
            inner = struct_in(get_args(part)[0])
            if inner is not None:
                return inner
    return None


def _default(field: msgspec.structs.FieldInfo) -> str:
    if field.required:
        return "required"
    default = field.default if field.default is not msgspec.NODEFAULT else _made(field)
    if default is None:
        return "none"
    return show(list(default) if isinstance(default, tuple) else default)


def _made(field: msgspec.structs.FieldInfo) -> Any:
    factory = field.default_factory
    assert callable(factory)
    return factory()


def our_kinds() -> list[tuple[str, str]]:
    """(group, kind) of every plugin with a table of its own that this package brings along."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    groups = {name.removeprefix("searchparty."): kinds for name, kinds in project["entry-points"].items()}
    return [(group, kind) for group in KIND_GROUPS for kind in groups[group]]


def own_rows(group: str, kind: str) -> list[str]:
    """The rows of a kind's table, without those that it shares with the kind that it extends."""
    config = plugins.load(group, kind).Config
    rows = key_rows(config)
    for other_group, other in our_kinds():
        if other_group == group and other != kind:
            base = plugins.load(group, other).Config
            if issubclass(config, base) and config is not base:
                return [row for row in rows if row not in key_rows(base)]
    return rows


def section(page: str, heading: str) -> str:
    """The text under one heading of a page in docs/, up to the next heading."""
    lines = (ROOT / "docs" / page).read_text().splitlines()
    start = lines.index(heading)
    end = next((i for i in range(start + 1, len(lines)) if lines[i].startswith("#")), len(lines))
    return "\n".join(lines[start + 1 : end])


if __name__ == "__main__":
    for heading, table in MISSION_TABLES.items():
        print("", heading, *key_rows(table, nested=False), sep="\n")
    for group, kind in our_kinds():
        print("", f"### {group[:-1]} `{kind}`", *own_rows(group, kind), sep="\n")
