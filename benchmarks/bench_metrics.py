"""How long GOSPA takes, and Stone Soup's on the same input in the same run."""

import time
from datetime import datetime
from typing import Any

import numpy as np

from estimator.arrays import FloatArray
from estimator.metrics.gospa import gospa

SIDE, COUNT, CUT_OFF = 1000.0, 100, 20.0


def scene() -> tuple[FloatArray, FloatArray]:
    """100 targets in a square kilometre; 90 estimates of them 5 m off and 10 of nothing."""
    rng = np.random.default_rng(1)
    truth = rng.uniform(0.0, SIDE, (2, COUNT))
    estimates = truth + rng.normal(0.0, 5.0, truth.shape)
    estimates[:, ::10] = rng.uniform(0.0, SIDE, (2, COUNT // 10))
    return truth, np.ascontiguousarray(rng.permutation(estimates, axis=1))


def stone_soup_ms(truth: FloatArray, estimates: FloatArray, repeats: int = 5) -> tuple[float, float]:
    """Stone Soup's GOSPA of the same sets: the best time, and the distance."""
    from stonesoup.metricgenerator.ospametric import GOSPAMetric  # noqa: PLC0415
    from stonesoup.types.state import State  # noqa: PLC0415

    when = datetime(2024, 1, 1)
    there, here = ([State(x[:, None], timestamp=when) for x in points.T] for points in (truth, estimates))
    metric = GOSPAMetric(c=CUT_OFF, p=2.0)
    best, distance = float("inf"), 0.0
    for _ in range(repeats):
        began = time.perf_counter()
        result, _ = metric.compute_gospa_metric(here, there)
        best = min(best, time.perf_counter() - began)
        distance = float(result.value["distance"])
    return 1e3 * best, distance


def test_gospa_100(benchmark: Any, quick: bool) -> None:
    truth, estimates = scene()
    benchmark.extra_info.update(unit="ms", asked=0.15, note="100 x 100, cut-off 20 m in a square kilometre")
    ours = gospa(truth, estimates, c=CUT_OFF)
    assert len(ours.pairs) >= 80
    benchmark(gospa, truth, estimates, c=CUT_OFF)
    if quick:
        return
    peer, distance = stone_soup_ms(truth, estimates)
    assert abs(distance - ours.total) < 1e-9 * distance
    benchmark.extra_info["peers"] = {"stonesoup 1.9 GOSPAMetric": peer}


def test_gospa_100_ungated(benchmark: Any) -> None:
    """The hardest case: every pair is within the cut-off, and nothing belongs together."""
    truth, estimates = np.random.default_rng(2).uniform(0.0, SIDE, (2, 2, COUNT))
    benchmark.extra_info.update(unit="ms", note="100 x 100 unrelated points, no pair beyond the cut-off")
    benchmark(gospa, truth, estimates, c=10 * SIDE)
