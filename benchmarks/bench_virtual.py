"""Figures of virtual time itself: how much a simulated robot costs when there are a thousand of them."""

import time
from typing import Any

import msgspec
import pytest

from agents.mission.mission import Mission
from agents.team import Team
from benchmarks import swarms
from sim.engine.engine import Engine
from sim.network.conditions import NetworkConditions

REACH_M = 150.0  # of a robot's radio: fusion and robots hear each other everywhere, robots only so far
STEP_M = 60.0  # between robots at the start
SETTLED_S = 3.0  # all have met, planned and measured by then
LOOK_S = 0.05  # the fusion takes together what came meanwhile, as one does that is busy


def mission(robots: int, duration_s: float) -> Mission:
    """Quadrotors on a square grid, wide enough for them; as `swarms.mission` otherwise."""
    table = swarms.mission(robots, duration_s)
    side = int(robots**0.5 + 0.999)
    length = STEP_M * (side + 1)
    for i, robot in enumerate(table["robots"]):
        robot["start"] = [STEP_M * (1 + i % side), STEP_M * (1 + i // side), 12.0]
    table["area"] = {"min": [0.0, 0.0], "max": [length, length]}
    table["world"]["targets"] = max(12, robots // 4)
    low, high = STEP_M, length - STEP_M
    table["planner"]["candidates"] = {"low": [low, low], "high": [high, high], "points": [4, 4]}
    return msgspec.convert(table, Mission)


def simulated(robots: int, duration_s: float) -> dict[str, float]:
    """Run it; CPU seconds until all robots are underway and of the rest, and what came of it."""
    began = time.process_time()
    team = Team.of(mission(robots, duration_s))
    engine = Engine(team, 1, NetworkConditions(reach_m=REACH_M))
    engine.fusion.lag_s = LOOK_S
    marks: list[float] = []
    engine.after(SETTLED_S, lambda: marks.append(time.process_time()))
    summary = engine.run().summary()
    ran = time.process_time()
    applied = engine.fusion.fusion.counters["applied_sets"]
    return {
        "start_s": marks[0] - began,
        "run_s": ran - marks[0],
        "sets": summary["measurement_sets"],
        "applied": applied,
        "received": summary["messages"]["received"],
    }


@pytest.mark.figures("virtual_1000")
def test_virtual_1000(benchmark: Any, quick: bool) -> None:
    """A thousand robots in one process; the cost of one of them for a second."""
    robots, duration_s = (200, 5.0) if quick else (1000, 6.0)
    simulated(4, 4.0)  # kernels
    run = benchmark.pedantic(simulated, args=(robots, duration_s), rounds=1)
    assert run["sets"] >= robots * 0.8 * (duration_s - SETTLED_S), "robots did not measure"
    assert run["applied"] >= 0.98 * (run["sets"] - robots), "sets were not applied"
    benchmark.extra_info.update(
        value=1e3 * run["run_s"] / (robots * (duration_s - SETTLED_S)),
        unit="ms",
        note=f"processor time per robot and second, {robots} robots, radio reach {REACH_M:g} m",
        more={
            "start s": run["start_s"],
            "run s": run["run_s"],
            "sets": run["sets"],
            "messages": run["received"],
        },
    )
