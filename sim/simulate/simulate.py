"""`searchparty simulate`: one mission, many seeds, in virtual time, with statistics."""

import os
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from agents.errors import MissionError
from agents.ledger.ledger import Ledger
from agents.mission.mission import Mission
from agents.mission.mission_file import load
from agents.process.rehearsal import rehearse_fusion, rehearse_robot
from agents.swarm.run_directory import RunDirectory, write_json
from agents.team import Team
from sim.engine.engine import Engine
from sim.simulate.compare import ROWS, decentralisation, differences, flat, sentences, table, variants
from sim.simulate.statistics import aggregate, means

Summary = dict[str, Any]
_rehearsed: list[bool] = []  # once per process

_PRINTED = (  # key of the aggregate, label, unit
    ("targets_found", "targets found", ""),
    ("false_found", "false targets", ""),
    ("time_to_all_found_s", "time to all found", "s"),
    ("measurements_to_all_found", "measurement sets to all found", ""),
    ("rmse_m", "RMSE of found targets", "m"),
    ("gospa", "GOSPA", "m"),
    ("expected_cardinality", "expected cardinality", ""),
    ("min_separation_m", "least separation", "m"),
    ("speed_up", "faster than real time", "x"),
)


def simulate(
    mission: Annotated[str, typer.Argument(help="Mission file, or the name of an installed example.")],
    seeds: Annotated[str, typer.Option(help="Seeds: 7, 0:20 (0 to 19) or 1,5,9.")] = "0:20",
    jobs: Annotated[int, typer.Option(min=0, help="Processes at work; 0: one per core.")] = 1,
    json: Annotated[Path | None, typer.Option(help="Write all summaries and the aggregate here.")] = None,
    out: Annotated[Path | None, typer.Option(help="Keep a run directory per seed under this one.")] = None,
    duration: Annotated[float | None, typer.Option(min=0.001, help="Mission time limit, s.")] = None,
    compare: Annotated[
        str | None,
        typer.Option(
            metavar="PLANNER,...",
            help="Run the same seeds with these planners too, and print the differences seed by seed.",
        ),
    ] = None,
) -> None:
    """Run a mission in virtual time for many seeds and print means with 95% intervals.

    The Robot and Fusion objects are those of the real processes; only clock and network are simulated.

    With --compare every planner runs the same seeds, and differences from the mission's own planner are taken
    seed by seed. Compared with its joint sibling (maasi with maasi_joint), a planner that decides each robot
    for itself shows what decentralisation costs.

    \b
    Examples:
      searchparty simulate quickstart --seeds 0:20
      searchparty simulate missions/maasi_3d.toml --seeds 0:50 --jobs 2 --json maasi_3d.json
      searchparty simulate maasi_3d --seeds 0:20 --compare maasi_joint,lawnmower
    """
    numbers = parse_seeds(seeds)
    resolved = load(mission, duration=duration)
    chosen = {} if compare is None else variants(resolved, compare)
    at_once = jobs or os.cpu_count() or 1
    runs = run_all(resolved, numbers, at_once, out)
    total = aggregate(runs)
    record: dict[str, Any] = {"runs": runs, "aggregate": total}
    _print(resolved, total)
    if chosen:
        record["compare"] = _compared(resolved, runs, chosen, numbers, at_once, out)
    if json is not None:
        write_json(json, record)


def _compared(
    mission: Mission,
    runs: list[Summary],
    chosen: dict[str, Mission],
    seeds: list[int],
    jobs: int,
    out: Path | None,
) -> dict[str, Any]:
    """Run the other planners, print the comparison, and answer with its record for --json."""
    own = mission.planner["kind"]
    every = {own: runs}
    for kind, variant in chosen.items():
        if kind != own:
            every[kind] = run_all(variant, seeds, jobs, out and out / kind)
    keys = [key for key, _, _ in ROWS]
    averages = {kind: means(flat(some), keys) for kind, some in every.items()}
    console = Console()
    console.print(table(mission.name, every, averages))
    for sentence in sentences(every):
        console.print(sentence, highlight=False)
    others = {kind: some for kind, some in every.items() if kind != own}
    return {
        "base": own,
        "means": averages,
        "runs": others,
        "aggregates": {kind: aggregate(some) for kind, some in others.items()},
        "differences": differences(every),
        "decentralisation": decentralisation(every),
    }


def parse_seeds(text: str) -> list[int]:
    """Seeds out of "7", "0:20" or "1,5,9".

    Raises:
        MissionError: if the text is none of these.
    """
    try:
        if ":" in text:
            low, high = (int(part) for part in text.split(":"))
            numbers = list(range(low, high))
        else:
            numbers = [int(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or min(numbers) < 0:
        raise MissionError(f"--seeds: found {text!r}, allowed are 7, 0:20 (0 to 19) or 1,5,9")
    return numbers


def run_all(mission: Mission, seeds: list[int], jobs: int, out: Path | None) -> list[Summary]:
    """The summaries of all seeds, in their order."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with ExitStack() as stack:
        progress = stack.enter_context(Progress(*columns, console=Console(stderr=True), transient=True))
        title = f"simulating {mission.name} with {mission.planner['kind']}"
        task = progress.add_task(title, total=len(seeds))
        runs = []
        if jobs == 1 or len(seeds) == 1:
            results = (run_one(mission, seed, out) for seed in seeds)
        else:
            pool = stack.enter_context(ProcessPoolExecutor(jobs, mp_context=get_context("spawn")))
            results = pool.map(run_one, [mission] * len(seeds), seeds, [out] * len(seeds))  # type: ignore[assignment]
        for summary in results:
            runs.append(summary)
            progress.advance(task)
    return runs


def run_one(mission: Mission, seed: int, out: Path | None = None) -> Summary:
    """The summary of one seed's run."""
    with ExitStack() as stack:
        directory, ledger = None, None
        if out is not None:
            directory = RunDirectory.create(mission, out / f"seed-{seed}")
            ledger = stack.enter_context(Ledger(directory.ledger))
            for name, value in (("mission", mission.name), ("fusion", "fusion"), ("seed", str(seed))):
                ledger.remember(name, value)
        team = Team.of(mission)
        if not _rehearsed:  # the first run of a process would wait for its kernels to be loaded
            rehearse_fusion(team)
            rehearse_robot(team, mission.robots[0].id)
            _rehearsed.append(True)
        engine = Engine(team, seed, ledger=ledger)
        began = time.perf_counter()
        scoreboard = engine.run()
        wall = time.perf_counter() - began
        summary = scoreboard.summary()
        summary["log_hash"] = engine.log_hash
        summary["virtual_s"] = engine.clock.now()
        summary["wall_s"] = wall
        summary["speed_up"] = engine.clock.now() / wall
        if directory is not None:
            directory.write_summary(summary)
            (directory.path / "events.log").write_text("\n".join(engine.events) + "\n")
        return summary


def _print(mission: Mission, total: dict[str, Any]) -> None:
    table = Table(title=f"{mission.name}: all found in {total['runs_all_found']} of {total['runs']} runs")
    for heading in ("", "mean", "95% interval", "least", "most"):
        table.add_column(heading, justify="left" if not heading else "right")
    for key, label, unit in _PRINTED:
        value = total[key]
        if value["mean"] is None:
            continue
        half = value["half_width_95"]
        table.add_row(
            f"{label} ({unit})" if unit else label,
            f"{value['mean']:.2f}",
            "" if half is None else f"± {half:.2f}",
            f"{value['min']:.2f}",
            f"{value['max']:.2f}",
        )
    Console().print(table)
