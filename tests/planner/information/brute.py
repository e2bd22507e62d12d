"""No-detection events by brute force: every number of targets at every point, every outcome."""

from itertools import product
from math import exp, factorial, log

import numpy as np

from estimator.arrays import FloatArray

MOST = 16  # targets at a point that are counted


def populations(weights: FloatArray) -> list[tuple[float, tuple[int, ...]]]:
    """Every way to have up to MOST targets at each point, with its Poisson probability."""
    each = [[exp(-w) * w**k / factorial(k) for k in range(MOST + 1)] for w in weights]
    return [
        (float(np.prod([each[x][k] for x, k in enumerate(counts)])), counts)
        for counts in product(range(MOST + 1), repeat=len(weights))
    ]


def empties(detection: FloatArray, clutter: FloatArray, counts: tuple[int, ...]) -> list[float]:
    """p(y_i = 0 | X) of each event, (15)."""
    return [
        exp(-mu) * float(np.prod([(1 - d) ** k for d, k in zip(row, counts, strict=True)]))
        for row, mu in zip(detection, clutter, strict=True)
    ]


def outcomes(detection: FloatArray, weights: FloatArray, clutter: FloatArray) -> dict[tuple[int, ...], float]:
    """p(y), y_i = 0 for an empty set, by the law of total probability."""
    total = dict.fromkeys(product((0, 1), repeat=len(clutter)), 0.0)
    for p, counts in populations(weights):
        empty = empties(detection, clutter, counts)
        for y in total:
            total[y] += p * float(np.prod([1 - e if bit else e for bit, e in zip(y, empty, strict=True)]))
    return total


def information(detection: FloatArray, weights: FloatArray, clutter: FloatArray) -> float:
    """I[X; Y] as the mean of ln p(y | X) / p(y), (9)."""
    marginal = outcomes(detection, weights, clutter)
    total = 0.0
    for p, counts in populations(weights):
        empty = empties(detection, clutter, counts)
        for y, py in marginal.items():
            given = float(np.prod([1 - e if bit else e for bit, e in zip(y, empty, strict=True)]))
            if given > 0.0 and py > 0.0:
                total += p * given * log(given / py)
    return total


def random_case(seed: int, events: int, points: int = 2) -> tuple[FloatArray, FloatArray, FloatArray]:
    """p_D (m, n), some of them 0, weights (n,), and mu (m,)."""
    rng = np.random.default_rng(seed)
    detection = rng.uniform(0.05, 0.98, (events, points)) * (rng.random((events, points)) < 0.8)
    return detection, rng.uniform(0.1, 1.2, points), rng.uniform(0.0, 0.8, events)
