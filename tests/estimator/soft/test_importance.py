"""Mixtures times softmax categories against brute force on a grid; Salmond's merging."""

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.gaussian.components import Components, moments_of
from estimator.soft.importance import reweighted, turned, unit_points
from estimator.soft.models import SoftModel, ranges, region
from estimator.soft.salmond import merged
from estimator.soft.variational import products, variational
from tests.estimator.soft import grids

NEAR, AROUND, FAR = [0], list(range(1, 9)), list(range(9, 17))
PAPER = Components(np.array([0.5, 0.5]), np.array([[0.0, 4.0], [0.0, -4.0]]), np.array([5.0 * np.eye(2)] * 2))
ODD = Components(
    np.array([0.2, 0.5, 0.3]),
    np.array([[1.0, 0.5], [6.0, -3.0], [-2.0, 7.0]]),
    np.array([[[2.0, 0.9], [0.9, 1.0]], np.eye(2), [[0.5, -0.2], [-0.2, 3.0]]]),
)
SURPRISED = Components(np.array([0.5, 0.5]), np.array([[12.0, 3.0], [12.0, -5.0]]), np.array([np.eye(2)] * 2))


def told(
    mixture: Components, model: SoftModel, own: list[int], *, propose: bool = True, samples: int = 128
) -> tuple[Components, FloatArray, float]:
    units = turned(unit_points(2, samples), np.random.default_rng(7))
    softmax = model.softmax
    w, x, p, _, shares, log = reweighted(
        mixture.weights,
        mixture.means,
        mixture.covariances,
        softmax.weights,
        softmax.biases,
        np.array(own),
        units,
        propose,
    )
    return Components(w, x, p), shares, log


@pytest.mark.parametrize("steepness", [2.0, 4.0, 20.0])
@pytest.mark.parametrize("own", [NEAR, AROUND, FAR, AROUND + FAR], ids=["near", "around", "far", "not near"])
@pytest.mark.parametrize("mixture", [PAPER, ODD], ids=["paper", "odd"])
def test_a_statement_gives_the_grids_posterior(mixture: Components, own: list[int], steepness: float) -> None:
    model = ranges(np.zeros(2), 2.0, 4.0, steepness)
    after, _, log = told(mixture, model, own)
    exact, evidence = grids.posterior(mixture, grids.agreement(model.softmax, own))
    mean, covariance = grids.moments(exact)
    got_mean, got = moments_of(after)
    assert log == pytest.approx(np.log(evidence), abs=0.12)
    spread = np.sqrt(np.trace(covariance))
    assert np.linalg.norm(got_mean - mean) < 0.06 * spread
    assert np.linalg.norm(got - covariance) < 0.09 * np.trace(covariance)
    # A Gaussian with a straight edge cut off is no Gaussian: the steeper, the further from any mixture.
    assert grids.apart(exact, after) < (0.16 if steepness == 2.0 else 0.2 if steepness == 4.0 else 0.3)


@pytest.mark.parametrize(("steepness", "limit"), [(2.0, 0.1), (4.0, 0.13), (20.0, 0.25)])
def test_a_surprising_statement_needs_the_variational_proposal(steepness: float, limit: float) -> None:
    model = ranges(np.zeros(2), 2.0, 4.0, steepness)
    exact, evidence = grids.posterior(SURPRISED, grids.agreement(model.softmax, AROUND))
    mean, covariance = grids.moments(exact)
    after, shares, log = told(SURPRISED, model, AROUND)
    plain, plain_shares, plain_log = told(SURPRISED, model, AROUND, propose=False)
    assert log == pytest.approx(np.log(evidence), abs=0.15)
    assert abs(plain_log - np.log(evidence)) > 2.0 * abs(log - np.log(evidence))
    assert grids.apart(exact, after) < limit
    assert grids.apart(exact, plain) > 2.0 * grids.apart(exact, after)
    assert np.linalg.norm(moments_of(after)[0] - mean) < 0.2 * np.sqrt(np.trace(covariance))
    assert after.weights @ shares > 0.25
    assert plain.weights @ plain_shares < 0.12


def test_figure_4_of_the_paper_a_camera_sees_nothing() -> None:
    """Three sub-classes of "no detection" make six components of the two; the triangle is left empty."""
    camera = region(np.array([[0.0, 0.0], [5.0, -3.0], [5.0, 3.0]]), 4.0)
    after, _, log = told(PAPER, camera, [0, 1, 2], propose=False)
    assert after.count == 6
    exact, evidence = grids.posterior(PAPER, grids.agreement(camera.softmax, [0, 1, 2]))
    assert log == pytest.approx(np.log(evidence), abs=0.01)
    assert grids.apart(exact, after) < 0.08


def test_figure_4_of_the_paper_the_target_is_around_the_robot() -> None:
    """The figure shows 18 components; 2 components times 8 sub-classes are 16, as the paper's text has it."""
    model = ranges(np.zeros(2), 2.0, 4.0, 4.0)
    after, _, _ = told(PAPER, model, AROUND)
    assert after.count == 16
    ring = grids.density(after) * (np.linalg.norm(grids.POINTS, axis=0) > 1.5)
    ring *= np.linalg.norm(grids.POINTS, axis=0) < 4.8
    assert ring.sum() * grids.STEP**2 > 0.93


@pytest.mark.parametrize("d", [2, 3])
def test_a_statement_that_says_nothing_changes_nothing(d: int) -> None:
    rng = np.random.default_rng(d)
    p = np.eye(d) + 0.3
    units = turned(unit_points(d, 64), rng)
    flat, zero = np.zeros((2, d)), np.zeros(2)
    w, x, q, _, shares, log = reweighted(
        np.ones(1), np.ones((1, d)), p[None], flat, zero, np.array([0]), units, True
    )
    assert log == pytest.approx(np.log(0.5))
    np.testing.assert_allclose(x[0], 1.0, atol=1e-9)
    np.testing.assert_allclose(q[0], p, atol=1e-9)
    assert (w, shares) == (pytest.approx([1.0]), pytest.approx([1.0]))


def test_a_category_and_its_opposite_have_the_whole_evidence() -> None:
    model = ranges(np.zeros(2), 2.0, 4.0, 4.0)
    total = sum(np.exp(told(ODD, model, own)[2]) for own in (NEAR, AROUND, FAR))
    assert total == pytest.approx(1.0, abs=0.05)


def test_a_statement_forty_standard_deviations_off_stays_finite() -> None:
    far = Components(np.ones(1), np.array([[400.0, -3.0]]), 100.0 * np.eye(2)[None])
    after, _, log = told(far, ranges(np.zeros(2), 2.0, 4.0, 10.0), NEAR)
    assert np.isfinite(log)
    assert np.linalg.norm(after.weights @ after.means) < 4.0
    assert np.linalg.eigvalsh(after.covariances).min() > 0.0


@pytest.mark.parametrize("d", [2, 3])
def test_the_variational_gaussian_is_the_best_of_its_bound(d: int) -> None:
    """The bound of the evidence, written plainly, does not rise when any of its parameters is moved."""
    rng = np.random.default_rng(d)
    weights, biases = rng.normal(0.0, 2.0, (5, d)), rng.normal(0.0, 1.0, 5)
    mean, cov = rng.normal(0.0, 1.0, d), np.eye(d)
    x, p = mean.copy(), cov.copy()
    for _ in range(20):
        variational(
            mean, np.linalg.inv(cov), np.ascontiguousarray(weights.T), products(weights), biases, 1, x, p
        )
        p = np.ascontiguousarray(p)
    q = rng.multivariate_normal(x, p, 2000)
    y = q @ weights.T + biases
    log_p = y[:, 1] - np.log(np.exp(y).sum(axis=1))
    kept = rng.multivariate_normal(mean, cov, 40_000)
    z = kept @ weights.T + biases
    w = np.exp(z[:, 1]) / np.exp(z).sum(axis=1)
    true_mean = (w[:, None] * kept).sum(axis=0) / w.sum()
    assert np.linalg.norm(x - true_mean) < 0.8  # a proposal, not an estimate
    assert np.linalg.eigvalsh(p).max() <= 1.0 + 1e-9  # never wider than the prior
    assert log_p.mean() > np.log(w.mean()) - 1.0


@pytest.mark.parametrize("seed", range(6))
def test_merging_keeps_mean_and_covariance_of_the_mixture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, d = int(rng.integers(2, 60)), 2 + seed % 3
    roots = rng.normal(0.0, 1.0, (n, d, d))
    many = Components(
        rng.dirichlet(np.ones(n)),
        rng.normal(0.0, 5.0, (n, d)),
        roots @ roots.swapaxes(1, 2) + 0.1 * np.eye(d),
    )
    few = Components(*merged(many.weights, many.means, many.covariances, 7))
    assert few.count == min(n, 7)
    for a, b in zip(moments_of(many), moments_of(few), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_merging_joins_the_cheapest_pair_each_time() -> None:
    rng = np.random.default_rng(3)
    w, x = rng.dirichlet(np.ones(12)), rng.normal(0.0, 4.0, (12, 2))
    p = np.tile(np.eye(2), (12, 1, 1))
    got = sorted(merged(w, x, p, 5)[0])
    total = moments_of(Components(w, x, p))[1]
    weights, means = list(w), list(x)
    while len(weights) > 5:
        costs = {
            (i, j): weights[i]
            * weights[j]
            / (weights[i] + weights[j])
            * float((means[i] - means[j]) @ np.linalg.solve(total, means[i] - means[j]))
            for i in range(len(weights))
            for j in range(i)
        }
        i, j = min(costs, key=lambda key: costs[key])
        means[j] = (weights[i] * means[i] + weights[j] * means[j]) / (weights[i] + weights[j])
        weights[j] += weights[i]
        del weights[i], means[i]
    np.testing.assert_allclose(got, sorted(weights))
