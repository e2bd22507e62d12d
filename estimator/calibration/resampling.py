"""Confidence intervals by resampling whole stretches of a recording.

A sensor's misses and errors last for a while: single measurements would promise far too much. Stretches of
many seconds are nearly independent (block bootstrap, Künsch, Annals of Statistics 17(3), 1989).
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray

Interval = tuple[float, float]


def blocks(frames: int, count: int) -> IntArray:
    """(frames,) which of `count` equally long stretches each set belongs to."""
    return np.arange(frames) * min(count, frames) // frames


def multiplicities(count: int, draws: int, rng: np.random.Generator) -> FloatArray:
    """(draws, count) how often each of `count` blocks is in each resampled recording."""
    return rng.multinomial(count, np.full(count, 1.0 / count), size=draws).astype(np.float64)


def interval(draws: FloatArray) -> Interval:
    """The middle 95% of what resampled recordings gave (draws,); NaN if none gave anything."""
    finite = draws[np.isfinite(draws)]
    if finite.size == 0:
        return float("nan"), float("nan")
    low, high = np.quantile(finite, [0.025, 0.975])
    return float(low), float(high)


def intervals(draws: FloatArray) -> list[Interval]:
    """`interval` of each column of (draws, k)."""
    return [interval(column) for column in draws.T]
