"""The particle PHD filter as the fusion uses it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.correction import corrected
from estimator.smc.smc_phd import SmcPhd, SmcPhdState

AREA = Area(np.zeros(2), np.full(2, 100.0))
POSE = np.array([50.0, 50.0, 5.0, 0.3])
TARGETS = np.array([[30.0, 62.0, 75.0], [40.0, 71.0, 20.0]])


def sensor(**changes: Any) -> RangeBearing:
    config = {
        "period_s": 1.0,
        "range_sigma_m": 0.5,
        "bearing_sigma_deg": 1.0,
        "reach_m": [20.0, 20.0],
        "gain": 0.9,
    }
    return RangeBearing.of(RangeBearing.Config(**{**config, **changes}), AREA)


def particles(filter: SmcPhd, n: int = 3000, mass: float = 3.0, seed: int = 0) -> SmcPhdState:
    """A state with clouds about TARGETS."""
    rng = np.random.default_rng(seed)
    state = filter.init(AREA, rng)
    x = TARGETS[:, rng.integers(0, 3, n)] + rng.standard_normal((2, n))
    return replace(state, states=x, weights=np.full(n, mass / n), labels=np.full(n, -1))


def test_the_prior_expects_the_missions_number_of_targets() -> None:
    filter = SmcPhd(SmcPhd.Config(expected_targets=4.0))
    assert filter.mass(filter.init(AREA, np.random.default_rng(0))) == pytest.approx(4.0)


def test_particles_follow_equation_13_where_the_undetected_part_is_nothing() -> None:
    filter, model = SmcPhd(SmcPhd.Config(expected_targets=0.0)), sensor(clutter=2.0)
    state, z = particles(filter), model.measure(TARGETS, POSE)
    after = filter.update(state, model, POSE, z, np.random.default_rng(1))
    expected = corrected(state.weights, model.look(state.positions, POSE, z))
    assert np.allclose(after.weights, expected, rtol=1e-12)
    assert np.array_equal(after.positions, state.positions)


@pytest.mark.parametrize("clutter", [0.0, 2.0])
def test_mass_balances_with_particles_and_undetected_part_together(clutter: float) -> None:
    filter, model = SmcPhd(SmcPhd.Config(expected_targets=5.0)), sensor(clutter=clutter)
    state = particles(filter)
    fresh = np.array([[80.0], [80.0]])  # nobody has seen this one
    z = model.measure(np.concatenate([TARGETS, fresh], axis=1), POSE)
    after = filter.update(state, model, POSE, z, np.random.default_rng(1))
    look = model.look(state.positions, POSE, z)
    missed = np.sum(state.weights * (1 - look.detection)) + state.undetected.after(model, POSE).mass()
    if clutter == 0.0:
        assert filter.mass(after) == pytest.approx(missed + 4.0, rel=1e-9)
    else:
        assert missed < filter.mass(after) < missed + 4.0


def test_a_first_detection_puts_one_target_where_it_points() -> None:
    filter, model = SmcPhd(SmcPhd.Config(expected_targets=1.0)), sensor()
    rng = np.random.default_rng(1)
    state = filter.update(filter.init(AREA, rng), model, POSE, model.measure(TARGETS[:, :1], POSE), rng)
    assert state.weights.sum() == pytest.approx(1.0)
    assert np.allclose(np.average(state.positions, axis=1, weights=state.weights), TARGETS[:, 0], atol=0.2)
    _, clusters = filter.clusters(state, rng)
    assert clusters.masses.size == 1


def test_clutter_makes_a_first_detection_uncertain() -> None:
    filter, model, rng = (
        SmcPhd(SmcPhd.Config(expected_targets=1.0)),
        sensor(clutter=5.0),
        np.random.default_rng(1),
    )
    state = filter.update(filter.init(AREA, rng), model, POSE, model.measure(TARGETS[:, :1], POSE), rng)
    assert 0.001 < state.weights.sum() < 0.7


def test_an_empty_set_is_the_missed_detection_factor() -> None:
    filter, model = SmcPhd(SmcPhd.Config()), sensor()
    state = particles(filter)
    after = filter.update(state, model, POSE, np.zeros((0, 2)), np.random.default_rng(1))
    seen = model.detection(state.positions, POSE[None])[0]
    assert np.allclose(after.weights, state.weights * (1 - seen), rtol=1e-12)
    assert after.undetected.mass() < state.undetected.mass()


def test_where_nothing_can_be_detected_nothing_changes() -> None:
    filter, model = SmcPhd(SmcPhd.Config()), sensor(gain=0.0)
    state = particles(filter)
    after = filter.update(state, model, POSE, np.array([[20.0, 1.0]]), np.random.default_rng(1))
    assert np.array_equal(after.weights, state.weights)
    assert np.array_equal(after.undetected.values, state.undetected.values)


def test_a_set_that_the_model_holds_impossible_leaves_no_nan() -> None:
    filter, model = SmcPhd(SmcPhd.Config(expected_targets=0.0)), sensor()
    rng = np.random.default_rng(0)
    state = filter.update(filter.init(AREA, rng), model, POSE, np.array([[20.0, 1.0]]), rng)
    assert filter.mass(state) == 0.0
    state = filter.update(particles(filter), model, POSE, np.array([[500.0, 1.0]]), rng)
    assert np.isfinite(state.weights).all()


def test_the_order_of_measurements_does_not_matter() -> None:
    filter, model = SmcPhd(SmcPhd.Config(expected_targets=0.0)), sensor(clutter=1.0)
    state, z = particles(filter), model.measure(TARGETS, POSE)
    one = filter.update(state, model, POSE, z, np.random.default_rng(1))
    other = filter.update(state, model, POSE, z[::-1], np.random.default_rng(1))
    assert np.allclose(one.weights, other.weights, rtol=1e-12)


def test_turning_and_moving_everything_changes_no_weight() -> None:
    filter, model = SmcPhd(SmcPhd.Config(expected_targets=0.0)), sensor(clutter=1.0, bearing_frame="body")
    state, z = particles(filter), model.measure(TARGETS, POSE)
    turn, shift = 2.2, np.array([[13.0], [-40.0]])
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    moved = replace(state, states=np.ascontiguousarray(rotation @ state.positions + shift))
    pose = np.concatenate([(rotation @ POSE[:2, None] + shift)[:, 0], [POSE[2], POSE[3] + turn]])
    here = filter.update(state, model, POSE, z, np.random.default_rng(1))
    there = filter.update(moved, model, pose, z, np.random.default_rng(1))
    assert np.allclose(here.weights, there.weights, rtol=1e-6)


def test_sensors_in_turn_are_the_iterated_corrector_and_their_order_matters_little() -> None:
    filter = SmcPhd(SmcPhd.Config(expected_targets=0.0, jitter=0.0))
    first, second, rng = sensor(clutter=1.0), sensor(range_sigma_m=2.0, clutter=1.0), np.random.default_rng(1)
    other_pose, state = np.array([20.0, 60.0, 5.0, 0.0]), particles(filter)
    z1, z2 = first.measure(TARGETS, POSE), second.measure(TARGETS[:, :2], other_pose)
    w = corrected(state.weights, first.look(state.positions, POSE, z1))
    w = corrected(w, second.look(state.positions, other_pose, z2))
    no_resampling = SmcPhd(SmcPhd.Config(expected_targets=0.0, particles=10**7))
    one = filter.update(state, first, POSE, z1, rng)
    assert no_resampling.mass(one) > 0.0
    direct = corrected(one.weights, second.look(one.positions, other_pose, z2))
    assert np.allclose(direct, w, rtol=1e-11)
    forth = filter.mass(filter.update(one, second, other_pose, z2, rng))
    back = filter.update(filter.update(state, second, other_pose, z2, rng), first, POSE, z1, rng)
    assert filter.mass(back) == pytest.approx(forth, rel=0.2)


def test_resampling_keeps_mass_mean_and_cardinality_per_cluster() -> None:
    filter, model, rng = SmcPhd(SmcPhd.Config(particles=4000)), sensor(clutter=1.0), np.random.default_rng(2)
    state = filter.update(particles(filter), model, POSE, model.measure(TARGETS, POSE), rng)
    state, before = filter.clusters(state, rng)
    again = filter.resampled(state, rng)
    assert filter.mass(again) == pytest.approx(filter.mass(state), rel=1e-12)
    _, after = filter.clusters(again, rng)
    assert np.allclose(after.masses, before.masses, rtol=0.03)
    assert np.allclose(after.means, before.means, atol=0.15)


def posterior_after_many_looks(jitter: float, seed: int) -> tuple[float, float]:
    """Forty looks at one target: the mean's distance from the exact one in standard deviations squared, and
    the covariance as a multiple of the exact one's (a Kalman filter's; the noise is small, so nearly linear).
    """
    rng, model = np.random.default_rng(seed), sensor(gain=1.0, reach_m=[1e4, 1e4])
    filter = SmcPhd(SmcPhd.Config(particles=4000, jitter=jitter))
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
    return float(off @ information @ off), float(np.trace(clusters.covariances[0] @ information) / 2)


@pytest.mark.parametrize("seed", range(5))
def test_jitter_keeps_static_particles_true_to_the_exact_posterior(seed: int) -> None:
    off, spread = posterior_after_many_looks(SmcPhd.Config().jitter, seed)
    assert off < 0.5
    assert 0.6 < spread < 1.6


def test_without_jitter_static_particles_run_out() -> None:
    assert np.mean([posterior_after_many_looks(0.0, seed)[1] for seed in range(5)]) < 0.6


def test_birth_and_survival_follow_the_duration() -> None:
    filter = SmcPhd(SmcPhd.Config(expected_targets=2.0, birth=0.5, survival=0.9))
    rng = np.random.default_rng(0)
    state = particles(filter)
    assert filter.mass(filter.predict(state, 2.0, rng)) == pytest.approx(0.81 * 5.0 + 1.0)
    assert filter.predict(state, 0.0, rng) is state


@pytest.mark.parametrize("duration", [-1.0, np.nan, np.inf])
def test_time_does_not_go_back(duration: float) -> None:
    filter = SmcPhd(SmcPhd.Config(birth=0.1))
    with pytest.raises(ValueError, match="duration"):
        filter.predict(particles(filter), duration, np.random.default_rng(0))


def test_removing_a_cluster_removes_its_mass_and_no_other() -> None:
    filter, rng = SmcPhd(SmcPhd.Config(cluster_cutoff_m=5.0, expected_targets=0.0)), np.random.default_rng(0)
    state, clusters = filter.clusters(particles(filter), rng)
    assert clusters.masses.size == 3
    after = filter.remove(state, np.array([1]))
    assert filter.mass(after) == pytest.approx(filter.mass(state) - clusters.masses[1], rel=1e-9)
    assert np.linalg.norm(after.positions - clusters.means[:, [1]], axis=0).min() > 5.0


@pytest.mark.parametrize("size", [1, 100, 5000])
def test_thinned_points_carry_the_whole_mass(size: int) -> None:
    filter = SmcPhd(SmcPhd.Config(expected_targets=2.0))
    state = particles(filter)
    points, weights = filter.thinned(state, size)
    assert points.shape[0] == 2
    assert points.shape[1] == weights.size <= size
    assert weights.sum() == pytest.approx(filter.mass(state))


def test_the_same_seed_gives_the_same_bits() -> None:
    filter, model = SmcPhd(SmcPhd.Config()), sensor(clutter=1.0)

    def run() -> FloatArray:
        rng = np.random.default_rng(9)
        state = filter.init(AREA, rng)
        for _ in range(6):
            state = filter.update(state, model, POSE, model.sample(TARGETS, POSE, rng), rng)
            state, _ = filter.clusters(state, rng)
        return state.positions

    assert run().tobytes() == run().tobytes()


def test_updating_leaves_the_old_state_as_it_was() -> None:
    filter, model = SmcPhd(SmcPhd.Config()), sensor()
    state = particles(filter)
    kept = state.positions.copy(), state.weights.copy(), state.undetected.values.copy()
    new, _ = filter.clusters(
        filter.update(state, model, POSE, model.measure(TARGETS, POSE), np.random.default_rng(1)),
        np.random.default_rng(1),
    )
    filter.resampled(new, np.random.default_rng(2))
    assert np.array_equal(state.positions, kept[0])
    assert np.array_equal(state.weights, kept[1])
    assert np.array_equal(state.undetected.values, kept[2])


@pytest.mark.parametrize(
    ("pose", "z", "name"),
    [
        (np.zeros(3), np.zeros((0, 2)), "pose"),
        (np.full(4, np.nan), np.zeros((0, 2)), "pose"),
        (POSE, np.zeros((1, 3)), "measurements"),
        (POSE, np.zeros(2), "measurements"),
        (POSE, np.array([[np.nan, 0.0]]), "measurements"),
    ],
)
def test_bad_input_is_refused_by_name(pose: FloatArray, z: FloatArray, name: str) -> None:
    filter = SmcPhd(SmcPhd.Config())
    with pytest.raises(ValueError, match=name):
        filter.update(particles(filter), sensor(), pose, z, np.random.default_rng(0))


def test_a_grid_that_does_not_fit_the_area_is_refused_by_key() -> None:
    with pytest.raises(ValueError, match="grid_points"):
        SmcPhd(SmcPhd.Config(grid_points=[3, 3, 3])).init(AREA, np.random.default_rng(0))
