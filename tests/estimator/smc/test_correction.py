"""The PHD corrector: against numpy, against the exact multi-target Bayes update, against Stone Soup."""

from collections.abc import Sequence
from datetime import datetime
from itertools import product
from math import exp, factorial, prod
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.arrays import FloatArray
from estimator.smc.correction import corrected, explained
from tests.estimator.looks import dense_look


def explicit(w: FloatArray, p: FloatArray, g: FloatArray, c: FloatArray) -> FloatArray:
    """(MA)ASI (13) with clutter."""
    out = w * (1 - p)
    for j in range(len(c)):
        denominator = c[j] + np.sum(w * p * g[j])
        if denominator > 0:
            out += w * p * g[j] / denominator
    return np.asarray(out)


def random_case(seed: int, n: int = 50, m: int = 6) -> tuple[FloatArray, ...]:
    rng = np.random.default_rng(seed)
    g = rng.exponential(1.0, (m, n)) * (rng.random((m, n)) < 0.3)
    return rng.random(n) / n, rng.random(n), g, rng.exponential(0.1, m)


@pytest.mark.parametrize("seed", range(10))
def test_update_is_equation_13_with_clutter_in_the_denominator(seed: int) -> None:
    w, p, g, c = random_case(seed)
    assert np.allclose(corrected(w, dense_look(p, g, c)), explicit(w, p, g, c), rtol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_without_clutter_each_explicable_measurement_adds_exactly_one_target(seed: int) -> None:
    w, p, g, _ = random_case(seed)
    posterior = corrected(w, dense_look(p, g, np.zeros(6)))
    assert posterior.sum() == pytest.approx(np.sum(w * (1 - p)) + 6)


def poisson_posterior(
    v: FloatArray, p: FloatArray, g: FloatArray, c: Sequence[float], most: int
) -> FloatArray:
    """First moment of the exact posterior on a grid, prior Poisson(v), clutter Poisson(c), by enumeration.

    Every ordered tuple of up to `most` cells is a target set; the likelihood of the measurement set is summed
    over all ways to give measurements to targets or to clutter (Mahler 2007, eq. 12.41).
    """
    m = len(c)

    def likelihood(cells: tuple[int, ...], left: frozenset[int]) -> float:
        if not cells:
            return prod(c[j] for j in left)
        first, rest = cells[0], cells[1:]
        missed = (1 - p[first]) * likelihood(rest, left)
        return missed + sum(p[first] * g[j, first] * likelihood(rest, left - {j}) for j in left)

    total, moment = 0.0, np.zeros(v.size)
    for n in range(most + 1):
        for cells in product(range(v.size), repeat=n):
            prior = exp(-v.sum()) * prod(v[i] for i in cells) / factorial(n)
            weight = prior * likelihood(cells, frozenset(range(m)))
            total += weight
            for i in cells:
                moment[i] += weight
    return moment / total


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("m", [0, 1, 2])
def test_update_is_the_first_moment_of_the_exact_multi_target_posterior(seed: int, m: int) -> None:
    rng = np.random.default_rng([seed, m])
    v, p = rng.random(4) * 0.03, rng.random(4)
    g, c = rng.exponential(1.0, (m, 4)), rng.exponential(0.3, m)
    # at most two true targets are at all likely, 0.06 are expected; more than five weigh next to nothing
    exact = poisson_posterior(v, p, g, c.tolist(), most=5)
    assert np.allclose(corrected(v, dense_look(p, g, c)), exact, rtol=1e-4, atol=1e-8)


def test_update_is_exact_without_clutter_too() -> None:
    rng = np.random.default_rng(3)
    v, p, g = rng.random(4) * 0.03, rng.random(4), rng.exponential(1.0, (2, 4))
    exact = poisson_posterior(v, p, g, [0.0, 0.0], most=5)
    assert np.allclose(corrected(v, dense_look(p, g, np.zeros(2))), exact, rtol=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_update_agrees_with_stone_soups_smc_phd_on_linear_gaussian_input(seed: int) -> None:
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.types.array import StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.multihypothesis import MultipleHypothesis
    from stonesoup.types.prediction import ParticleStatePrediction
    from stonesoup.updater.particle import SMCPHDUpdater

    class Noiseless(LinearGaussian):  # type: ignore[misc]
        """Stone Soup 1.9's updater asks the likelihood for predictions with random noise on top; not here."""

        def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
            return super().function(state, noise=False, **kwargs)

    rng = np.random.default_rng(seed)
    n, m, p_d, clutter, noise = 400, 4, 0.8, 0.05, np.diag([0.4, 0.9])
    x, w = rng.uniform(0, 10, (2, n)), rng.random(n) / 100
    z = rng.uniform(1, 9, (m, 2))

    when = datetime(2024, 1, 1)
    model = Noiseless(ndim_state=2, mapping=(0, 1), noise_covar=noise)
    prediction = ParticleStatePrediction(StateVectors(x), log_weight=np.log(w), timestamp=when)
    detections = [Detection(row[:, None], timestamp=when, measurement_model=model) for row in z]
    hypotheses = MultipleHypothesis(
        [SingleHypothesis(prediction, d) for d in detections] + [SingleHypothesis(prediction, None)]
    )
    updater = SMCPHDUpdater(
        measurement_model=model, resampler=None, prob_detect=p_d, clutter_intensity=clutter
    )
    per_hypothesis = updater.get_log_weights_per_hypothesis(hypotheses)
    theirs = np.exp(np.array(per_hypothesis, dtype=float)).sum(axis=1)

    off = x[None] - z[:, :, None]
    inverse = np.linalg.inv(noise)
    g = np.exp(-0.5 * np.einsum("man,ab,mbn->mn", off, inverse, off))
    g /= 2 * np.pi * np.sqrt(np.linalg.det(noise))
    ours = corrected(w, dense_look(np.full(n, p_d), g, np.full(m, clutter)))
    assert np.allclose(ours, theirs, rtol=1e-9)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_mass_balances(seed: int) -> None:
    w, p, g, c = random_case(seed)
    look = dense_look(p, g, c)
    shown = explained(w, look)
    expected = np.sum(w * (1 - p)) + np.sum(shown / (c + shown))
    assert corrected(w, look).sum() == pytest.approx(expected, rel=1e-10)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_measurements_and_of_particles_does_not_matter(seed: int) -> None:
    w, p, g, c = random_case(seed)
    rng = np.random.default_rng(seed)
    rows, columns = rng.permutation(6), rng.permutation(50)
    base = corrected(w, dense_look(p, g, c))
    assert np.allclose(corrected(w, dense_look(p, g[rows], c[rows])), base, rtol=1e-11)
    shuffled = corrected(w[columns], dense_look(p[columns], g[:, columns], c))
    assert np.allclose(shuffled, base[columns], rtol=1e-11)


def test_an_empty_set_leaves_the_missed_detection_factor() -> None:
    w, p, _, _ = random_case(0)
    assert np.allclose(corrected(w, dense_look(p, np.zeros((0, 50)), np.zeros(0))), w * (1 - p), rtol=1e-15)


def test_where_nothing_can_be_detected_nothing_changes() -> None:
    w, p, g, c = random_case(0)
    assert np.array_equal(corrected(w, dense_look(0 * p, g, c)), w)


def test_an_impossible_measurement_is_ignored_and_never_nan() -> None:
    w, p, g, c = random_case(0)
    g[2], c[2] = 0.0, 0.0
    with_it = corrected(w, dense_look(p, g, c))
    without = corrected(w, dense_look(p, np.delete(g, 2, 0), np.delete(c, 2)))
    assert np.allclose(with_it, without)


def test_sensors_one_after_another_are_the_iterated_corrector() -> None:
    """(16): each sensor's update takes the posterior of the one before; the order matters a little."""
    w, p1, g1, c1 = random_case(1)
    _, p2, g2, c2 = random_case(2)
    first, second = dense_look(p1, g1, c1), dense_look(p2, g2, c2)
    expected = explicit(explicit(w, p1, g1, c1), p2, g2, c2)
    assert np.allclose(corrected(corrected(w, first), second), expected, rtol=1e-11)
    assert not np.allclose(corrected(corrected(w, second), first), expected, rtol=1e-6)


def test_a_weight_too_many_is_refused_by_name() -> None:
    w, p, g, c = random_case(0)
    for function in (corrected, explained):
        with pytest.raises(ValueError, match="weights"):
            function(np.append(w, 1.0), dense_look(p, g, c))
