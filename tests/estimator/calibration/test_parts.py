"""The parts of a calibration, each against a closed form or brute force."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import poisson

from estimator.calibration.clutter import find_peaks, poisson_interval
from estimator.calibration.detection import fit_opening, fit_table, hats
from estimator.calibration.noise import fit_noise, responsibilities
from estimator.calibration.resampling import blocks, interval, multiplicities

GATE = np.array([1.0, 0.2])


@pytest.mark.parametrize("share", [0.0, 0.1, 0.4])
def test_noise_is_told_from_outliers(share: float) -> None:
    rng = np.random.default_rng(0)
    errors = rng.normal([0.05, -0.01], [0.1, 0.02], (20_000, 2))
    out = rng.random(20_000) < share
    errors[out] = rng.uniform(-GATE, GATE, (out.sum(), 2))
    noise = fit_noise(errors, GATE)
    assert noise.sigmas == pytest.approx([0.1, 0.02], rel=0.03)
    assert noise.biases == pytest.approx([0.05, -0.01], abs=0.003)
    assert 1 - noise.inliers == pytest.approx(share, abs=0.01)
    doubts = responsibilities(noise, errors, GATE)
    assert doubts.sum() == pytest.approx(np.count_nonzero(~out), rel=0.02)
    assert responsibilities(noise, np.array([[1.1, 0.0]]), GATE)[0] == 0.0


def test_weights_count_like_repetitions() -> None:
    rng = np.random.default_rng(1)
    errors = rng.normal(0.0, [0.1, 0.02], (200, 2))
    weights = rng.integers(0, 3, 200)
    weighted = fit_noise(errors, GATE, weights.astype(float))
    repeated = fit_noise(np.repeat(errors, weights, axis=0), GATE)
    np.testing.assert_allclose(weighted.sigmas, repeated.sigmas, rtol=1e-4)
    with pytest.raises(ValueError, match="too few"):
        fit_noise(errors[:9], GATE)


def test_the_table_has_the_greatest_likelihood() -> None:
    rng = np.random.default_rng(2)
    basis = hats(np.linspace(0.5, 9.5, 30), np.array([1.0, 4.0, 9.0]))
    np.testing.assert_allclose(basis.sum(axis=1), 1.0)
    trials = rng.integers(5, 60, 30).astype(float)
    hits = rng.binomial(trials.astype(int), basis @ [0.95, 0.6, 0.1]).astype(float)

    def cost(gains: np.ndarray) -> float:
        p = basis @ gains
        return -float((hits * np.log(p) + (trials - hits) * np.log1p(-p)).sum())

    best = minimize(cost, np.full(3, 0.5), bounds=[(1e-6, 1 - 1e-6)] * 3)
    np.testing.assert_allclose(fit_table(trials, hits, basis), best.x, atol=2e-3)


def test_one_break_all_to_itself_is_hits_over_trials_and_untried_ones_are_unknown() -> None:
    gains = fit_table(np.array([40.0, 0.0]), np.array([10.0, 0.0]), np.eye(2))
    assert gains[0] == pytest.approx(0.25)
    assert np.isnan(gains[1])


@pytest.mark.parametrize(("low", "high"), [(-60, 60), (-10, 33), (-135, 135)])
def test_the_opening_is_found_to_a_degree(low: int, high: int) -> None:
    rng = np.random.default_rng(3)
    degrees = np.arange(-180, 180)
    trials = rng.integers(5, 15, 360)
    p = np.where((degrees >= low) & (degrees < high), 0.6, 0.02)
    hits = rng.binomial(trials, p).astype(float)
    found = fit_opening(trials.astype(float), hits)
    assert np.degrees(found) == pytest.approx([low, high], abs=1.01)
    assert fit_opening(trials.astype(float), hits, found) == found
    even = rng.binomial(trials, 0.4).astype(float)
    assert fit_opening(trials.astype(float), even) == (-np.pi, np.pi)


@pytest.mark.parametrize("count", [0, 1, 7, 400])
def test_the_interval_of_a_rate_is_garwoods(count: int) -> None:
    low, high = poisson_interval(count, 10.0)
    assert poisson.cdf(count, 10.0 * high) == pytest.approx(0.025)
    if count:
        assert poisson.sf(count - 1, 10.0 * low) == pytest.approx(0.025)
    else:
        assert low == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_clutter_peaks_are_found_and_none_are_made_up(seed: int) -> None:
    rng = np.random.default_rng(seed)
    even = rng.poisson(4.0, 360)
    assert find_peaks(even, 2 * np.pi) == ()
    crowd = np.floor(rng.uniform(30.0, 50.0, 300)).astype(int) + 180
    counts = even + np.bincount(crowd, minlength=360)
    (peak,) = find_peaks(counts, 2 * np.pi)
    assert np.degrees(peak.centre) == pytest.approx(40.0, abs=3.0)
    assert np.degrees(peak.width) == pytest.approx(20.0, abs=6.0)
    assert peak.share == pytest.approx(300 / counts.sum(), abs=0.05)


def test_stretches_are_equally_long_and_all_of_the_recording() -> None:
    np.testing.assert_array_equal(blocks(7, 3), [0, 0, 0, 1, 1, 2, 2])
    np.testing.assert_array_equal(blocks(2, 9), [0, 1])
    drawn = multiplicities(5, 100, np.random.default_rng(0))
    np.testing.assert_array_equal(drawn.sum(axis=1), 5)
    assert np.isnan(interval(np.full(3, np.nan))).all()
