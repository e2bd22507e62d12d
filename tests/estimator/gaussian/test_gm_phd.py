"""The Gaussian-mixture PHD filter, against integrals on a fine grid, closed forms and its own symmetries."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.gaussian.birth import born
from estimator.gaussian.components import Components, first_indefinite
from estimator.gaussian.gm_phd import GmPhd, GmPhdState
from estimator.motion import Motion, MotionConfig
from estimator.sensor import gaussian
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.correction import corrected
from estimator.undetected import Undetected
from tests.estimator.exact import Sighting, posterior_intensity
from tests.estimator.sensors import cases

AREA = Area(np.zeros(2), np.full(2, 100.0))
POSE = np.array([50.0, 50.0, 5.0, 0.3])
TARGETS = np.array([[30.0, 62.0, 75.0], [40.0, 71.0, 20.0]])
RNG = np.random.default_rng(0)  # the filter draws nothing


def sensor(**changes: Any) -> RangeBearing:
    config = {
        "period_s": 1.0,
        "range_sigma_m": 0.5,
        "bearing_sigma_deg": 1.0,
        "reach_m": [40.0, 40.0],
        "gain": 0.9,
    }
    return RangeBearing.of(RangeBearing.Config(**{**config, **changes}), AREA)


def even(**changes: Any) -> RangeBearing:
    """A sensor with the same p_D everywhere."""
    return sensor(field_of_view="box", box_m=[(-1e4, 1e4)] * 2, **changes)


def mixture(k: int = 12, seed: int = 0) -> Components:
    """Components about TARGETS."""
    rng = np.random.default_rng(seed)
    root = rng.normal(0.0, 0.4, (k, 2, 2))
    means = TARGETS.T[np.arange(k) % 3] + rng.normal(0.0, 0.5, (k, 2))
    covariances = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(2)
    return Components(rng.uniform(0.1, 0.4, k), means, covariances)


def given_state(filter: GmPhd, components: Components) -> GmPhdState:
    state = filter.init(AREA, RNG)
    return replace(state, components=components, labels=np.full(components.count, -1))


def plain(**changes: Any) -> GmPhd:
    """A filter that neither prunes nor merges, with nothing undetected."""
    config = {"expected_targets": 0.0, "prune": 0.0, "merge_sigmas": 0.0, "components": 100_000}
    return GmPhd(GmPhd.Config(**{**config, **changes}))


def on_grid(component: Components, side: int = 241) -> tuple[FloatArray, FloatArray]:
    """Points (2, n) and weights (n,) of one component, to 7 standard deviations."""
    values, vectors = np.linalg.eigh(component.covariances[0])
    t = np.linspace(-7.0, 7.0, side)
    units = np.stack([a.ravel() for a in np.meshgrid(t, t, indexing="ij")])
    density = np.exp(-0.5 * (units**2).sum(axis=0))
    points = component.means[0][:, None] + (vectors * np.sqrt(values)) @ units
    return np.ascontiguousarray(points), component.weights[0] * density / density.sum()


def moments(mixture: Components) -> tuple[float, FloatArray, FloatArray]:
    """Mass, mean and covariance of a whole mixture."""
    mass = float(mixture.weights.sum())
    mean = mixture.weights @ mixture.means / mass
    step = mixture.means - mean
    spread = mixture.covariances + step[:, :, None] * step[:, None, :]
    return mass, mean, np.einsum("k,kij->ij", mixture.weights, spread) / mass


def points_moments(points: FloatArray, weights: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    mean = points @ weights / weights.sum()
    step = points - mean[:, None]
    return float(weights.sum()), mean, (weights * step) @ step.T / weights.sum()


@pytest.mark.parametrize("update", ["ekf", "ukf"])
@pytest.mark.parametrize("clutter", [0.0, 0.5])
def test_the_update_is_the_phd_corrector_integrated_on_a_fine_grid(update: Any, clutter: float) -> None:
    model, filter = even(clutter=clutter, gain=0.8), plain(update=update)
    one = Components(np.array([0.7]), np.array([[62.0, 71.0]]), np.array([[[1.0, 0.3], [0.3, 0.5]]]))
    z = model.measure(np.array([[62.6], [70.7]]), POSE)
    after = filter.update(given_state(filter, one), model, POSE, z, RNG).components
    points, weights = on_grid(one)
    exact = points_moments(points, corrected(weights, model.look(points, POSE, z)))
    mass, mean, spread = moments(after)
    assert mass == pytest.approx(exact[0], rel=2e-3)
    assert np.allclose(mean, exact[1], atol=0.01)
    assert np.allclose(spread, exact[2], atol=0.02)


@pytest.mark.parametrize("looks", [1, 3])
@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_half_of_a_wide_component_in_view_is_taken_away_and_the_other_half_stays(
    turn: float, looks: int
) -> None:
    model = sensor(field_of_view="sector", range_m=60.0, angle_deg=120.0, gain=0.95)
    filter, pose = GmPhd(GmPhd.Config(expected_targets=0.0)), np.array([20.0, 50.0, 0.0, 0.0])
    edge = np.array([20.0 + 60.0, 50.0])  # a component of 6 m about the arc where sight ends
    spread = np.array([[36.0, 8.0 * turn], [8.0 * turn, 25.0]])
    one = Components(np.array([1.0]), edge[None], spread[None])
    state = given_state(filter, one)
    for _ in range(looks):
        state = filter.update(state, model, pose, np.zeros((0, 2)), RNG)
    points, weights = on_grid(one)
    unseen = (1.0 - model.detection(points, pose[None])[0]) ** looks
    mass, mean, cov = points_moments(points, weights * unseen)
    ours = moments(state.components)
    assert ours[0] == pytest.approx(mass, abs=0.06 if looks == 1 else 0.1)
    assert np.abs(ours[1] - mean).max() < 1.0 < mean[0] - edge[0]  # it moved out of sight
    assert np.allclose(ours[2], cov, atol=10.0 if looks == 1 else 3.0)


def test_a_measurement_of_a_wide_component_counts_with_p_d_where_it_points() -> None:
    model = sensor(field_of_view="sector", range_m=60.0, angle_deg=120.0, gain=0.95, clutter=0.4)
    pose, filter = np.array([20.0, 50.0, 0.0, 0.0]), plain()
    one = Components(np.array([1.0]), np.array([[80.0, 50.0]]), 36.0 * np.eye(2)[None])
    for x in (76.0, 79.5, 80.5, 84.0):
        z = model.measure(np.array([[x], [52.0]]), pose)
        after = filter.update(given_state(filter, one), model, pose, z, RNG).components
        points, weights = on_grid(one)
        exact = corrected(weights, model.look(points, pose, z)).sum()
        assert after.weights.sum() == pytest.approx(exact, abs=0.12)


def test_tiny_components_follow_the_exact_multi_target_posterior() -> None:
    model, filter = even(clutter=0.3, gain=0.7), plain(gate_sigmas=8.0)
    places = np.array([[60.0, 60.8, 61.5, 59.4], [70.0, 70.5, 69.6, 71.0]])
    prior = np.array([0.15, 0.1, 0.05, 0.12])
    tiny = Components(prior, places.T.copy(), np.repeat(1e-8 * np.eye(2)[None], 4, axis=0))
    z = model.measure(np.array([[60.2, 61.0], [70.1, 70.4]]), POSE)
    after = filter.update(given_state(filter, tiny), model, POSE, z, RNG).components
    at = np.argmin(((after.means[:, :, None] - places[None]) ** 2).sum(axis=1), axis=1)
    look = model.look(places, POSE, z)
    g = np.zeros((2, 4))
    for j in range(2):
        row = slice(look.offsets[j], look.offsets[j + 1])
        g[j, look.indices[row]] = look.likelihood[row]
    exact = posterior_intensity(prior, [Sighting(look.detection, g, look.clutter)], most=8)
    assert np.allclose(np.bincount(at, after.weights), exact, rtol=1e-6)


@pytest.mark.parametrize("clutter", [0.0, 2.0])
def test_mass_balances_with_components_and_undetected_part_together(clutter: float) -> None:
    filter, model = GmPhd(GmPhd.Config(expected_targets=5.0)), sensor(clutter=clutter)
    state = given_state(filter, mixture())
    fresh = np.array([[80.0], [80.0]])  # nobody has seen this one
    z = model.measure(np.concatenate([TARGETS, fresh], axis=1), POSE)
    after = filter.update(state, model, POSE, z, RNG)
    seen = model.detection(state.components.positions(2), POSE[None])[0]
    missed = np.sum(state.components.weights * (1 - seen)) + state.undetected.after(model, POSE).mass()
    if clutter == 0.0:
        assert filter.mass(after) == pytest.approx(missed + 4.0, rel=1e-3)
    else:
        assert missed < filter.mass(after) < missed + 4.0


def test_a_first_detection_puts_one_target_where_it_points() -> None:
    filter, model = GmPhd(GmPhd.Config(expected_targets=1.0)), sensor()
    z = model.measure(TARGETS[:, :1], POSE)
    state = filter.update(filter.init(AREA, RNG), model, POSE, z, RNG)
    assert state.components.weights.sum() == pytest.approx(1.0)
    _, clusters = filter.clusters(state, RNG)
    assert np.allclose(clusters.means[:, 0], TARGETS[:, 0], atol=1e-9)
    assert np.allclose(clusters.covariances[0], model.location_covariance(z, POSE)[0])


def test_an_empty_set_is_the_missed_detection_factor() -> None:
    filter, model = plain(), even(gain=0.6)
    state = given_state(filter, mixture())
    after = filter.update(state, model, POSE, np.zeros((0, 2)), RNG)
    assert np.allclose(np.sort(after.components.weights), np.sort(0.4 * state.components.weights))


def test_where_nothing_can_be_detected_nothing_changes() -> None:
    filter, model = plain(expected_targets=2.0), sensor(gain=0.0)
    state = given_state(filter, mixture())
    after = filter.update(state, model, POSE, model.measure(TARGETS, POSE), RNG)
    order = np.argsort(-state.components.weights, kind="stable")
    assert np.array_equal(after.components.weights[: order.size], state.components.weights[order])
    assert after.components.weights[order.size :].sum() == 0.0
    assert np.array_equal(after.undetected.values, state.undetected.values)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_the_order_of_measurements_does_not_matter_to_a_bit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    filter, model = GmPhd(GmPhd.Config(expected_targets=3.0)), sensor(clutter=3.0)
    state, z = given_state(filter, mixture(30, seed)), sensor(clutter=3.0).sample(TARGETS, POSE, rng)
    one = filter.update(state, model, POSE, z, RNG)
    other = filter.update(state, model, POSE, rng.permutation(z, axis=0), RNG)
    assert np.allclose(one.components.weights, other.components.weights, rtol=1e-12)
    assert np.allclose(one.components.means, other.components.means, rtol=1e-12)


@given(turn=st.floats(-4.0, 4.0), x=st.floats(-1e3, 1e3), y=st.floats(-1e3, 1e3), seed=st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_turning_and_moving_everything_turns_and_moves_the_posterior(
    turn: float, x: float, y: float, seed: int
) -> None:
    filter, model = plain(), even(clutter=1.0, bearing_frame="body")
    state, z = given_state(filter, mixture(seed=seed)), even(bearing_frame="body").measure(TARGETS, POSE)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    shift = np.array([x, y])

    def moved(c: Components) -> Components:
        return Components(
            c.weights,
            np.ascontiguousarray(c.means @ rotation.T + shift),
            np.ascontiguousarray(rotation @ c.covariances @ rotation.T),
        )

    pose = np.concatenate([rotation @ POSE[:2] + shift, [POSE[2], POSE[3] + turn]])
    here = moved(filter.update(state, model, POSE, z, RNG).components)
    there = filter.update(given_state(filter, moved(state.components)), model, pose, z, RNG).components
    order = np.lexsort(np.round(here.means.T, 4)), np.lexsort(np.round(there.means.T, 4))
    assert np.allclose(here.weights[order[0]], there.weights[order[1]], rtol=1e-5, atol=1e-9)
    assert np.allclose(here.means[order[0]], there.means[order[1]], atol=1e-5)


def test_a_target_seen_from_many_sides_becomes_as_narrow_as_a_kalman_filter_says() -> None:
    rng, model = np.random.default_rng(3), sensor(gain=1.0, reach_m=[1e4, 1e4])
    filter = GmPhd(GmPhd.Config())
    state = filter.init(AREA, rng)
    information, vector = np.zeros((2, 2)), np.zeros(2)
    for k in range(40):
        pose = np.array([10.0 + 2.0 * k, 90.0 - k, 5.0, 0.0])
        z = model.sample(TARGETS[:, :1], pose, rng)
        state, clusters = filter.clusters(filter.update(state, model, pose, z, rng), rng)
        for part, place in zip(model.location_covariance(z, pose), model.locate(z, pose).T, strict=True):
            information += np.linalg.inv(part)
            vector += np.linalg.solve(part, place)
    off = clusters.means[:, 0] - np.linalg.solve(information, vector)
    assert off @ information @ off < 0.1
    assert np.trace(clusters.covariances[0] @ information) / 2 == pytest.approx(1.0, abs=0.05)


def test_targets_that_move_are_followed_with_their_velocity() -> None:
    rng, model = np.random.default_rng(4), sensor(gain=0.95, reach_m=[500.0] * 2, clutter=0.5)
    motion = MotionConfig(kind="constant_velocity", acceleration=0.05, speed=1.5)
    filter = GmPhd(GmPhd.Config(expected_targets=2.0, motion=motion))
    state, start = filter.init(AREA, rng), np.array([[20.0, 80.0], [20.0, 30.0]])
    velocity = np.array([[1.5, -1.0], [0.5, 1.0]])
    off = []
    for k in range(30):
        state = filter.predict(state, 1.0 if k else 0.0, rng)
        truth = start + k * velocity
        state = filter.update(state, model, POSE, model.sample(truth, POSE, rng), rng)
        state, clusters = filter.clusters(state, rng)
        if k > 10 and (clusters.masses > 0.5).sum() == 2:
            apart = np.linalg.norm(clusters.means[:, :2, None] - truth[:, None, :], axis=0)
            off.append(apart.min(axis=0).max())
    assert len(off) > 12
    assert np.mean(off) < 0.6
    heavy = state.components.means[np.argsort(-state.components.weights)[:2], 2:]
    for v in velocity.T:
        assert np.linalg.norm(heavy - v, axis=1).min() < 0.3


@pytest.mark.parametrize("kind", ["random_walk", "constant_velocity"])
def test_prediction_adds_what_the_motion_says(kind: Any) -> None:
    motion = MotionConfig(kind=kind, drift=0.5, acceleration=0.3)
    filter = GmPhd(GmPhd.Config(motion=motion, expected_targets=0.0, survival=0.9))
    n = filter.init(AREA, RNG).components.state_size
    rng = np.random.default_rng(1)
    root = rng.normal(size=(5, n, n))
    c = Components(np.ones(5), rng.normal(size=(5, n)), root @ np.swapaxes(root, 1, 2) + np.eye(n))
    after = filter.predict(given_state(filter, c), 2.0, RNG).components
    t = 2.0
    f = np.eye(n)
    q = 0.25 * t * np.eye(2)
    if kind == "constant_velocity":
        f[:2, 2:] = t * np.eye(2)
        q = 0.09 * np.block(
            [[t**3 / 3 * np.eye(2), t**2 / 2 * np.eye(2)], [t**2 / 2 * np.eye(2), t * np.eye(2)]]
        )
    assert np.allclose(after.weights, 0.81)
    assert np.allclose(after.means, c.means @ f.T)
    assert np.allclose(after.covariances, f @ c.covariances @ f.T + q)


def test_a_sensor_without_gaussian_noise_is_refused_by_name() -> None:
    class Odd(RangeBearing):
        jacobian = property()  # type: ignore[assignment]

    model = sensor()
    odd = Odd(model.field, model.sigmas, model.clutter, model.clutter_low, model.clutter_high)
    filter = GmPhd(GmPhd.Config())
    with pytest.raises(ValueError, match=r"^sensor:"):
        filter.update(filter.init(AREA, RNG), odd, POSE, np.ones((1, 2)), RNG)


def test_many_measurements_leave_a_bounded_regular_mixture() -> None:
    filter, model = GmPhd(GmPhd.Config(components=50)), sensor(clutter=3000.0)
    z = model.sample(TARGETS, POSE, np.random.default_rng(6))
    state = filter.update(given_state(filter, mixture(40)), model, POSE, z, RNG)
    assert len(z) > 2000
    assert state.components.count <= 50
    assert first_indefinite(state.components.covariances) == -1
    assert np.isfinite(state.components.means).all()


@pytest.mark.parametrize("clutter", [0.0, 20_000.0])
def test_a_flood_of_measurements_leaves_a_bounded_finite_state(clutter: float) -> None:
    filter, model = GmPhd(GmPhd.Config(components=50)), sensor(clutter=clutter)
    z = np.random.default_rng(7).uniform([0.0, -np.pi], [70.0, np.pi], (20_000, 2))
    state = filter.update(given_state(filter, mixture(40)), model, POSE, z, RNG)
    assert state.components.count <= 50
    assert np.isfinite(filter.mass(state))
    assert first_indefinite(state.components.covariances) == -1


@pytest.mark.parametrize("name", ["bearing_only-paper", "range_only-exponential", "position-box"])
def test_targets_are_found_by_bearings_or_ranges_alone(name: str) -> None:
    model, targets = cases.case(name, 2).sensor, np.array([[6.0, 17.0], [7.0, 16.0]])
    filter, rng = GmPhd(GmPhd.Config(expected_targets=2.0)), np.random.default_rng(0)
    state, masses = filter.init(cases.area(2), rng), []
    for k in range(50):
        pose = np.array([12 + 9 * np.cos(0.4 * k), 12 + 9 * np.sin(0.4 * k), 0.0, 0.4 * k + np.pi])
        state = filter.update(state, model, pose, model.sample(targets, pose, rng), rng)
        places, weights = state.components.positions(2), state.components.weights
        near = np.linalg.norm(places[:, :, None] - targets[:, None, :], axis=0) < 0.8
        masses.append(weights @ near)
    assert np.allclose(np.mean(masses[25:], axis=0), 1.0, atol=0.4)


@pytest.mark.parametrize("name", ["bearing_only-smooth", "range_only-exponential"])
def test_what_the_undetected_part_explains_of_a_bearing_or_a_range_is_the_integral(name: str) -> None:
    model, area = gaussian(cases.case(name, 2).sensor), cases.area(2)
    pose = np.array([12.0, 10.0, 0.0, 0.4])
    z = model.measure(np.array([[15.0], [12.0]]), pose)
    prior = Undetected.uniform(area, (49, 49), 2.0)
    births = born(prior, model, pose, z, np.zeros(1), np.zeros(1), Motion(2, MotionConfig()), "ekf")
    t = np.linspace(0.0, cases.SIDE, 801)
    points = np.stack([a.ravel() for a in np.meshgrid(t, t, indexing="ij")])
    look = model.look(points, pose, z)
    cell = 2.0 / cases.SIDE**2 * (t[1] - t[0]) ** 2
    exact = cell * (look.detection[look.indices] * look.likelihood).sum()
    assert births.totals[0] == pytest.approx(exact, rel=0.05)
    assert births.components.weights.sum() == pytest.approx(births.totals[0])


def test_updating_leaves_the_old_state_as_it_was() -> None:
    filter, model = GmPhd(GmPhd.Config()), sensor()
    state = given_state(filter, mixture())
    kept = state.components.weights.copy(), state.components.means.copy(), state.components.covariances.copy()
    filter.clusters(filter.update(state, model, POSE, model.measure(TARGETS, POSE), RNG), RNG)
    now = state.components
    for before, after in zip(kept, (now.weights, now.means, now.covariances), strict=True):
        assert np.array_equal(before, after)
