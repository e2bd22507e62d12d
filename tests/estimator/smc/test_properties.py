"""What must hold of the particle filter whatever it is fed, and what it does with bad and extreme input."""

import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.smc_phd import SmcPhd, SmcPhdState

AREA = Area(np.zeros(2), np.full(2, 60.0))
TARGETS = np.array([[20.0, 35.0, 50.0], [15.0, 40.0, 30.0]])
POSE = np.array([30.0, 30.0, 0.0, 0.4])
INITIALS = ("undetected", "grid")


def sensor_with(**changes: Any) -> RangeBearing:
    base = {
        "period_s": 1.0,
        "range_sigma_m": 0.8,
        "bearing_sigma_deg": 2.0,
        "reach_m": [30.0, 30.0],
        "gain": 0.9,
        "clutter": 1.0,
    }
    return RangeBearing.of(RangeBearing.Config(**{**base, **changes}), AREA)


def filter_with(**changes: Any) -> SmcPhd:
    base = {"expected_targets": 4.0, "resample_below": 0.0, "particles": 4000}
    return SmcPhd(SmcPhd.Config(**{**base, **changes}))


def after_some_looks(filter: SmcPhd, seed: int, sensor: RangeBearing | None = None) -> SmcPhdState:
    rng, sensor = np.random.default_rng(seed), sensor or sensor_with()
    state = filter.init(AREA, rng)
    for _ in range(3):
        pose = np.append(rng.uniform(0, 60, 2), [0.0, rng.uniform(-3, 3)])
        state = filter.update(state, sensor, pose, sensor.sample(TARGETS, pose, rng), rng)
    return state


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(INITIALS), st.floats(0.0, 3.0))
def test_mass_is_what_was_missed_plus_a_share_of_each_measurement(
    seed: int, initial: str, clutter: float
) -> None:
    filter, sensor = filter_with(initial=initial), sensor_with(clutter=clutter)
    state, rng = after_some_looks(filter, seed, sensor), np.random.default_rng(seed)
    z = sensor.sample(TARGETS, POSE, rng)
    points, weights = filter.points(state)
    missed = weights @ (1.0 - sensor.detection(points, POSE)[0])
    mass = filter.mass(filter.update(state, sensor, POSE, z, rng))
    assert missed - 1e-9 <= mass <= missed + len(z) + 1e-9
    if initial == "grid":  # nothing is outside the particles, so each share is known
        look = sensor.look(state.positions, POSE, z)
        rows = np.repeat(np.arange(len(z)), np.diff(look.offsets))
        terms = look.likelihood * (state.weights * look.detection)[look.indices]
        explained = np.bincount(rows, terms, minlength=len(z))
        shares = np.divide(explained, explained + look.clutter, out=np.zeros(len(z)), where=explained > 0)
        assert mass == pytest.approx(missed + shares.sum(), rel=1e-9)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(INITIALS))
def test_the_order_of_the_measurements_does_not_matter(seed: int, initial: str) -> None:
    filter, sensor = filter_with(initial=initial), sensor_with()
    state, rng = after_some_looks(filter, seed), np.random.default_rng(seed)
    z = sensor.sample(TARGETS, POSE, rng)
    one = filter.update(state, sensor, POSE, z, np.random.default_rng(1))
    other = filter.update(state, sensor, POSE, rng.permutation(z, axis=0), np.random.default_rng(2))
    n = state.weights.size  # what comes on top is drawn
    assert np.allclose(other.weights[:n], one.weights[:n], rtol=1e-9, atol=1e-300)
    assert filter.mass(other) == pytest.approx(filter.mass(one), rel=1e-9)


@pytest.mark.parametrize("initial", INITIALS)
@pytest.mark.parametrize("seed", range(3))
def test_turning_and_moving_the_frame_moves_the_estimate_along(initial: str, seed: int) -> None:
    """A quarter turn maps the area's grid onto itself, so that nothing but rounding may differ."""
    shift = np.array([[100.0], [-40.0]])
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    low = shift[:, 0] + np.array([-60.0, 0.0])
    turned_area = Area(low, low + 60.0)
    filter, sensor = filter_with(initial=initial), sensor_with(bearing_frame="body")
    turned_sensor = RangeBearing.of(
        RangeBearing.Config(
            period_s=1.0,
            range_sigma_m=0.8,
            bearing_sigma_deg=2.0,
            reach_m=[30.0, 30.0],
            gain=0.9,
            clutter=1.0,
            bearing_frame="body",
        ),
        turned_area,
    )
    rng, here, there = np.random.default_rng(seed), np.random.default_rng(0), np.random.default_rng(0)
    state, turned = filter.init(AREA, here), filter.init(turned_area, there)
    for _ in range(4):
        place, yaw = rng.uniform(0, 60, (2, 1)), rng.uniform(-3, 3)
        pose = np.array([place[0, 0], place[1, 0], 0.0, yaw])
        x, y = (quarter @ place + shift)[:, 0]
        z = sensor.sample(TARGETS, pose, rng)
        state = filter.update(state, sensor, pose, z, here)
        turned = filter.update(turned, turned_sensor, np.array([x, y, 0.0, yaw + np.pi / 2]), z, there)
    assert filter.mass(turned) == pytest.approx(filter.mass(state), rel=0.02)
    _, clusters = filter.clusters(state, here)
    _, turned_clusters = filter.clusters(turned, there)
    heavy, turned_heavy = clusters.masses > 0.5, turned_clusters.masses > 0.5
    expected = quarter @ clusters.means[:, heavy] + shift
    apart = np.linalg.norm(expected[:, :, None] - turned_clusters.means[:, None, turned_heavy], axis=0)
    assert heavy.sum() == turned_heavy.sum() > 0
    assert apart.min(axis=1).max() < 0.5  # drawn particles differ by their sampling error


@pytest.mark.parametrize("initial", INITIALS)
def test_an_empty_set_leaves_the_missed_detection_factor(initial: str) -> None:
    filter, sensor = filter_with(initial=initial), sensor_with()
    state = after_some_looks(filter, 0)
    after = filter.update(state, sensor, POSE, np.zeros((0, 2)), np.random.default_rng(0))
    points, weights = filter.points(state)
    assert np.allclose(
        filter.points(after)[1], weights * (1.0 - sensor.detection(points, POSE)[0]), rtol=1e-12
    )
    assert after.states is state.states


@pytest.mark.parametrize("initial", INITIALS)
def test_where_nothing_can_be_detected_nothing_changes(initial: str) -> None:
    filter = filter_with(initial=initial)
    state = after_some_looks(filter, 0)
    blind = sensor_with(gain=0.0)
    after = filter.update(state, blind, POSE, sensor_with().measure(TARGETS, POSE), np.random.default_rng(0))
    assert np.array_equal(after.weights, state.weights)
    assert np.array_equal(after.undetected.values, state.undetected.values)


@pytest.mark.parametrize("initial", INITIALS)
def test_an_impossible_measurement_without_clutter_changes_nothing(initial: str) -> None:
    filter, sensor = filter_with(initial=initial), sensor_with(clutter=0.0)
    state = after_some_looks(filter, 0)
    z, far = sensor.measure(TARGETS, POSE), np.array([[1e6, 0.3], [-50.0, 0.0]])
    with_it = filter.update(state, sensor, POSE, np.vstack([z, far]), np.random.default_rng(0))
    without = filter.update(state, sensor, POSE, z, np.random.default_rng(0))
    assert np.allclose(with_it.weights, without.weights, rtol=1e-12)
    assert np.isfinite(with_it.weights).all()


@pytest.mark.parametrize("initial", INITIALS)
def test_a_target_on_the_sensor_is_seen_there(initial: str) -> None:
    filter, sensor = filter_with(initial=initial), sensor_with(clutter=0.0)
    rng = np.random.default_rng(0)
    state = filter.init(AREA, rng)
    for _ in range(4):
        state = filter.update(state, sensor, POSE, np.array([[0.0, 1.0]]), rng)
    assert np.isfinite(state.weights).all()
    _, clusters = filter.clusters(state, rng)
    assert np.allclose(clusters.means[:, 0], POSE[:2], atol=2.5)  # 3 standard deviations of the range


def test_a_particle_exactly_on_the_sensor_is_no_trouble() -> None:
    filter, sensor = filter_with(initial="grid", grid_spacing_m=2.0), sensor_with()
    state = filter.init(AREA, np.random.default_rng(0))
    pose = np.append(state.positions[:, 17], [0.0, 0.0])
    after = filter.update(state, sensor, pose, np.array([[0.0, 0.0]]), np.random.default_rng(0))  # bearing 0
    assert np.isfinite(after.weights).all()
    assert after.weights[17] > state.weights[17]


@pytest.mark.parametrize("initial", INITIALS)
def test_a_bearing_of_pi_is_one_of_minus_pi(initial: str) -> None:
    filter, sensor = filter_with(initial=initial), sensor_with()
    state = after_some_looks(filter, 1)
    up, down = (
        filter.update(state, sensor, POSE, np.array([[9.0, b]]), np.random.default_rng(0))
        for b in (np.pi, -np.pi)
    )
    assert np.allclose(up.weights, down.weights, rtol=1e-9, atol=1e-300)


def test_without_particles_and_without_prior_nothing_comes_of_a_measurement() -> None:
    filter, sensor, rng = filter_with(expected_targets=0.0), sensor_with(), np.random.default_rng(0)
    state = filter.init(AREA, rng)
    for z in (np.zeros((0, 2)), sensor.measure(TARGETS, POSE)):
        state = filter.update(filter.predict(state, 1.0, rng), sensor, POSE, z, rng)
    state, clusters = filter.clusters(state, rng)
    assert filter.mass(state) == 0.0
    assert clusters.masses.size == 0
    assert filter.resampled(state, rng).weights.size == 0
    assert filter.remove(state, np.zeros(0, np.int64)).weights.size == 0
    assert filter.thinned(state, 10)[1].size == 0


@pytest.mark.parametrize("initial", INITIALS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_never_gets_into_the_state(initial: str, value: float) -> None:
    filter, sensor, rng = filter_with(initial=initial), sensor_with(), np.random.default_rng(0)
    state = filter.init(AREA, rng)
    with pytest.raises(ValueError, match="measurements"):
        filter.update(state, sensor, POSE, np.array([[5.0, value]]), rng)
    with pytest.raises(ValueError, match="pose"):
        filter.update(state, sensor, np.array([value, 0.0, 0.0, 0.0]), np.zeros((0, 2)), rng)
    with pytest.raises(ValueError, match="duration"):
        filter.predict(state, value, rng)


def test_a_set_cut_into_blocks_is_the_set(monkeypatch: pytest.MonkeyPatch) -> None:
    filter, sensor = filter_with(initial="grid"), sensor_with()
    state, rng = after_some_looks(filter, 0), np.random.default_rng(0)
    z = np.vstack([sensor.sample(TARGETS, POSE, rng) for _ in range(30)])
    whole = filter.update(state, sensor, POSE, z, rng)
    monkeypatch.setattr("estimator.smc.correction._PAIRS", 0)
    assert np.allclose(filter.update(state, sensor, POSE, z, rng).weights, whole.weights, rtol=1e-9)


@pytest.mark.parametrize("initial", INITIALS)
def test_many_measurements_are_worked_off_in_little_memory(initial: str) -> None:
    """All pairs at once would take 4 GB here; docs/smc_phd.md says how long a million of them take."""
    filter, sensor = filter_with(initial=initial, particles=400), sensor_with()
    rng = np.random.default_rng(0)
    state = after_some_looks(filter, 0)
    z = np.column_stack([rng.uniform(0, 85, 25_000), rng.uniform(-np.pi, np.pi, 25_000)])
    tracemalloc.start()
    after = filter.update(state, sensor, POSE, z, rng)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert np.isfinite(after.weights).all()
    assert most < 100e6
