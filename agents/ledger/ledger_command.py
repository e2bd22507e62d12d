"""`searchparty ledger`: what a run's ledgers hold, and their entries for other programs."""

import json
from pathlib import Path
from typing import Annotated

import typer

# ruff: noqa: PLC0415 - the command line imports what a command needs when it is used


def ledger(
    place: Annotated[Path, typer.Argument(metavar="DIR", help="A run's directory, or one ledger in it.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print what a program would read.")] = False,
    csv: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write all entries there, a line per measurement.")
    ] = None,
    mcap: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write all entries there as JSON in MCAP.")
    ] = None,
) -> None:
    """Show what the fusions of a run have stored, also while it runs.

    By robot and boot: how many sets, from when to when, which are missing, came late, or expired. The files
    are written of the first ledger.

    \b
    Examples:
      searchparty ledger runs/today
      searchparty ledger runs/today --json
      searchparty ledger runs/today --csv sets.csv --mcap sets.mcap
    """
    from rich.console import Console

    from agents.ledger.export import write_csv, write_mcap
    from agents.ledger.ledger import Ledger
    from agents.ledger.report import report
    from agents.swarm.run_directory import finite

    console = Console()
    paths = found(place)
    reports = []
    for path in paths:
        with Ledger(path, read_only=True) as store:
            reports.append(report(store, path))
    if as_json:
        typer.echo(json.dumps(finite({"ledgers": [one.plain() for one in reports]}), indent=2))
    else:
        for one in reports:
            _print(console, one)
        if len(reports) > 1:
            same = len({one.digest for one in reports}) == 1
            console.print("all hold the same entries" if same else "[yellow]they do not hold the same[/]")
    with Ledger(paths[0], read_only=True) as store:
        if csv is not None:
            rows = write_csv(store, csv)
            _note(as_json, f"{csv}: {rows} rows")
        if mcap is not None:
            count = write_mcap(store, mcap)
            _note(as_json, f"{mcap}: {count} messages")


def found(place: Path) -> list[Path]:
    """The ledgers that a place means, the first fusion's first.

    Raises:
        StorageError: if there is none.
    """
    from agents.errors import StorageError

    if place.is_file():
        return [place]
    if not place.is_dir():
        raise StorageError(f"there is no {place}: give the directory of a run, or a ledger")
    paths = sorted(place.glob("ledger*.sqlite"), key=lambda path: (len(path.name), path.name))
    if not paths:
        raise StorageError(f"{place} holds no ledger.sqlite: give the directory of a run")
    return paths


def _print(console: "object", one: "object") -> None:
    from rich.console import Console
    from rich.table import Table

    from agents.ledger.report import Report

    assert isinstance(console, Console)
    assert isinstance(one, Report)
    facts = one.facts
    about = f"{facts['mission'] or 'a mission'}, seed {facts['seed'] or '?'}"
    console.print(f"{one.path}: {one.sets} measurement sets of {about}", soft_wrap=True, highlight=False)
    table = Table(box=None, padding=(0, 1), header_style="dim", pad_edge=False)
    table.add_column("sender", no_wrap=True)
    table.add_column("boot", no_wrap=True)
    for name in ("stored", "first", "last", "missing", "overtaken", "late", "expired"):
        table.add_column(name, justify="right", no_wrap=True)
    for source in one.sources:
        table.add_row(
            source.robot if source.kind == "set" else f"{source.robot} (says)",
            source.boot,
            str(source.stored),
            f"{source.first_s:.1f} s",
            f"{source.last_s:.1f} s",
            _missing(source.missing, source.gaps),
            str(source.overtaken),
            f"{source.late} (by {source.latest_s:.1f} s)" if source.late else "0",
            ", ".join(f"{count} {reason}" for reason, count in source.expired.items()) or "0",
        )
    console.print(table)


def _missing(count: int, gaps: list[tuple[int, int]]) -> str:
    if not count:
        return "0"
    first = "-".join(map(str, dict.fromkeys(gaps[0])))
    return f"{count} ({first}{', ...' if len(gaps) > 1 else ''})"


def _note(quiet: bool, text: str) -> None:
    typer.echo(text, err=quiet)
