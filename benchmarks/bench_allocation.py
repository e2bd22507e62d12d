"""How long a whole team takes to agree by CBBA on a complete graph, every robot starting from nothing."""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import rounds, takeover
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


def test_allocation_rounds(benchmark: Any, quick: bool) -> None:
    """Rounds until ten robots on a ring hold the final allocation of thirty tasks, a third of words lost."""
    seeds = range(3 if quick else 20)
    counts: dict[tuple[str, float], list[int]] = {}

    def run() -> None:
        for kind in ("complete", "ring", "line"):
            for loss in (0.0, 0.3):
                heard = rounds.graph(kind, 10)
                counts[kind, loss] = [
                    rounds.rounds(rounds.team(10, 30, seed), 4, heard, loss, seed) for seed in seeds
                ]

    benchmark.pedantic(run, rounds=1)
    means = {key: float(np.mean(some)) for key, some in counts.items()}
    benchmark.extra_info.update(
        value=means["ring", 0.3],
        unit="rounds",
        note=f"ring of 10, 30 tasks, bundles of 4, 30% loss; mean of {len(seeds)}",
        more={
            f"{kind}, {loss:.0%} loss": f"{means[kind, loss]:.1f}, at most {max(counts[kind, loss])}"
            for kind, loss in counts
        },
    )


def test_task_takeover(benchmark: Any, quick: bool, tmp_path: Path) -> None:
    """From the end of a killed robot's token until others hold all of its tasks; real processes."""
    found: list[tuple[list[float], list[float]]] = []
    benchmark.pedantic(lambda: found.append(takeover.takeovers(6, 2 if quick else 4, tmp_path)), rounds=1)
    ((seen, taken),) = found
    benchmark.extra_info.update(
        value=max(taken),
        unit="s",
        asked=2.0,
        note=f"the longest of {len(taken)} robots of 6, killed one after another",
        more={
            "median s": float(np.median(taken)),
            "from SIGKILL to the token's end s": f"{min(seen):.3f} to {max(seen):.3f}",
        },
    )
