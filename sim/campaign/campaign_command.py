"""`searchparty campaign`: let everything go wrong, seed by seed, and check what must hold all the same."""

import os
import shlex
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import ExitStack
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from agents.invariants import Report, RunHistory, check
from agents.invariants.check import INVARIANTS
from agents.mission.mission import Mission
from agents.mission.mission_file import load
from agents.swarm.run_directory import RunDirectory, write_json
from sim.campaign.campaign import Trial, trial
from sim.campaign.faults import describe
from sim.simulate.simulate import parse_seeds

EXAMPLE = "campaign"


def campaign(
    mission: Annotated[
        str, typer.Argument(metavar="[MISSION]", help="Mission file, or the name of an installed example.")
    ] = EXAMPLE,
    seeds: Annotated[str, typer.Option(help="Seeds: 7, 0:10000 (0 to 9999) or 1,5,9.")] = "0:200",
    seed: Annotated[int | None, typer.Option(min=0, help="Only this seed.")] = None,
    jobs: Annotated[int, typer.Option(min=0, help="Processes at work; 0: one per core.")] = 0,
    verbose: Annotated[bool, typer.Option("--verbose", help="Show each seed's faults and measures.")] = False,
    json: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write what was found, seed by seed, here; - for stdout."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Keep the run directory of each failing seed here.")
    ] = None,
    run: Annotated[
        Path | None,
        typer.Option("--check", metavar="DIR", help="Run nothing: check the history in a run directory."),
    ] = None,
) -> None:
    """Run a mission under random faults, one schedule a seed, and check the invariants of every run.

    Messages are lost, doubled, delayed, spoiled and cut off; robots, fusions, router and viewer are killed,
    stopped and started again; disks are full and clocks wrong. A failing seed is printed with the command
    that repeats it. The exit status is 1 if any failed.

    \b
    Examples:
      searchparty campaign --seeds 0:10000
      searchparty campaign quickstart --seeds 0:20 --jobs 2 --out runs/failed
      searchparty campaign --seed 53 --verbose
      searchparty campaign --check runs/failed/seed-53
    """
    console = Console(stderr=json is not None and str(json) == "-")
    if run is not None:
        report = check(RunHistory.read(run))
        _tell_report(console, report)
        raise typer.Exit(int(bool(report.violations)))
    numbers = [seed] if seed is not None else parse_seeds(seeds)
    resolved = load(mission)
    found: dict[str, Any] = {"mission": resolved.name, "seeds": len(numbers), "failed": [], "each": []}
    counts: Counter[str] = Counter()
    measured = Report()
    with ExitStack() as stack:
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        progress = stack.enter_context(Progress(*columns, console=Console(stderr=True), transient=True))
        task = progress.add_task(f"campaign of {resolved.name}", total=len(numbers))
        for made in _trials(stack, resolved, numbers, jobs or os.cpu_count() or 1, out is not None):
            progress.advance(task)
            found["each"].append(_numbers(made))
            counts.update(made.report.counts)
            for name, value in made.report.measured.items():
                (measured.least if name == "separation_m" else measured.most)(name, value)
            if made.failed or verbose:
                _tell_trial(progress.console if json is not None else console, made, mission, verbose)
            if made.failed:
                progress.update(
                    task, description=f"campaign of {resolved.name}, {len(found['failed']) + 1} failed"
                )
                found["failed"].append(_record(made, mission))
                if out is not None:
                    _keep(made, resolved, out)
    found["each"].sort(key=lambda numbers: numbers["seed"])
    found |= {"counts": dict(sorted(counts.items())), "measured": dict(sorted(measured.measured.items()))}
    _tell_all(console, found)
    if json is not None and str(json) == "-":
        Console().print_json(data=found)
    elif json is not None:
        write_json(json, found)
    raise typer.Exit(int(bool(found["failed"])))


def repeat_command(mission: str, seed: int) -> str:
    """What repeats a seed."""
    words = ["searchparty", "campaign", *([] if mission == EXAMPLE else [mission]), "--seed", str(seed)]
    return shlex.join([*words, "--verbose"])


def _trials(stack: ExitStack, mission: Mission, seeds: list[int], jobs: int, keep: bool) -> Iterator[Trial]:
    """All seeds; with several processes in the order in which they are done."""
    if jobs == 1 or len(seeds) == 1:
        yield from (trial(mission, seed, keep=keep) for seed in seeds)
        return
    pool = stack.enter_context(ProcessPoolExecutor(jobs, mp_context=get_context("spawn")))
    stack.callback(pool.shutdown, wait=False, cancel_futures=True)
    for future in as_completed([pool.submit(trial, mission, seed, keep=keep) for seed in seeds]):
        yield future.result()


def _record(made: Trial, mission: str) -> dict[str, Any]:
    return {
        "seed": made.seed,
        "broken": made.report.broken,
        "violations": [str(violation) for violation in made.report.violations],
        "repeat": repeat_command(mission, made.seed),
    }


def _numbers(made: Trial) -> dict[str, Any]:
    """What was looked at in one seed, the worst that it met, and what breaks."""
    report = made.report
    return {
        "seed": made.seed,
        "faults": [describe(fault) for fault in made.schedule.faults],
        "broken": report.broken,
        "counts": dict(sorted(report.counts.items())),
        "measured": dict(sorted(report.measured.items())),
        "log": made.log_hash,
    }


def _keep(made: Trial, mission: Mission, out: Path) -> None:
    assert made.history is not None
    directory = RunDirectory.create(made.history.mission, out / f"seed-{made.seed}")
    made.history.write(directory.path)
    directory.write_summary(made.summary)


def _tell_trial(console: Console, made: Trial, mission: str, verbose: bool) -> None:
    word = "[bold red]fails[/]" if made.failed else "[green]holds[/]"
    console.print(f"seed {made.seed} {word}", soft_wrap=True)
    if verbose:
        console.print(str(made.schedule), markup=False, highlight=False, soft_wrap=True)
        _tell_report(console, made.report)
        console.print(f"log {made.log_hash}", highlight=False)
        return
    for violation in made.report.violations[:3]:
        console.print(f"  {violation}", markup=False, highlight=False, soft_wrap=True)
    if len(made.report.violations) > 3:
        console.print(f"  and {len(made.report.violations) - 3} more")
    if made.failed:
        console.print(f"  repeat: {repeat_command(mission, made.seed)}", markup=False, soft_wrap=True)


def _tell_report(console: Console, report: Report) -> None:
    for violation in report.violations:
        console.print(f"[red]{violation}[/]", highlight=False, soft_wrap=True)
    for name, number in sorted(report.counts.items()):
        console.print(f"  {name}: {number}", highlight=False)
    for name, value in sorted(report.measured.items()):
        console.print(f"  {name}: {value:.3g}", highlight=False)


def _tell_all(console: Console, found: dict[str, Any]) -> None:
    failed = found["failed"]
    table = Table(title=f"{found['mission']}: {found['seeds'] - len(failed)} of {found['seeds']} seeds hold")
    table.add_column("invariant")
    table.add_column("seeds that break it", justify="right")
    broken = Counter(row for record in failed for row in record["broken"])
    for invariant in INVARIANTS:
        table.add_row(invariant, str(broken[invariant]), style="red" if broken[invariant] else None)
    console.print(table)
