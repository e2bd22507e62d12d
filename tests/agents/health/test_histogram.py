"""Latencies of many processes add up, within the width of a bin."""

import math

import numpy as np
import pytest

from agents.health.histogram import BINS, Histogram


def filled(values: np.ndarray) -> Histogram:
    histogram = Histogram()
    for value in values:
        histogram.add(float(value))
    return histogram


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("q", [1, 10, 50, 90, 99, 99.9, 100])
def test_percentile_is_within_three_percent_of_the_true_one(seed: int, q: float) -> None:
    values = np.random.default_rng(seed).lognormal(seed - 2, 2.0, 2000)
    true = np.percentile(values, q, method="inverted_cdf")
    assert filled(values).percentile(q) == pytest.approx(true, rel=0.03)


def test_merged_histograms_equal_the_histogram_of_all_values() -> None:
    values = np.random.default_rng(1).exponential(5.0, 1000)
    together = filled(values[:300]).merge(filled(values[300:]))
    np.testing.assert_array_equal(together.counts, filled(values).counts)
    assert together.total == 1000


def test_every_duration_that_is_a_number_is_counted() -> None:
    histogram = filled(np.array([0.0, -1.0, 1e-3, 1e-9, 1e6, 1e300, math.inf, 999_999.9]))
    assert histogram.total == 8
    histogram.add(math.nan)
    assert histogram.total == 8


def test_bins_are_ordered_and_cover_the_declared_range() -> None:
    for ms in (1.1e-3, 1.0, 17.0, 9.9e5):
        assert filled(np.array([ms])).percentile(50) == pytest.approx(ms, rel=0.03)


def test_an_empty_histogram_has_no_percentile() -> None:
    assert Histogram().percentile(50) is None


def test_counts_survive_the_way_through_a_message() -> None:
    histogram = filled(np.array([1.0, 2.0, 3.0]))
    copy = Histogram.of(histogram.counts)
    histogram.add(4.0)
    assert copy.total == 3


@pytest.mark.parametrize("counts", [np.zeros(3), np.zeros((BINS, 1)), -np.ones(BINS)])
def test_impossible_counts_are_refused(counts: np.ndarray) -> None:
    with pytest.raises(ValueError, match="counts"):
        Histogram.of(counts)
