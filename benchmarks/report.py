"""Measured against asked: a table for the terminal, and docs/figures.md."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.results import Figure, reached

DOCS = Path(__file__).resolve().parents[1] / "docs" / "figures.md"

_HEAD = """# Figures

Measured by `make bench`, recorded in benchmarks/results.json; this page is written from there by
`python -m benchmarks --docs`. Durations are medians unless the name or the note says otherwise. A value that
misses what is asked is shown as it is.
"""
_HEADINGS = ("figure", "measured", "asked", "reached", "others, same run", "note")


def number(value: float | None) -> str:
    """Three digits that count."""
    if value is None:
        return "-"
    if value == 0 or abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:.3g}"


def table(figures: Iterable[Figure]) -> Table:
    """For people at a terminal."""
    shown = Table(title="figures", padding=(0, 1, 0, 0))
    for heading in _HEADINGS[:5]:
        right = heading in ("measured", "asked")
        shown.add_column(heading, justify="right" if right else "left", no_wrap=heading == "figure" or right)
    for figure in figures:
        cells = _cells(figure)
        colour = {"yes": "green", "no": "red"}.get(cells[3])
        shown.add_row(*cells[:3], f"[{colour}]{cells[3]}[/]" if colour else cells[3], cells[4])
    return shown


def markdown(figures: Sequence[Figure]) -> str:
    """The whole of docs/figures.md."""
    lines = [_HEAD]
    if not figures:
        return "\n".join([*lines, "Nothing is recorded yet.", ""])
    for machine, versions in _places(figures):
        rows = [f for f in figures if _place(f) == (machine, versions)]
        lines += [f"On {machine}; {versions}:", ""]
        lines += ["| " + " | ".join(_HEADINGS) + " |", "| --- " * len(_HEADINGS) + "|"]
        lines += ["| " + " | ".join([f"`{f['name']}`", *_cells(f)[1:], _note(f)]) + " |" for f in rows]
        lines.append("")
    return "\n".join(lines)


def _cells(figure: Figure) -> list[str]:
    unit = figure["unit"]
    asked = figure.get("asked")
    bound = "at least" if figure.get("better") == "more" else "at most"
    peers = ", ".join(f"{who}: {number(value)} {unit}".rstrip() for who, value in figure["peers"].items())
    met = reached(figure)
    return [
        figure["name"],
        f"{number(figure['value'])} {unit}".rstrip(),
        "" if asked is None else f"{bound} {number(asked)} {unit}".rstrip(),
        "" if met is None else "yes" if met else "no",
        peers,
    ]


def _note(figure: Figure) -> str:
    parts = [figure["note"]] if figure.get("note") else []
    more: Mapping[str, Any] = figure.get("more", {})
    parts += [f"{key} {number(v) if isinstance(v, float | int) else v}" for key, v in more.items()]
    return "; ".join(parts)


def _place(figure: Figure) -> tuple[str, str]:
    machine, versions = figure["machine"], figure["versions"]
    return (
        f"{machine['cpu']}, {machine['cores']} cores, Python {machine['python']}",
        ", ".join(f"{name} {version}" for name, version in versions.items()),
    )


def _places(figures: Iterable[Figure]) -> list[tuple[str, str]]:
    return list(dict.fromkeys(_place(figure) for figure in figures))
