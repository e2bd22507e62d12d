"""`python -m benchmarks`: measure the figures, record them, show them. `make bench` calls it."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from agents.swarm.supervisor import ONE_THREAD
from benchmarks import report, results

HERE = Path(__file__).resolve().parent


def main(
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Measure only this figure. Repeatable.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Shorter runs; shown, not recorded.")] = False,
    docs: Annotated[
        bool, typer.Option("--docs", help="Measure nothing: write docs/figures.md from the record.")
    ] = False,
) -> None:
    """Measure the figures; write benchmarks/results.json and docs/figures.md.

    A missed figure is shown, and is no failure; a benchmark that breaks is one. What is not measured now
    stays in the record as it was.

    \b
    Examples:
      python -m benchmarks
      python -m benchmarks --only smc_phd_10k_12 --only kmeans_10k_12
      python -m benchmarks --quick
      python -m benchmarks --docs
    """
    console = Console()
    if docs:
        _write_page()
        console.print(f"wrote {report.DOCS.relative_to(HERE.parent)}")
        return
    machine = results.this_machine()  # before the benchmarks themselves keep it busy
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "report.json"
        status = _run(path, only or [], quick)
        text = path.read_text() if path.exists() else ""  # what broke early wrote none, or an empty one
    measured = results.figures(json.loads(text), machine, results.these_versions()) if text else []
    if measured and not quick:
        results.write(results.merged(results.read(), measured))
        _write_page()  # the tests hold it against the record
    console.print(report.table(measured))
    if machine["load_before"] > 0.5:
        console.print(
            f"[yellow]the machine was busy before (load {machine['load_before']}): measure again[/]"
        )
    raise typer.Exit(status)


def _write_page() -> None:
    report.DOCS.write_text(report.markdown(results.read()))


def _run(report_path: Path, only: list[str], quick: bool) -> int:
    """pytest's exit status; pyproject.toml's own options are those of the tests."""
    command = [sys.executable, "-m", "pytest", "-o", "addopts=", "-o", "python_files=bench_*.py"]
    command += ["-p", "no:xdist", "-p", "no:cacheprovider", "-q", "-s", "--timeout=0"]
    command += ["--benchmark-disable-gc", "--benchmark-quiet", f"--benchmark-json={report_path}"]
    command += [str(HERE), *(f"--figure={name}" for name in only), *(["--quick"] if quick else [])]
    environment = {**os.environ, **ONE_THREAD}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # a second start finds what the first one compiled
    return subprocess.run(command, cwd=HERE.parent, env=environment, check=False).returncode


if __name__ == "__main__":
    typer.run(main)
