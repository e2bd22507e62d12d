"""Moving targets: against the Kalman filter, against Stone Soup, and what motion must keep."""

from dataclasses import replace
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.motion import Motion, MotionConfig
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.smc_phd import SmcPhd
from estimator.smc.state import turned_back
from tests.estimator.smc.positions import Positions

AREA = Area(np.full(2, -500.0), np.full(2, 500.0))
POSE = np.zeros(4)
WALK = MotionConfig(kind="random_walk", drift=0.8)
CRUISE = MotionConfig(kind="constant_velocity", acceleration=0.3, speed=2.0)


def kalman(
    config: MotionConfig, sets: list[FloatArray], duration: float, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of one target's state after measurements z = position + noise, flat prior."""
    motion = Motion(2, config)
    mean = np.zeros(motion.state_size)
    mean[:2] = sets[0][0]
    covariance = motion.start_covariance(noise)
    h = np.eye(2, motion.state_size)
    f, q = motion.transition(duration)
    for z in sets[1:]:
        mean, covariance = f @ mean, f @ covariance @ f.T + q
        gain = covariance @ h.T @ np.linalg.inv(h @ covariance @ h.T + noise)
        mean, covariance = mean + gain @ (z[0] - h @ mean), covariance - gain @ h @ covariance
    return mean, covariance


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("config", [WALK, CRUISE])
def test_one_target_without_clutter_is_the_kalman_filter(config: MotionConfig, seed: int) -> None:
    rng, sensor = np.random.default_rng(seed), Positions()
    motion, duration = Motion(2, config), 0.5
    target = np.array([[3.0], [-4.0], [1.0], [2.0]])[: motion.state_size]
    filter = SmcPhd(SmcPhd.Config(particles=100_000, expected_targets=1.0, motion=config))
    state, sets = filter.init(AREA, rng), []
    for _ in range(25):
        state = filter.predict(state, duration, rng)
        target = motion.moved(target, duration, rng)
        sets.append(sensor.sample(target[:2], POSE, rng))
        state = filter.update(state, sensor, POSE, sets[-1], rng)
        state, _ = filter.clusters(state, rng)
    assert filter.mass(state) == pytest.approx(1.0)
    mean, covariance = kalman(config, sets, duration, sensor.noise)
    off = np.average(state.states, axis=1, weights=state.weights) - mean
    spread = np.cov(state.states, aweights=state.weights)
    assert off @ np.linalg.solve(covariance, off) < 0.05
    assert np.allclose(np.linalg.eigvals(np.linalg.solve(covariance, spread)), 1.0, atol=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_five_steps_agree_with_stone_soups_smc_phd_on_identical_moving_input(seed: int) -> None:
    """Without noise in the motion nothing is random: particle by particle, weight by weight."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
    from stonesoup.predictor.particle import SMCPHDPredictor
    from stonesoup.types.array import StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.multihypothesis import MultipleHypothesis
    from stonesoup.types.state import ParticleState
    from stonesoup.updater.particle import SMCPHDUpdater

    class Noiseless(LinearGaussian):  # type: ignore[misc]
        """Stone Soup 1.9's updater asks the likelihood for predictions with random noise on top; not here."""

        def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
            return super().function(state, noise=False, **kwargs)

    rng, sensor = np.random.default_rng(seed), Positions(p_d=0.8, clutter=0.05)
    survival, duration, n = 0.9, 2.0, 500
    config = MotionConfig(kind="constant_velocity", acceleration=0.0)
    filter = SmcPhd(SmcPhd.Config(expected_targets=0.0, survival=survival, resample_below=0.0, motion=config))
    start = np.concatenate([rng.uniform(-8, 8, (2, n)), rng.normal(0, 1.0, (2, n))])
    weights = rng.random(n) / 100
    state = replace(filter.init(AREA, rng), states=start, weights=weights, labels=np.full(n, -1))
    when = datetime(2024, 1, 1)
    order = [0, 2, 1, 3]  # theirs: x, vx, y, vy
    theirs = ParticleState(StateVectors(start[order]), log_weight=np.log(weights), timestamp=when)
    predictor = SMCPHDPredictor(
        transition_model=CombinedLinearGaussianTransitionModel(
            [ConstantVelocity(0.0), ConstantVelocity(0.0)]
        ),
        death_probability=-np.log(survival),
        birth_probability=0.0,
        birth_rate=0.0,
        birth_sampler=None,
        birth_scheme="mixture",
    )
    model = Noiseless(ndim_state=4, mapping=(0, 2), noise_covar=sensor.noise)
    updater = SMCPHDUpdater(
        measurement_model=model, resampler=None, prob_detect=sensor.p_d, clutter_intensity=sensor.clutter
    )
    for _ in range(5):
        z = rng.uniform(-8, 8, (4, 2))
        state = filter.update(filter.predict(state, duration, rng), sensor, POSE, z, rng)
        when += timedelta(seconds=duration)
        prediction = predictor.predict(theirs, timestamp=when)
        hypotheses = [
            SingleHypothesis(prediction, Detection(row[:, None], timestamp=when, measurement_model=model))
            for row in z
        ]
        multiple = MultipleHypothesis([*hypotheses, SingleHypothesis(prediction, None)])
        # Its `update` forgets the new weights where there is no resampler, so we put them in.
        per_hypothesis = np.asarray(updater.get_log_weights_per_hypothesis(multiple), dtype=float)
        posterior = np.log(np.exp(per_hypothesis).sum(axis=1))
        theirs = ParticleState(prediction.state_vector, log_weight=posterior, timestamp=when)
        assert np.allclose(state.states[order], np.asarray(theirs.state_vector, dtype=float))
        assert np.allclose(state.weights, np.exp(np.asarray(theirs.log_weight, dtype=float)), rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_three_moving_targets_are_followed_through_clutter(seed: int) -> None:
    area, rng = Area(np.zeros(2), np.full(2, 100.0)), np.random.default_rng(seed)
    sensor = RangeBearing.of(
        RangeBearing.Config(
            period_s=1.0,
            range_sigma_m=0.5,
            bearing_sigma_deg=1.0,
            gain=0.95,
            clutter=3.0,
            field_of_view="sector",
            range_m=200.0,
            angle_deg=360.0,
        ),
        area,
    )
    config = MotionConfig(kind="constant_velocity", acceleration=0.2, speed=1.5)
    filter = SmcPhd(SmcPhd.Config(expected_targets=3.0, motion=config))
    motion, state = Motion(2, config), filter.init(area, rng)
    targets = np.array([[20.0, 50.0, 80.0], [30.0, 70.0, 40.0], [1.5, -1.0, -1.0], [1.0, -1.5, 1.0]])
    masses, near = [], []
    for _ in range(40):
        targets = motion.moved(targets, 0.5, rng)
        state = filter.predict(state, 0.5, rng)
        state = filter.update(state, sensor, POSE, sensor.sample(targets[:2], POSE, rng), rng)
        state, clusters = filter.clusters(state, rng)
        apart = np.linalg.norm(clusters.means[:, :, None] - targets[:2, None, :], axis=0)
        near.append(apart.min(axis=0, initial=np.inf) < 2.5)
        masses.append(filter.mass(state))
    assert np.mean(near[20:]) > 0.9  # a PHD filter lets go of a target that is missed
    assert np.mean(masses[20:]) == pytest.approx(3.0, abs=0.4)


@pytest.mark.parametrize("config", [WALK, CRUISE])
def test_motion_keeps_mass_and_stays_in_the_area(config: MotionConfig) -> None:
    area, rng = Area(np.zeros(2), np.array([10.0, 6.0])), np.random.default_rng(0)
    filter = SmcPhd(SmcPhd.Config(expected_targets=2.0, motion=config))
    state = filter.init(area, rng)
    state = filter.update(state, Positions(), POSE, np.array([[5.0, 3.0], [9.0, 1.0]]), rng)
    for _ in range(10):
        later = filter.predict(state, 2.0, rng)
        assert filter.mass(later) == pytest.approx(filter.mass(state), rel=1e-12)
        assert ((later.positions >= 0.0) & (later.positions <= area.high[:, None])).all()
        assert np.isfinite(later.states).all()
        state = later


def test_a_target_that_reaches_the_border_turns_back() -> None:
    area = Area(np.zeros(2), np.array([10.0, 6.0]))
    states = np.array(
        [[12.0, -1.0, 25.0, 5.0], [3.0, 7.0, -1.0, 2.0], [1.0, -2.0, 3.0, 1.0], [0.5, 1.0, -1.0, 1.0]]
    )
    turned = turned_back(states.copy(), area)
    assert np.allclose(turned[:2], [[8.0, 1.0, 5.0, 5.0], [3.0, 5.0, 1.0, 2.0]])
    assert np.allclose(turned[2:], [[-1.0, 2.0, 3.0, 1.0], [0.5, -1.0, 1.0, 1.0]])


def test_clusters_centres_move_with_their_particles() -> None:
    rng = np.random.default_rng(0)
    filter = SmcPhd(SmcPhd.Config(motion=MotionConfig(kind="constant_velocity", acceleration=0.1)))
    state = filter.update(filter.init(AREA, rng), Positions(), POSE, np.array([[5.0, 3.0]]), rng)
    state, _ = filter.clusters(state, rng)
    state = replace(state, states=np.concatenate([state.positions, np.full_like(state.positions, 4.0)]))
    later = filter.predict(state, 2.0, rng)
    assert np.allclose(later.centres, state.centres + 8.0, atol=0.1)


def test_static_targets_stand_and_draw_nothing() -> None:
    rng = np.random.default_rng(0)
    filter = SmcPhd(SmcPhd.Config(birth=0.1, survival=0.9))
    state = filter.update(filter.init(AREA, rng), Positions(), POSE, np.array([[5.0, 3.0]]), rng)
    before = rng.bit_generator.state
    later = filter.predict(state, 3.0, rng)
    assert later.states is state.states
    assert rng.bit_generator.state == before
