"""Targets move as the textbook says."""

import numpy as np
import pytest

from estimator.motion import Motion, MotionConfig


def test_two_short_steps_make_one_long_step() -> None:
    for kind in ("static", "random_walk", "constant_velocity"):
        motion = Motion(2, MotionConfig(kind=kind, drift=0.3, acceleration=0.4))  # type: ignore[arg-type]
        f1, q1 = motion.transition(0.7)
        f2, q2 = motion.transition(1.6)
        f, q = motion.transition(2.3)
        np.testing.assert_allclose(f2 @ f1, f, atol=1e-12)
        np.testing.assert_allclose(f2 @ q1 @ f2.T + q2, q, atol=1e-12)


@pytest.mark.parametrize("kind", ["random_walk", "constant_velocity"])
def test_moved_states_scatter_as_the_covariance_says(kind: str) -> None:
    motion = Motion(3, MotionConfig(kind=kind, drift=0.5, acceleration=0.5))  # type: ignore[arg-type]
    start = np.arange(motion.state_size, dtype=float)[:, None] * np.ones((1, 40_000))
    end = motion.moved(start, 2.0, np.random.default_rng(1))
    f, q = motion.transition(2.0)
    np.testing.assert_allclose(end.mean(axis=1), f @ start[:, 0], atol=0.05)
    np.testing.assert_allclose(np.cov(end), q, atol=0.05)


def test_what_stands_draws_nothing_and_stays() -> None:
    rng = np.random.default_rng(3)
    before = rng.bit_generator.state
    states = np.ones((2, 5))
    assert Motion(2, MotionConfig()).moved(states, 10.0, rng) is states
    assert rng.bit_generator.state == before


def test_a_new_target_has_the_mission_s_speed() -> None:
    motion = Motion(2, MotionConfig(kind="constant_velocity", speed=3.0))
    covariance = motion.start_covariance(np.array([[2.0, 1.0], [1.0, 2.0]]))
    np.testing.assert_array_equal(covariance[:2, :2], [[2.0, 1.0], [1.0, 2.0]])
    np.testing.assert_array_equal(covariance[2:, 2:], 9.0 * np.eye(2))
    assert not covariance[:2, 2:].any()


@pytest.mark.parametrize("duration", [-1.0, np.nan, np.inf])
def test_time_that_cannot_be_is_refused(duration: float) -> None:
    with pytest.raises(ValueError, match="duration"):
        Motion(2, MotionConfig()).transition(duration)
