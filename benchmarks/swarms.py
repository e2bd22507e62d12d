"""Real teams for the benchmarks: missions of many robots, run with one process each."""

import json
import resource
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

SIDE_M = 600.0
START_UP_S = 120.0
LEG_M = 30.0


def mission(robots: int, duration_s: float) -> dict[str, Any]:
    """Quadrotors that measure at 1 Hz in a field of 600 m x 600 m, to the end of the time."""
    sensor = {
        "kind": "range_bearing",
        "period_s": 1.0,
        "gain": 0.98,
        "reach_m": [15.0, 15.0],
        "range_sigma_m": 1.0,
        "bearing_sigma_deg": 0.5,
        "clutter": 0.5,
    }
    vehicle = {"kind": "quadrotor", "speed_m_s": 10.0, "acceleration_m_s2": 4.0}
    side = int(robots**0.5 + 0.999)
    step = (SIDE_M - 2 * LEG_M) / max(1, side - 1)
    return {
        "name": f"swarm-{robots}",
        "seed": 1,
        "duration_s": duration_s,
        "stop_when_all_found": False,
        "area": {"min": [0.0, 0.0], "max": [SIDE_M, SIDE_M]},
        "world": {"kind": "uniform", "targets": 12, "spacing_m": 10.0, "margin_m": 5.0},
        "filter": {"kind": "smc_phd", "particles": 5000, "expected_targets": 6.0},
        "found": {"radius_m": 0.6, "mass": 0.8, "gate_m": 6.0},
        "exploration": {"points": [41, 41]},
        "planner": {
            "kind": "maasi",
            "alpha": 0.5,
            "beta": 0.5,
            "candidates": {"low": [40.0, 40.0], "high": [560.0, 560.0], "points": [5, 5]},
        },
        "settings": {"separation_m": 5.0},
        "robots": [
            {
                "id": f"r{i + 1}",
                "start": [LEG_M + step * (i % side), LEG_M + step * (i // side), 12.0 + 2.0 * i],
                "vehicle": vehicle,
                "sensor": sensor,
            }
            for i in range(robots)
        ],
    }


@dataclass(frozen=True, slots=True)
class Run:
    """What a run of `searchparty swarm` left."""

    summary: dict[str, Any]
    lost: int  # sets that a robot numbered before one that came, and that are not in the ledger
    wall_s: float  # from command to end
    cpu_s: float  # of all its processes


def swarm(table: dict[str, Any], directory: Path) -> Run:
    """Run a mission table to its end.

    Raises:
        RuntimeError: with the end of its output, if it broke. A target not found is no break.
    """
    out, before, began = directory / "run", _children_cpu_s(), time.perf_counter()
    with started(table, directory, out) as process:
        try:
            process.wait(table["duration_s"] + START_UP_S)
        except subprocess.TimeoutExpired:
            raise RuntimeError(f"the swarm did not end; see {out}") from None
    wall = time.perf_counter() - began
    if process.returncode not in (0, 1) or not (out / "summary.json").exists():
        said = (directory / "swarm.log").read_text(errors="replace")[-2000:]
        raise RuntimeError(f"the swarm ended with exit status {process.returncode}: {said}")
    summary = json.loads((out / "summary.json").read_text())
    return Run(summary, _gaps(out / "ledger.sqlite"), wall, _children_cpu_s() - before)


@contextmanager
def started(table: dict[str, Any], directory: Path, out: Path) -> Iterator[subprocess.Popen[bytes]]:
    """The launcher of a mission table, which is ended if it has not ended by itself."""
    file = directory / "mission.toml"
    file.write_text(tomli_w.dumps(table))
    command = [sys.executable, "-m", "agents.cli", "swarm", str(file), "--out", str(out), "--view", "none"]
    with (
        (directory / "swarm.log").open("wb") as log,
        subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT) as process,
    ):
        try:
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()


def seconds_to_line(path: Path, text: str, deadline_s: float) -> float:
    """How long it takes until a log file holds a text.

    Raises:
        RuntimeError: if it does not in time.
    """
    began = time.perf_counter()
    while time.perf_counter() - began < deadline_s:
        if path.exists() and text in path.read_text(errors="replace"):
            return time.perf_counter() - began
        time.sleep(0.005)
    raise RuntimeError(f"{path} does not say {text!r} within {deadline_s} s")


def simulated(mission_name: str, seeds: str, directory: Path) -> list[dict[str, Any]]:
    """The summaries of `searchparty simulate` on one core."""
    path = directory / "simulated.json"
    command = [sys.executable, "-m", "agents.cli", "simulate", mission_name, "--seeds", seeds]
    subprocess.run([*command, "--json", str(path)], check=True, stdout=subprocess.DEVNULL)
    runs: list[dict[str, Any]] = json.loads(path.read_text())["runs"]
    return runs


def _gaps(ledger: Path) -> int:
    database = sqlite3.connect(ledger)
    try:
        rows = database.execute("SELECT count(*), max(sequence) FROM sets GROUP BY robot, boot").fetchall()
    finally:
        database.close()
    return sum(newest + 1 - count for count, newest in rows)


def _children_cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
