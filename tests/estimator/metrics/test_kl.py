"""Divergences against closed forms and quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from estimator.gaussian.components import Components
from estimator.metrics.kl import information_gain, kl_gaussian, kl_matched, kl_sampled, kl_variational

ONE = Components(np.array([0.3, 0.7]), np.array([[-1.0], [2.0]]), np.array([[[0.5]], [[1.5]]]))
TWO = Components(np.array([0.6, 0.4]), np.array([[0.0], [3.0]]), np.array([[[1.0]], [[2.0]]]))


def density(mixture: Components, x: float) -> float:
    sigmas = np.sqrt(mixture.covariances[:, 0, 0])
    return float(mixture.weights @ norm.pdf(x, mixture.means[:, 0], sigmas))


TRUE = quad(lambda x: density(ONE, x) * np.log(density(ONE, x) / density(TWO, x)), -12.0, 14.0)[0]


def test_single_gaussians_have_the_textbook_divergence() -> None:
    assert kl_gaussian(np.zeros(1), np.eye(1), np.array([2.0]), 4.0 * np.eye(1)) == pytest.approx(
        np.log(2.0) + (1.0 + 4.0) / 8.0 - 0.5
    )
    assert kl_gaussian(np.ones(3), np.eye(3), np.ones(3), np.eye(3)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_sampled_divergence_is_the_integral_within_its_error(seed: int) -> None:
    value, error = kl_sampled(ONE, TWO, 4000, np.random.default_rng(seed))
    assert abs(value - TRUE) < 4.0 * error
    assert error < 0.02


def test_the_variational_divergence_is_near_and_exact_where_it_must_be() -> None:
    assert kl_variational(ONE, TWO) == pytest.approx(TRUE, abs=0.3)  # 0.28 off: wide components overlap
    assert kl_variational(ONE, ONE) == pytest.approx(0.0, abs=1e-12)
    a, b = ONE.chosen(np.array([0])), TWO.chosen(np.array([1]))
    exact = kl_gaussian(a.means[0], a.covariances[0], b.means[0], b.covariances[0])
    assert kl_variational(a, b) == pytest.approx(exact)
    assert kl_matched(a, b) == pytest.approx(exact)


def test_the_matched_divergence_bounds_mixtures_that_match_one_to_one() -> None:
    moved = Components(ONE.weights, ONE.means + 0.4, ONE.covariances)
    value, error = kl_sampled(ONE, moved, 20_000, np.random.default_rng(0))
    assert value - 4.0 * error < kl_matched(ONE, moved)


def test_weights_need_not_have_sum_one() -> None:
    assert kl_variational(ONE.scaled(3.0), TWO) == pytest.approx(kl_variational(ONE, TWO))


def test_the_gain_of_independent_targets_is_their_sum_and_nothing_new_gains_nothing() -> None:
    value, error = information_gain([ONE, TWO, ONE], [TWO, TWO, TWO], 4000, np.random.default_rng(1))
    assert abs(value - 2.0 * TRUE) < 4.0 * error
    assert information_gain([ONE], [ONE], 10, np.random.default_rng(1)) == (0.0, 0.0)


def test_what_is_no_input_is_named() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="covariance"):
        kl_gaussian(np.zeros(2), -np.eye(2), np.zeros(2), np.eye(2))
    with pytest.raises(ValueError, match="other"):
        kl_gaussian(np.zeros(2), np.eye(2), np.zeros(2), np.full((2, 2), np.nan))
    with pytest.raises(ValueError, match="mixture"):
        kl_sampled(Components.none(1), TWO, 10, rng)
    with pytest.raises(ValueError, match="samples"):
        kl_sampled(ONE, TWO, 1, rng)
    with pytest.raises(ValueError, match="targets"):
        information_gain([ONE], [], 10, rng)
    with pytest.raises(ValueError, match="other"):
        kl_sampled(ONE, Components(np.ones(1), np.zeros((1, 2)), np.eye(2)[None]), 10, rng)
