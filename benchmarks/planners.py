"""`python -m benchmarks.planners`: one mission with each planner, many seeds, as a Markdown table.

The comparison of (MA)ASI (Yousuf et al. 2024) sections 5.1 and 7.1.1, on the missions of docs/maasi.md and on
any other: every planner gets the same maps, robots, sensors and filter. Rows are sorted by the measurement
steps until all targets are found; a run that does not find all counts with all the steps that it made, so
that the mean is a lower bound and the planner comes after all that finished.
"""

import os
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer

from agents.mission.mission import Mission, TriggerTable
from agents.mission.mission_file import load
from sim.simulate.compare import with_planner
from sim.simulate.simulate import parse_seeds, run_all
from sim.simulate.statistics import mean_with_interval

PLANNERS = "maasi,maasi_joint,as_steps,mi,nearest_widest,lawnmower,thompson,cbba"
NEVER = 1e9  # a threshold that no look reaches: measured at waypoints only
PAPER_STEP_M, PAPER_SWATH_M = 12.0, 48.0  # in the cube of 260 m, (MA)ASI section 5.1


def main(
    mission: Annotated[str, typer.Argument(help="A mission file, or an example's name.")] = "quickstart",
    seeds: Annotated[str, typer.Option(help="Seeds: 7, 0:20 or 1,5,9.")] = "0:10",
    planners: Annotated[str, typer.Option(help="Kinds to compare.")] = PLANNERS,
    jobs: Annotated[int, typer.Option(min=0, help="Processes at work; 0: one per core.")] = 1,
    duration: Annotated[float | None, typer.Option(min=0.001, help="Mission time limit, s.")] = None,
    json: Annotated[
        Path | None, typer.Option(help="Keep the summaries here; what is there already counts too.")
    ] = None,
) -> None:
    """Compare planners on one mission and print a Markdown table."""
    given, numbers = load(mission, duration=duration), parse_seeds(seeds)
    runs: dict[str, list[dict[str, Any]]] = {}
    if json is not None and json.exists():
        runs = msgspec.json.decode(json.read_bytes())
    for kind in filter(None, planners.split(",")):
        runs[kind] = run_all(variant(given, kind), numbers, jobs or os.cpu_count() or 1, None)
        if json is not None:
            json.write_bytes(msgspec.json.encode(runs))
    print(table(runs))


def variant(mission: Mission, kind: str) -> Mission:
    """The mission with another planner, as the paper sets it up."""
    made = with_planner(mission, kind)
    solid = len(mission.area.min) == 3
    if kind == "as_steps":
        step = {"step_m": PAPER_STEP_M} if solid else {}
        trigger = TriggerTable(enabled=True, threshold=NEVER)
        return msgspec.structs.replace(made, planner={**made.planner, **step}, trigger=trigger)
    if kind == "lawnmower" and solid:
        return msgspec.structs.replace(made, planner={**made.planner, "swath_m": PAPER_SWATH_M})
    return made


def table(runs: dict[str, list[dict[str, Any]]]) -> str:
    """Means with 95% intervals in Markdown, fewest steps first, after them those with unfinished runs."""
    rows = []
    for kind, some in runs.items():
        steps = [run["measurements_to_all_found"] or run["measurement_sets"] for run in some]
        found = sum(bool(run["all_found"]) for run in some)
        far = [sum(run["distance_travelled_m"].values()) for run in some]
        seconds = [run["time_to_all_found_s"] or run["virtual_s"] for run in some]
        mark = "" if found == len(some) else "at least "
        cells = [
            f"`{kind}`",
            f"{found} of {len(some)}",
            mark + _mean(steps),
            mark + _mean(seconds),
            mark + _mean(far),
            f"{sum(run['plan_ms']['p50'] for run in some) / len(some):.1f}",
        ]
        rows.append((found < len(some), sum(steps) / len(steps), "| " + " | ".join(cells) + " |"))
    head = "| planner | all found | steps | time (s) | distance (m) | a plan, p50 (ms) |"
    return "\n".join([head, "| --- | --- | --- | --- | --- | --- |", *(row[-1] for row in sorted(rows))])


def _mean(values: list[float]) -> str:
    value = mean_with_interval(values)
    half = value["half_width_95"]
    return f"{value['mean']:.0f}" if half is None else f"{value['mean']:.0f} ± {half:.0f}"


if __name__ == "__main__":
    typer.run(main)
