"""The record of the figures, benchmarks/results.json: from pytest-benchmark's own file, and merged.

A benchmark says what its figure is in `benchmark.extra_info`. Without a word the figure has the test's name
(test_link_round_trip[slow] is link_round_trip_slow) and its value is the median duration in ms. The words:
`unit` (us, ms, s), `asked` (the limit to reach), `better` ("less", the default, or "more"), `peers` (what
others took in the same run), `note`, `more` (what else was seen). A test with several figures, or one that is
no duration, gives `figures`, a list of the same with `name` and `value`.
"""

import json
import os
import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

Figure = dict[str, Any]

RESULTS = Path(__file__).with_name("results.json")
PACKAGES = ("numpy", "numba", "scipy", "eclipse-zenoh", "msgpack", "msgspec", "rerun-sdk", "searchparty")

_PER_SECOND = {"us": 1e6, "ms": 1e3, "s": 1.0}
_WORDS = ("unit", "asked", "better", "peers", "note", "more")


def default_name(test: str) -> str:
    """The figure's name of a test that gives none."""
    return re.sub(r"\W+", "_", test.removeprefix("test_")).strip("_")


def figures(report: Mapping[str, Any], machine: Figure, versions: Mapping[str, str]) -> list[Figure]:
    """The figures in a report of pytest-benchmark (its --benchmark-json), in its order.

    Raises:
        ValueError: if two benchmarks give a figure of the same name, or a unit is no unit of time.
    """
    made: list[Figure] = []
    for benchmark in report["benchmarks"]:
        info = benchmark["extra_info"]
        for words in info.get("figures") or [_median(benchmark, info)]:
            figure = {"name": words["name"], "value": words["value"], "unit": words["unit"]}
            figure["asked"] = words.get("asked")
            figure["better"] = words.get("better", "less")
            figure["peers"] = words.get("peers", {})
            figure |= {key: words[key] for key in ("note", "more") if key in words}
            made.append(figure | {"machine": machine, "versions": dict(versions)})
    names = [figure["name"] for figure in made]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"more than one benchmark gives {', '.join(twice)}")
    return made


def _median(benchmark: Mapping[str, Any], info: Mapping[str, Any]) -> Figure:
    words = {key: info[key] for key in _WORDS if key in info}
    unit = words.setdefault("unit", "ms")
    if unit not in _PER_SECOND and "value" not in info:
        raise ValueError(f"{benchmark['name']}: a median has one of the units {', '.join(_PER_SECOND)}")
    value = info["value"] if "value" in info else benchmark["stats"]["median"] * _PER_SECOND[unit]
    if "value" not in info:
        times = benchmark["stats"]
        words["more"] = {
            "min": times["min"] * _PER_SECOND[unit],
            "rounds": times["rounds"],
            **words.get("more", {}),
        }
    return {"name": info.get("name", default_name(benchmark["name"])), "value": value, **words}


def reached(figure: Mapping[str, Any]) -> bool | None:
    """Whether a figure is what was asked; None if nothing was."""
    asked = figure.get("asked")
    if asked is None:
        return None
    if figure["value"] is None:
        return False
    return bool(figure["value"] >= asked if figure.get("better") == "more" else figure["value"] <= asked)


def merged(old: Iterable[Figure], new: Iterable[Figure]) -> list[Figure]:
    """The old figures in their places, those measured anew replaced, others added at the end."""
    fresh = {figure["name"]: figure for figure in new}
    kept = [fresh.pop(figure["name"], figure) for figure in old]
    return [*kept, *fresh.values()]


def read(path: Path = RESULTS) -> list[Figure]:
    """The recorded figures; none if nothing was recorded yet."""
    if not path.exists():
        return []
    recorded: list[Figure] = json.loads(path.read_text())
    return recorded


def write(figures: Sequence[Figure], path: Path = RESULTS) -> None:
    """Replace the record in one go: a reader sees the old one or the new one."""
    draft = path.with_suffix(".tmp")
    draft.write_text(json.dumps(list(figures), indent=2) + "\n")
    draft.replace(path)


def this_machine() -> Figure:
    """What the figures were measured on, and how busy others kept it."""
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "memory_gb": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "load_before": round(os.getloadavg()[0], 2),
    }


def _cpu() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"


def these_versions() -> dict[str, str]:
    """Of the packages on which the figures depend."""
    return {name: metadata.version(name) for name in PACKAGES}
