"""How long a path of Olofsson et al. (2020) takes: sampled whole and scored exactly, on one thread."""

from typing import Any

import numpy as np

from planner.sampling.batch import sample_paths
from planner.sampling.board import Board, board

STEPS, PATHS = 1000, 1000


def paper_board(seed: int = 0, detection: float = 0.9) -> Board:
    """Section 5.3 on 100 x 100 cells: 40 targets in 200 m x 200 m, each known to a covariance of 30^2 m^2."""
    rng = np.random.default_rng(seed)
    middles = np.arange(100) * 2.0 + 1.0
    values = np.zeros((100, 100))
    for x, y in rng.uniform(0, 200, (40, 2)):
        away = (middles[:, None] - x) ** 2 + (middles[None] - y) ** 2
        values += np.exp(-away / 1800) / (2 * np.pi * 900) * 4.0
    return board((100, 100), values, detection)


def test_mc_path_1000(benchmark: Any) -> None:
    """One path of 1,000 steps on 100 x 100 cells, sampled from the intensity, with revisits accounted for."""
    b = paper_board()
    cells, genes = np.empty(STEPS + 1, dtype=np.int64), np.empty(2 * STEPS + 8, dtype=np.int64)
    nobody = np.empty((0, 1), dtype=np.int64), np.empty(0, dtype=np.int64)

    def sample() -> tuple[float, int, int]:
        return sample_paths(b, 0, 1, 0, PATHS, *nobody, 0.0, cells, genes)

    reward, _, looks = benchmark.pedantic(sample, rounds=50, warmup_rounds=3)
    assert looks == STEPS + 1
    left = b.values.copy()
    for cell in cells:
        left[cell] *= 1 - b.detection[cell]
    assert abs(reward - (b.values.sum() - left.sum())) < 1e-9
    median = benchmark.stats.stats.median if benchmark.stats else float("nan")
    benchmark.extra_info.update(
        asked=10.0, unit="us", value=median / PATHS * 1e6, peers={"C++ (phdplanner)": 234.0}
    )
