"""`python -m benchmarks.decentralisation`: what planning each for itself costs against one centre.

The same mission and seeds in virtual time, once with each planner: `maasi` (every robot for itself, given
what the others have committed to) and `maasi_joint` (one centre for all that plan at once) by default.
"""

import os
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from rich.console import Console
from rich.table import Table

from agents.mission import Mission
from agents.mission_file import load
from sim.simulate import parse_seeds, run_all
from sim.statistics import aggregate

ROWS = (
    ("targets_found", "targets found", ""),
    ("time_to_all_found_s", "time to all found", "s"),
    ("measurements_to_all_found", "sets to all found", ""),
    ("gospa", "GOSPA", "m"),
    ("min_separation_m", "least separation", "m"),
)


def main(
    mission: Annotated[str, typer.Argument(help="A mission file, or an example's name.")] = "maasi_3d",
    seeds: Annotated[str, typer.Option(help="Seeds: 7, 0:20 or 1,5,9.")] = "0:20",
    planners: Annotated[
        str, typer.Option(help="Kinds to compare, the first is the base.")
    ] = "maasi,maasi_joint",
    jobs: Annotated[int, typer.Option(min=0, help="Processes at work; 0: one per core.")] = 1,
    out: Annotated[Path | None, typer.Option(help="Write all summaries here, as JSON.")] = None,
) -> None:
    """Compare planners on one mission, seed by seed.

    A key of `[planner]` is kept for every kind that knows it.
    """
    given, numbers = load(mission), parse_seeds(seeds)
    runs = {
        kind: run_all(with_planner(given, kind), numbers, jobs or os.cpu_count() or 1, None)
        for kind in planners.split(",")
    }
    if out is not None:
        out.write_bytes(msgspec.json.encode(runs))
    Console().print(table(given.name, runs))


def with_planner(mission: Mission, kind: str) -> Mission:
    """The mission with another planner; keys that it does not know are left out.

    Raises:
        MissionError: if there is no such planner.
    """
    from agents import plugins  # noqa: PLC0415 - after the command line is read

    known = set(plugins.load("planners", kind).Config.__struct_fields__)
    kept = {key: value for key, value in mission.planner.items() if key in known}
    return msgspec.structs.replace(mission, planner={"kind": kind, **kept})


def table(name: str, runs: dict[str, list[dict[str, Any]]]) -> Table:
    """Means with 95% intervals, and the wall time of a plan."""
    shown = Table(title=name)
    shown.add_column("")
    for kind in runs:
        shown.add_column(kind, justify="right")
    totals = {kind: aggregate(some) for kind, some in runs.items()}
    for key, label, unit in ROWS:
        cells = []
        for total in totals.values():
            value = total[key]
            half = value["half_width_95"]
            mean = "-" if value["mean"] is None else f"{value['mean']:.2f}"
            cells.append(mean if half is None else f"{mean} ± {half:.2f}")
        shown.add_row(f"{label} ({unit})" if unit else label, *cells)
    found = [f"{total['runs_all_found']} of {total['runs']}" for total in totals.values()]
    shown.add_row("runs in which all were found", *found)
    times = [f"{sum(run['plan_ms']['p50'] for run in some) / len(some):.1f}" for some in runs.values()]
    shown.add_row("a plan takes (ms, median)", *times)
    return shown


if __name__ == "__main__":
    typer.run(main)
