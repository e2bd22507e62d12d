"""`python -m benchmarks.faults`: what loss, delay and dead robots cost a mission, and a picture of it.

The mission runs in virtual time with the same seeds at every level. Nothing recovers what is lost (the links
are datagrams), so that the agents themselves have to. Writes docs/faults.png and docs/faults.json.
"""

import json
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from agents.mission.mission import Mission
from agents.mission.mission_file import load
from agents.swarm.run_directory import write_json
from sim.campaign.campaign import run
from sim.campaign.faults import AnyFault, Kill, Schedule, Weather
from sim.network.conditions import NetworkConditions
from sim.simulate.simulate import parse_seeds
from sim.simulate.statistics import mean_with_interval

DOCS = Path(__file__).resolve().parents[1] / "docs"
KILL_AT_S = 20.0


@dataclass(frozen=True)
class Level:
    """One point of the curves, or a mission that is asked for."""

    axis: str  # "loss", "delay", "killed", or "asked"
    value: float
    loss: float = 0.0
    delay_s: float = 0.002
    killed: int = 0
    datagrams: bool = True


LEVELS = (
    Level("none", 0.0),
    *(Level("loss", loss, loss=loss) for loss in (0.15, 0.3, 0.45, 0.6)),
    *(Level("delay", delay, delay_s=delay) for delay in (0.5, 1.0, 2.0, 5.0)),
    *(Level("killed", float(killed), killed=killed) for killed in (1, 2, 3)),
    Level("asked", 0.0, loss=0.3, killed=1),
    Level("asked", 1.0, loss=0.3, killed=1, datagrams=False),
)


def one(mission: Mission, level: Level, seed: int) -> dict[str, Any]:
    """The summary of one run."""
    until = mission.duration_s + 1.0
    conditions = NetworkConditions(
        delay_s=level.delay_s, jitter_s=0.1 * level.delay_s, loss=level.loss, datagrams=level.datagrams
    )
    faults: list[AnyFault] = [Weather(at=0.0, until=until, conditions=conditions)]
    robots = [robot.id for robot in mission.robots]
    order = np.random.default_rng(seed).permutation(len(robots))
    faults += [Kill(at=KILL_AT_S + 5.0 * i, who=robots[order[i]]) for i in range(level.killed)]
    engine, _ = run(mission, Schedule(seed=seed, faults=tuple(faults), calm_at=until), seed)
    summary = engine.scoreboard.summary()
    return {
        name: summary[name]
        for name in ("all_found", "time_to_all_found_s", "gospa", "targets_found", "false_found")
    }


def main(
    mission: Annotated[str, typer.Argument(help="Mission file, or the name of an example.")] = "quickstart",
    seeds: Annotated[str, typer.Option(help="Seeds: 7, 0:10 or 1,5,9.")] = "0:20",
    jobs: Annotated[int, typer.Option(min=0, help="Processes at work; 0: one per core.")] = 1,
    draw: Annotated[bool, typer.Option("--draw", help="Run nothing: draw what was measured before.")] = False,
) -> None:
    """Measure, print and draw."""
    kept = DOCS / "faults.json"
    if draw:
        rows = json.loads(kept.read_text())
    else:
        resolved, numbers = load(mission), parse_seeds(seeds)
        with ProcessPoolExecutor(jobs or os.cpu_count() or 1, mp_context=get_context("spawn")) as pool:
            futures = [[pool.submit(one, resolved, level, seed) for seed in numbers] for level in LEVELS]
            runs = [[future.result() for future in some] for some in futures]
        rows = [_row(level, some, runs[0]) for level, some in zip(LEVELS, runs, strict=True)]
        write_json(kept, rows)
    Console().print(table(rows))
    picture(rows, DOCS / "faults.png")


def _row(level: Level, runs: list[dict[str, Any]], usual: list[dict[str, Any]]) -> dict[str, Any]:
    """Means over the seeds; times over those in which all were found, ratios seed by seed to the `usual`."""
    times = [r["time_to_all_found_s"] for r in runs if r["all_found"]]
    return {
        "axis": level.axis,
        "value": level.value,
        "runs": len(runs),
        "all_found": len(times),
        "time_s": mean_with_interval(times),
        "ratio": mean_with_interval(
            [
                r["time_to_all_found_s"] / u["time_to_all_found_s"]
                for r, u in zip(runs, usual, strict=True)
                if r["all_found"] and u["all_found"]
            ]
        ),
        "gospa_m": mean_with_interval([r["gospa"] for r in runs]),
    }


def table(rows: list[dict[str, Any]]) -> Table:
    """For people at a terminal."""
    shown = Table(title="what faults cost")
    for heading in ("axis", "level", "all found", "time to all found (s)", "of the undisturbed", "GOSPA (m)"):
        shown.add_column(heading, justify="right")
    for row in rows:
        time = row["time_s"]
        shown.add_row(
            row["axis"],
            f"{row['value']:g}",
            f"{row['all_found']} of {row['runs']}",
            _with_interval(time),
            _with_interval(row["ratio"]),
            _with_interval(row["gospa_m"]),
        )
    return shown


def _with_interval(value: dict[str, Any]) -> str:
    if value["mean"] is None:
        return "-"
    half = value["half_width_95"]
    return f"{value['mean']:.2f}" + ("" if half is None else f" ± {half:.2f}")


def picture(rows: list[dict[str, Any]], path: Path) -> None:
    """Time to all found and GOSPA against each axis, with 95% intervals."""
    import matplotlib as mpl  # noqa: PLC0415 - a development dependency

    mpl.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415

    axes_of = (
        ("loss", "share of messages lost"),
        ("delay", "delay of each message (s)"),
        ("killed", "robots killed, of 4"),
    )
    figure, grid = plt.subplots(2, 3, figsize=(10.5, 5.6), sharex="col", sharey="row", layout="constrained")
    for column, (axis, label) in enumerate(axes_of):
        points = [rows[0], *(row for row in rows if row["axis"] == axis)]
        x = [row["value"] for row in points]
        for axes, key in ((grid[0, column], "time_s"), (grid[1, column], "gospa_m")):
            y = [np.nan if row[key]["mean"] is None else row[key]["mean"] for row in points]
            half = [row[key]["half_width_95"] or 0.0 for row in points]
            axes.errorbar(x, y, yerr=half, marker="o", capsize=3, color="tab:blue")
            axes.grid(alpha=0.3)
        for row in points:
            if row["all_found"] < row["runs"]:
                text = f"{row['all_found']} of {row['runs']}"
                place = (row["value"], 0.05)
                across = grid[0, column].get_xaxis_transform()
                grid[0, column].annotate(text, place, xycoords=across, ha="center", fontsize=7)
        grid[1, column].set_xlabel(label)
    for axes, name in zip(grid[:, 0], ("time to all found (s)", "GOSPA at the end (m)"), strict=True):
        axes.set_ylabel(name)
        axes.set_ylim(bottom=0)
    grid[1, 0].set_ylim(top=1.3 * max(row["gospa_m"]["mean"] for row in rows))
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    typer.run(main)
