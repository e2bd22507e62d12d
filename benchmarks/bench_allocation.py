"""How long a whole team takes to agree by CBBA on a complete graph, every robot starting from nothing."""

from typing import Any

import numpy as np

from planner.allocation.engine import allocate
from planner.allocation.score import TeamScores

CAPACITY = 10


def team(robots: int, tasks: int) -> TeamScores:
    """Places in a square kilometre, 10 m/s, rewards of 50 to 100 that lose 1% a second."""
    rng = np.random.default_rng(0)
    starts, places = rng.uniform(0, 1000, (robots, 2)), rng.uniform(0, 1000, (tasks, 2))
    return TeamScores.of(
        rng.uniform(50, 100, (robots, tasks)),
        np.linalg.norm(starts[:, None] - places, axis=2) / 10,
        np.linalg.norm(places[:, None] - places, axis=2) / 10,
        rate=0.01,
    )


def test_cbba_50_200(benchmark: Any) -> None:
    """50 robots x 200 tasks, bundles of 10, to convergence."""
    scores = team(50, 200)
    made = benchmark.pedantic(allocate, args=(scores, CAPACITY), rounds=30, warmup_rounds=2)
    assert made.converged
    assert len(np.concatenate(made.paths)) == len(set(np.concatenate(made.paths))) == 200
    benchmark.extra_info.update(
        asked=20.0, unit="ms", peers={"a public Python CBBA, in a run before": 10_500.0}
    )


def test_cbba_10_50(benchmark: Any) -> None:
    """10 robots x 50 tasks, bundles of 10, to convergence."""
    scores = team(10, 50)
    made = benchmark.pedantic(allocate, args=(scores, CAPACITY), rounds=100, warmup_rounds=2)
    assert made.converged
    assert len(np.concatenate(made.paths)) == len(set(np.concatenate(made.paths))) == 50
    benchmark.extra_info.update(asked=1.0, unit="ms", peers={"a public Python CBBA, in a run before": 117.0})
