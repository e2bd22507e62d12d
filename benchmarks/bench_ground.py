"""How long ways and distances take on the depot: 30 m x 15 m, robots of 0.25 m, cells of 0.1 m."""

from pathlib import Path
from typing import Any

import numpy as np

from bridges.ros_map import read_map
from estimator.filter import Area
from planner.ground.build import GroundPlan, built
from planner.ground.grid_ground import GridGround

DEPOT = Path(__file__).resolve().parents[2] / "shared" / "data" / "maps" / "depot.yaml"
START, GOAL = np.array([2.0, 2.0]), np.array([27.0, 13.0])


def depot() -> GridGround:
    plan = GroundPlan(map=read_map(DEPOT), radius=0.25, resolution=0.1)
    return built(plan, Area(np.array([0.5, 0.5]), np.array([29.5, 14.8])), np.append(START, 0.0)[:, None])


def test_astar_depot(benchmark: Any) -> None:
    """One any-angle way across the hall, 27 m."""
    ground = depot()
    assert benchmark.pedantic(ground.path, (START, GOAL), rounds=30, warmup_rounds=2) is not None
    benchmark.extra_info.update(unit="ms")


def test_distance_field_depot(benchmark: Any) -> None:
    """The any-angle distances from one place to all of the hall, not remembered from before."""
    ground = depot()
    goals = iter(GOAL + 1e-4 * np.arange(40)[:, None])

    def distances() -> Any:
        return ground.distances(next(goals), START[:, None])

    assert np.isfinite(benchmark.pedantic(distances, rounds=30, warmup_rounds=2)).all()
    benchmark.extra_info.update(unit="ms")
