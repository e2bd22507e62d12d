"""Figures of whole teams: real processes on a real network, and the same objects in virtual time."""

from pathlib import Path
from typing import Any

import pytest

from benchmarks import swarms

ROBOT_LIMIT_MB = 200.0


def _run(benchmark: Any, robots: int, duration_s: float, directory: Path) -> swarms.Run:
    arguments = (swarms.mission(robots, duration_s), directory)
    run: swarms.Run = benchmark.pedantic(swarms.swarm, args=arguments, rounds=1)
    return run


@pytest.mark.figures(
    "capture_to_posterior_8", "capture_to_posterior_8_p99", "measure_clock_lateness_8", "robot_memory"
)
def test_swarm_8(benchmark: Any, quick: bool, tmp_path: Path) -> None:
    """Eight robots that measure at 1 Hz, one process each."""
    run = _run(benchmark, 8, 20.0 if quick else 60.0, tmp_path)
    summary = run.summary
    posterior, lateness = summary["capture_to_posterior_ms"], summary["measure_clock_lateness_ms"]
    memory = {who: mb for who, mb in summary["memory_mb"].items() if who.startswith("robot ")}
    sets = {"sets": summary["measurement_sets"], "cores busy": run.cpu_s / run.wall_s}
    benchmark.extra_info["figures"] = [
        _ms("capture_to_posterior_8", posterior["p50"], 5.0, "p50", more=sets),
        _ms("capture_to_posterior_8_p99", posterior["p99"], 25.0, "p99 of capture_to_posterior_8"),
        _ms("measure_clock_lateness_8", lateness["p99"], 10.0, "p99", more={"p50 ms": lateness["p50"]}),
        {
            "name": "robot_memory",
            "value": max(memory.values()),
            "unit": "MB",
            "asked": ROBOT_LIMIT_MB,
            "note": "resident, the largest of 8 robots",
            "more": {"smallest": min(memory.values()), "fusion": summary["memory_mb"].get("fusion fusion")},
        },
    ]


def _ms(name: str, value: float, asked: float, note: str, **words: Any) -> dict[str, Any]:
    return {"name": name, "value": value, "unit": "ms", "asked": asked, "note": note, **words}


def test_swarm_16(benchmark: Any, quick: bool, tmp_path: Path) -> None:
    """Sixteen robots: no set may be lost, and measurements keep their times."""
    duration_s = 20.0 if quick else 60.0
    run = _run(benchmark, 16, duration_s, tmp_path)
    summary = run.summary
    assert summary["measurement_sets"] >= 16 * 0.8 * duration_s, "robots did not measure"
    lost = run.lost + summary["messages"]["sets_not_applied"]
    benchmark.extra_info.update(
        value=lost,
        unit="sets",
        asked=0,
        note="sets lost on the way or not applied",
        more={
            "sets": summary["measurement_sets"],
            "not in the ledger": run.lost,
            "not applied": summary["messages"]["sets_not_applied"],
            "lateness p99 ms": summary["measure_clock_lateness_ms"]["p99"],
            "capture to posterior p50 ms": summary["capture_to_posterior_ms"]["p50"],
            "capture to posterior p99 ms": summary["capture_to_posterior_ms"]["p99"],
            "mission s": duration_s,
            "wall s with start and end": run.wall_s,
            "cores busy": run.cpu_s / run.wall_s,
        },
    )


@pytest.mark.figures("swarm_50", "swarm_50_lost", "swarm_50_robot_cpu")
def test_swarm_50(benchmark: Any, quick: bool, tmp_path: Path) -> None:
    """Fifty robots on one machine in real time: poses at 5 Hz, sets at 1 Hz, all through one router."""
    duration_s = 20.0 if quick else 60.0
    run = _run(benchmark, 50, duration_s, tmp_path)
    summary = run.summary
    messages, posterior = summary["messages"], summary["capture_to_posterior_ms"]
    assert summary["measurement_sets"] >= 50 * 0.8 * duration_s, "robots did not measure"
    lateness = summary["measure_clock_lateness_ms"]
    seen = {
        "p50 ms": posterior["p50"],
        "sets": summary["measurement_sets"],
        "lateness p99 ms": lateness["p99"],
        "cores busy": run.cpu_s / run.wall_s,
        "wall s with start and end": run.wall_s,
    }
    lost = {"not in the ledger": run.lost, "not applied": messages["sets_not_applied"]}
    benchmark.extra_info["figures"] = [
        _ms("swarm_50", posterior["p99"], 150.0, "capture to posterior, p99", more=seen),
        {
            "name": "swarm_50_lost",
            "value": run.lost + messages["sets_not_applied"] + messages["lost"],
            "unit": "messages",
            "asked": 0,
            "note": "sets lost on the way or not applied, and others that were numbered and never came",
            "more": {**lost, "received": messages["received"]},
        },
        {
            "name": "swarm_50_robot_cpu",
            "value": 1e3 * run.cpu_s / run.wall_s / 50,
            "unit": "ms",
            "note": "processor time per second and robot, everything counted: start, router, fusion, viewer",
        },
    ]


def test_second_start(benchmark: Any, quick: bool, tmp_path: Path) -> None:
    """From the command to the first robot that takes part, with compiled kernels on the disk."""
    times: list[float] = []

    def start() -> None:
        directory = tmp_path / str(len(times))
        directory.mkdir()
        table = swarms.mission(4, 60.0)
        with swarms.started(table, directory, directory / "run"):
            times.append(swarms.seconds_to_line(directory / "run" / "r1.log", "joined", 60.0))

    benchmark.pedantic(start, rounds=2 if quick else 5, warmup_rounds=1)
    counted = sorted(times[1:])
    benchmark.extra_info.update(
        value=counted[len(counted) // 2],
        unit="s",
        asked=5.0,
        note="4 robots, median",
        more={"least": counted[0], "most": counted[-1]},
    )


def test_simulate_speed_up(benchmark: Any, quick: bool, tmp_path: Path) -> None:
    """The quickstart mission in virtual time on one core."""
    arguments = ("quickstart", "7:9" if quick else "7:17", tmp_path)
    runs = benchmark.pedantic(swarms.simulated, args=arguments, rounds=1)
    speeds = [run["speed_up"] for run in runs]
    benchmark.extra_info.update(
        value=sum(run["virtual_s"] for run in runs) / sum(run["wall_s"] for run in runs),
        unit="x",
        asked=50.0,
        better="more",
        note=f"{len(runs)} seeds together",
        more={"slowest seed": min(speeds), "quickest seed": max(speeds)},
    )
