"""Kalman updates of Gaussian components, against numpy, scipy, Stone Soup and sampling."""

from datetime import datetime
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.gaussian.components import checked, first_indefinite
from estimator.gaussian.update import Rule, innovations, kalman_pairs
from estimator.sensors.range_bearing import RangeBearing

POSES = {2: np.array([5.0, -3.0, 0.0, 0.4]), 3: np.array([5.0, -3.0, 2.0, 0.4])}
RULES: list[Rule] = ["ekf", "ukf"]


def sensor(d: int = 2, **changes: Any) -> RangeBearing:
    config = {
        "period_s": 1.0,
        "range_sigma_m": 0.5,
        "bearing_sigma_deg": 2.0,
        "elevation_sigma_deg": 2.0 if d == 3 else None,
        "reach_m": [20.0] * d,
    }
    return RangeBearing.of(RangeBearing.Config(**{**config, **changes}), Area(np.zeros(d), np.full(d, 99.0)))


def some(d: int, moving: bool, k: int = 12, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Means and covariances of k components about the sensor."""
    rng = np.random.default_rng(seed)
    n = 2 * d if moving else d
    root = rng.normal(0.0, 0.4, (k, n, n))
    means = rng.uniform(-15.0, 15.0, (k, n))
    return means, root @ np.swapaxes(root, 1, 2) + 0.05 * np.eye(n)


def wrapped(step: FloatArray, angular: Any) -> FloatArray:
    return np.where(angular, (step + np.pi) % (2 * np.pi) - np.pi, step)


def textbook(model: RangeBearing, mean: FloatArray, cov: FloatArray, z: FloatArray, d: int) -> Any:
    """Extended Kalman update as it stands in books: log-likelihood, mean, covariance."""
    h = np.zeros((model.measurement_size, mean.size))
    h[:, :d] = model.jacobian(mean[:d, None], POSES[d])[0]
    s = h @ cov @ h.T + model.noise
    gain = cov @ h.T @ np.linalg.inv(s)
    step = wrapped(z - model.measure(mean[:d, None], POSES[d])[0], model.angular)
    value = multivariate_normal.logpdf(step, cov=s)
    return value, mean + gain @ step, (np.eye(mean.size) - gain @ h) @ cov, step @ np.linalg.solve(s, step)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("d", [2, 3])
def test_extended_updates_are_the_textbooks_for_every_gated_pair_and_no_other(d: int, moving: bool) -> None:
    model, (means, covariances) = sensor(d), some(d, moving)
    rng = np.random.default_rng(1)
    z = model.sample(np.repeat(means[:, :d].T, 3, axis=1), POSES[d], rng)
    pairs = kalman_pairs(means, covariances, model, POSES[d], z, gate=5.0)
    owners = pairs.owners()
    seen = set(zip(owners.tolist(), pairs.measurements.tolist(), strict=True))
    assert len(seen) == owners.size > 10
    for i in range(len(means)):
        for j in range(len(z)):
            value, mean, cov, square = textbook(model, means[i], covariances[i], z[j], d)
            assert ((i, j) in seen) == (square <= 25.0)
            if (i, j) in seen:
                at = int(np.flatnonzero((owners == i) & (pairs.measurements == j))[0])
                assert pairs.log_likelihood[at] == pytest.approx(value, abs=1e-9)
                assert np.allclose(pairs.means[at], mean, atol=1e-9)
                assert np.allclose(pairs.covariances[i], cov, atol=1e-9)


@pytest.mark.parametrize("d", [2, 3])
def test_the_unscented_update_is_stone_soups(d: int) -> None:
    from stonesoup.models.measurement.nonlinear import (
        CartesianToBearingRange,
        CartesianToElevationBearingRange,
    )
    from stonesoup.types.array import StateVector
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.prediction import GaussianStatePrediction
    from stonesoup.updater.kalman import UnscentedKalmanUpdater

    model, (means, covariances) = sensor(d), some(d, False)
    covariances *= 0.01  # Stone Soup takes circular means of bearings: other terms of third order
    z = model.sample(np.ascontiguousarray(means.T), POSES[d], np.random.default_rng(2))
    pairs = kalman_pairs(means, covariances, model, POSES[d], z, rule="ukf", gate=4.0)
    kind = CartesianToBearingRange if d == 2 else CartesianToElevationBearingRange
    theirs = kind(
        ndim_state=d,
        mapping=tuple(range(d)),
        noise_covar=np.diag(model.sigmas[::-1] ** 2),
        translation_offset=StateVector(POSES[d][:d]),
    )
    when = datetime(2024, 1, 1)
    updater = UnscentedKalmanUpdater(theirs, alpha=1.0, beta=0.0, kappa=3.0 - d)
    assert pairs.measurements.size >= 5
    for at, i in enumerate(pairs.owners()):
        prior = GaussianStatePrediction(StateVector(means[i]), covariances[i], timestamp=when)
        seen = Detection(
            StateVector(z[pairs.measurements[at]][::-1]), timestamp=when, measurement_model=theirs
        )
        post = updater.update(SingleHypothesis(prior, seen))
        assert np.allclose(pairs.means[at], np.ravel(post.state_vector).astype(float), atol=1e-6)
        assert np.allclose(pairs.covariances[i], post.covar, atol=1e-6)


def test_unscented_moments_are_those_of_many_samples_where_the_extended_ones_are_not() -> None:
    model, mean = sensor(), np.array([[8.0, -2.0, 1.0, 0.5]])
    cov = np.diag([1.0, 1.0, 0.3, 0.3]) + 0.0
    cov[0, 2] = cov[2, 0] = 0.4
    ours = innovations(mean, cov[None], model, POSES[2], "ukf")
    crude = innovations(mean, cov[None], model, POSES[2], "ekf")
    x = np.random.default_rng(3).multivariate_normal(mean[0], cov, 200_000)
    z = model.measure(np.ascontiguousarray(x[:, :2].T), POSES[2])
    exact = np.cov(z.T) + model.noise
    spread = ours.factors[0] @ ours.factors[0].T
    assert np.abs(ours.predicted[0] - z.mean(axis=0)).max() < 0.02
    assert np.abs(crude.predicted[0] - z.mean(axis=0)).max() > 0.05
    assert np.allclose(spread, exact, atol=0.06)
    cross = np.cov(x.T, z.T)[:4, 4:]
    assert np.allclose(ours.gains[0] @ ours.factors[0].T, cross, atol=0.05)


@pytest.mark.parametrize("rule", RULES)
def test_bearings_on_both_sides_of_pi_are_neighbours(rule: Rule) -> None:
    model = sensor()
    behind = np.array([[POSES[2][0] - 10.0, POSES[2][1] + 0.01]])
    z = np.array([[10.0, -np.pi + 0.01], [10.0, np.pi - 0.01], [10.0, 3 * np.pi], [10.0, 0.0]])
    pairs = kalman_pairs(behind, np.eye(2)[None], model, POSES[2], z, rule=rule)
    assert sorted(pairs.measurements.tolist()) == [0, 1, 2]
    assert np.abs(pairs.means - behind).max() < 0.5


@pytest.mark.parametrize("rule", RULES)
def test_permuted_measurements_give_the_same_pairs_bit_for_bit(rule: Rule) -> None:
    model, (means, covariances) = sensor(), some(2, True, k=30)
    z = model.sample(np.ascontiguousarray(means[:, :2].T), POSES[2], np.random.default_rng(4))
    order = np.random.default_rng(5).permutation(len(z))
    one = kalman_pairs(means, covariances, model, POSES[2], z, rule=rule)
    other = kalman_pairs(means, covariances, model, POSES[2], z[order], rule=rule)
    assert one.means.tobytes() == other.means.tobytes()
    assert one.log_likelihood.tobytes() == other.log_likelihood.tobytes()
    assert np.array_equal(one.measurements, order[other.measurements])


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("d", [2, 3])
def test_a_component_on_the_sensor_stays_finite_and_regular(d: int, rule: Rule) -> None:
    model, mean = sensor(d), POSES[d][None, :d].copy()
    z = np.zeros((2, d))
    z[1, 1] = 2.0
    pairs = kalman_pairs(mean, 0.3 * np.eye(d)[None], model, POSES[d], z, rule=rule, gate=50.0)
    assert pairs.measurements.size
    assert np.isfinite(pairs.means).all()
    assert first_indefinite(pairs.covariances) == -1


def test_a_huge_covariance_stays_positive_definite_under_sharp_measurements() -> None:
    model = sensor(range_sigma_m=1e-3, bearing_sigma_deg=1e-3)
    means, covariances = np.array([[40.0, 30.0, 0.0, 0.0]]), 1e8 * np.eye(4)[None]
    expected = innovations(means, covariances, model, POSES[2], "ekf")
    assert first_indefinite(expected.covariances) == -1
    assert np.linalg.eigvalsh(expected.covariances[0]).min() < 1e-3


@pytest.mark.parametrize("rule", RULES)
def test_nothing_and_nobody_give_no_pairs(rule: Rule) -> None:
    model, (means, covariances) = sensor(), some(2, False)
    empty = kalman_pairs(means, covariances, model, POSES[2], np.zeros((0, 2)), rule=rule)
    nobody = kalman_pairs(means[:0], covariances[:0], model, POSES[2], np.ones((3, 2)), rule=rule)
    assert empty.measurements.size == nobody.measurements.size == 0
    assert empty.offsets.tolist() == [0] * 13
    assert empty.covariances.shape == covariances.shape


@pytest.mark.parametrize("rule", RULES)
def test_what_is_no_covariance_is_named(rule: Rule) -> None:
    covariances = np.stack([np.eye(2), -np.eye(2) * 1e6])
    with pytest.raises(ValueError, match="covariances: number 1"):
        kalman_pairs(np.ones((2, 2)), covariances, sensor(), POSES[2], np.ones((1, 2)), rule=rule)


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("weights", np.array([-1.0])),
        ("weights", np.array([np.nan])),
        ("means", np.array([[np.inf, 0.0]])),
        ("means", np.zeros((2, 2))),
        ("covariances", np.zeros((1, 2, 2))),
        ("covariances", np.array([[[1.0, 2.0], [2.0, 1.0]]])),
        ("covariances", np.array([[[1.0, 0.5], [0.0, 1.0]]])),
        ("covariances", np.full((1, 2, 2), np.nan)),
        ("covariances", np.eye(3)[None]),
    ],
)
def test_components_from_outside_are_checked(argument: str, value: FloatArray) -> None:
    good: dict[str, Any] = {"weights": np.ones(1), "means": np.zeros((1, 2)), "covariances": np.eye(2)[None]}
    assert checked(**good).count == 1
    with pytest.raises(ValueError, match=f"^{argument}:"):
        checked(**{**good, argument: value})
