"""The Kalman filter with intermittent measurements, against closed forms."""

from typing import Any

import numpy as np
import pytest

from estimator.filter import Area
from estimator.gaussian.kalman import Kalman, corrected, expected_covariance, predicted
from estimator.motion import MotionConfig
from estimator.search import Search
from estimator.sensors.range_bearing import RangeBearing

AREA = Area(np.zeros(2), np.full(2, 50.0))
RNG = np.random.default_rng(0)
EYE = np.eye(2)


def sensor(**changes: Any) -> RangeBearing:
    config = {
        "period_s": 1.0,
        "range_sigma_m": 0.1,
        "bearing_sigma_deg": 0.5,
        "field_of_view": "sector",
        "range_m": 5.0,
        "angle_deg": 60.0,
    }
    return RangeBearing.of(RangeBearing.Config(**{**config, **changes}), AREA)


def test_one_step_is_equation_5_with_the_papers_matrices() -> None:
    mean, cov = predicted(np.array([1.0, 2.0]), 4.0 * EYE, EYE, 0.01 * EYE, shift=np.array([0.5, 0.0]))
    assert np.allclose(mean, [1.5, 2.0])
    assert np.allclose(cov, 4.01 * EYE)
    mean, cov = corrected(mean, cov, np.array([2.5, 2.0]), EYE, EYE)
    assert np.allclose(mean, [1.5 + 4.01 / 5.01, 2.0])
    assert np.allclose(cov, 4.01 / 5.01 * EYE)


def test_what_did_not_come_changes_nothing_and_half_of_it_half_as_much() -> None:
    mean, cov, y = np.array([1.0, 2.0]), np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([3.0, 1.0])
    same = corrected(mean, cov, y, EYE, EYE, gamma=0.0)
    assert np.array_equal(same[0], mean)
    assert np.array_equal(same[1], cov)
    whole, half = corrected(mean, cov, y, EYE, EYE), corrected(mean, cov, y, EYE, EYE, gamma=0.5)
    assert np.allclose(half[0], 0.5 * (mean + whole[0]))
    assert np.allclose(half[1], 0.5 * (cov + whole[1]))


@pytest.mark.parametrize("a", [0.7, 1.0, 1.3])
def test_with_every_measurement_the_variance_settles_at_the_riccati_equations_root(a: float) -> None:
    q, r, p = 0.3, 2.0, np.array([[50.0]])
    one = np.eye(1)
    for _ in range(300):
        p = expected_covariance(p, a * one, q * one, one, r * one, 1.0)
    # p = a^2 p r / (p + r) + q
    b = r - a * a * r - q
    assert p[0, 0] == pytest.approx(0.5 * (-b + np.sqrt(b * b + 4.0 * q * r)))


@pytest.mark.parametrize(("rate", "settles"), [(0.35, False), (0.45, True)])
def test_below_sinopolis_critical_rate_the_variance_grows_without_bound(rate: float, settles: bool) -> None:
    a, one = 1.3, np.eye(1)  # critical: 1 - 1 / a^2 = 0.408
    p = one
    for _ in range(4000):
        p = expected_covariance(p, a * one, one, one, one, rate)
        if p[0, 0] > 1e12:
            break
    assert (p[0, 0] < 1e6) == settles


def test_the_modified_riccati_equation_bounds_the_mean_of_random_runs() -> None:
    a, rate, one, rng = 1.05, 0.6, np.eye(1), np.random.default_rng(1)
    bound = one
    for _ in range(500):
        bound = expected_covariance(bound, a * one, one, one, one, rate)
    p, total = one, 0.0
    for _ in range(20_000):
        _, p = corrected(np.zeros(1), p, np.zeros(1), one, one, gamma=float(rng.random() < rate))
        _, p = predicted(np.zeros(1), p, a * one, one)
        total += p[0, 0] / 20_000
    assert 0.5 * bound[0, 0] < total < 1.02 * bound[0, 0]


@pytest.mark.parametrize("gamma", [-0.1, 1.1, np.nan])
def test_a_share_of_a_measurement_lies_between_nothing_and_all(gamma: float) -> None:
    with pytest.raises(ValueError, match="gamma"):
        corrected(np.zeros(2), EYE, np.zeros(2), EYE, EYE, gamma)


def test_what_is_no_covariance_is_named() -> None:
    with pytest.raises(ValueError, match="covariance"):
        corrected(np.zeros(2), -EYE, np.zeros(2), EYE, 0.5 * EYE)


def test_a_standing_target_gathers_the_information_of_its_measurements_and_no_clutter() -> None:
    rng = np.random.default_rng(2)
    filter = Kalman(Kalman.Config(start_m=[20.0, 22.0], start_sigma_m=2.0))
    model = sensor(clutter=1.0, field_of_view="box", box_m=[(-50, 50)] * 2, gain=0.7)
    state, truth, information = filter.init(AREA, rng), np.array([[20.5], [21.0]]), 0.25 * EYE
    for k in range(40):
        pose = np.array([15.0 + 0.2 * k, 15.0, 0.0, 0.0])
        seen = model.sample(truth, pose, rng)
        before = state
        state = filter.update(state, model, pose, seen, rng)
        if state is not before:
            information = information + np.linalg.inv(state.covariance) - np.linalg.inv(before.covariance)
    assert np.allclose(np.linalg.inv(state.covariance), information)
    off = state.mean - truth[:, 0]
    assert off @ information @ off < 12.0
    assert np.trace(state.covariance) < 0.01


def test_the_papers_target_is_tracked_while_it_is_in_the_sector_and_blurs_while_it_is_not() -> None:
    rng = np.random.default_rng(3)
    motion = MotionConfig(kind="random_walk", drift=0.1)
    filter = Kalman(Kalman.Config(motion=motion, start_m=[20.0, 20.0], start_sigma_m=3.0))
    model, state = sensor(), filter.init(AREA, rng)
    truth, traces, off = np.array([[21.0], [21.0]]), [], []
    for k in range(60):
        truth = truth + 0.1 * rng.standard_normal((2, 1))
        state = filter.predict(state, 1.0, rng)
        away = 20 <= k < 40
        pose = np.array([18.0, 20.0, 0.0, np.pi if away else 0.3])
        state = filter.update(state, model, pose, model.sample(truth, pose, rng), rng)
        traces.append(np.trace(state.covariance))
        off.append(float(np.linalg.norm(state.mean - truth[:, 0])))
    assert traces[19] < 0.05
    assert np.allclose(np.diff(traces[20:40]), 2 * 0.1**2)
    assert traces[45] < 0.05
    assert max(off[41:]) < 0.5


def test_a_mission_finds_the_one_target_and_leaves_it_alone_then() -> None:
    rng, model = np.random.default_rng(4), sensor(gain=0.95, clutter=0.05)
    search = Search(Kalman(Kalman.Config()), AREA, [5, 5], radius=0.3, mass=0.5, gate=2.0)
    state, truth = search.init(rng), np.array([[30.0], [30.0]])
    for k in range(6):
        pose = np.array([27.0, 29.0 + 0.2 * k, 0.0, 0.2])
        state = search.apply(state, model, pose, model.sample(truth, pose, rng), float(k), rng)
    assert state.found.shape == (2, 1)
    assert np.linalg.norm(state.found - truth) < 0.3
    assert search.expected_cardinality(state) == 1.0


@pytest.mark.parametrize("start", [[1.0, 2.0, 3.0], [np.nan, 1.0]])
def test_a_start_that_does_not_fit_is_named(start: list[float]) -> None:
    with pytest.raises(ValueError, match="start_m"):
        Kalman(Kalman.Config(start_m=start)).init(AREA, RNG)


def test_a_target_with_a_known_velocity_drifts_with_it_as_equation_5a_says() -> None:
    config = Kalman.Config(
        motion=MotionConfig(kind="random_walk", drift=0.1),
        start_m=[40.0, 30.0],
        start_sigma_m=2.0,
        start_velocity_m_s=[-0.5, 0.2],
    )
    filter = Kalman(config)
    state = filter.init(AREA, RNG)
    for _ in range(4):
        state = filter.predict(state, 2.5, RNG)
    np.testing.assert_allclose(state.mean, [35.0, 32.0])
    np.testing.assert_allclose(state.covariance, (4.0 + 0.01 * 10.0) * EYE)
    _, clusters = filter.clusters(state, RNG)
    assert clusters.velocities is not None
    np.testing.assert_allclose(clusters.velocities, [[-0.5], [0.2]])


def test_a_standing_target_has_no_velocity_to_give() -> None:
    with pytest.raises(ValueError, match="start_velocity_m_s"):
        Kalman(Kalman.Config(start_velocity_m_s=[1.0, 0.0])).init(AREA, RNG)
