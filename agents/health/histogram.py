"""Counts of durations in log-spaced bins, so that many processes' latencies add up to one distribution.

The bins are fixed for everyone: `merge` is an addition of counts, and a percentile is within about 2% of the
true one. What is kept does not grow with the number of durations.
"""

import math

import numpy as np

from estimator.arrays import IntArray

LOWEST_MS = 1e-3
HIGHEST_MS = 1e6
_PER_E_FOLD = 25.5  # bins for each factor e: each bin is 4% wide
BINS = math.ceil(math.log(HIGHEST_MS / LOWEST_MS) * _PER_E_FOLD)
_OFFSET = -math.log(LOWEST_MS) * _PER_E_FOLD


class Histogram:
    """A distribution of durations in milliseconds from a microsecond to a thousand seconds.

    What lies outside is counted in the first or last bin; what is not a number is not counted.
    """

    __slots__ = ("counts",)

    def __init__(self) -> None:
        self.counts: IntArray = np.zeros(BINS, dtype=np.int64)

    def __repr__(self) -> str:
        return f"Histogram(total={self.total}, p50={self.percentile(50)}, p99={self.percentile(99)})"

    @classmethod
    def of(cls, counts: IntArray) -> "Histogram":
        """The histogram with these counts (BINS,), which are copied.

        Raises:
            ValueError: if there are more or fewer counts than bins, or one is negative.
        """
        array = np.array(counts, dtype=np.int64)
        if array.shape != (BINS,) or (array < 0).any():
            raise ValueError(f"a histogram has {BINS} counts of at least 0, got shape {array.shape}")
        histogram = cls()
        histogram.counts = array
        return histogram

    @property
    def total(self) -> int:
        """How many durations were counted."""
        return int(self.counts.sum())

    def add(self, ms: float) -> None:
        """Count one duration in milliseconds."""
        if ms > LOWEST_MS:
            position = math.log(ms) * _PER_E_FOLD + _OFFSET if ms < HIGHEST_MS else BINS - 1
            self.counts[min(int(position), BINS - 1)] += 1
        elif ms <= LOWEST_MS:
            self.counts[0] += 1

    def merge(self, other: "Histogram") -> "Histogram":
        """Both together, as a new histogram."""
        return Histogram.of(self.counts + other.counts)

    def percentile(self, q: float) -> float | None:
        """The duration in milliseconds that q percent (0 to 100) do not exceed; None when nothing counts.

        It is the geometric middle of the bin in which that duration lies.
        """
        total = self.total
        if not total:
            return None
        rank = max(1, math.ceil(q / 100 * total))
        index = int(np.searchsorted(np.cumsum(self.counts), rank))
        return math.exp((index + 0.5 - _OFFSET) / _PER_E_FOLD)
