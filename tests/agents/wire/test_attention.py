"""Poses passed over: never of anybody who could come near before the next is heard."""

import numpy as np
import pytest

from agents.wire.attention import LONGEST_S, Attention

SPEEDS = {"me": 10.0, "near": 8.0, "far": 8.0}


@pytest.mark.parametrize("seed", range(20))
def test_two_that_race_at_each_other_are_heard_from_long_before_they_meet(seed: int) -> None:
    rng = np.random.default_rng(seed)
    attention = Attention("me", SPEEDS, 5.0)
    start = rng.uniform(100.0, 2000.0)
    for time in np.arange(0.0, (start - 5.0) / 18.0, 0.2):
        gap = start - 18.0 * time
        if attention.wants("near", time):
            attention.heard("near", np.array([gap, 0.0, 0.0, 0.0]), np.zeros(4), time)
        elif gap - 5.0 < 2.0 * 18.0:
            pytest.fail(f"passed over at {gap:.1f} m, seed {seed}")
    assert attention.passed_over > 0


def test_who_is_far_is_heard_often_enough_not_to_count_as_silent() -> None:
    attention = Attention("me", SPEEDS, 5.0)
    heard = []
    for time in np.arange(0.0, 60.0, 0.2):
        if attention.wants("far", time):
            attention.heard("far", np.array([1e4, 0.0, 0.0, 0.0]), np.zeros(4), time)
            heard.append(time)
    assert max(np.diff(heard)) <= LONGEST_S + 0.2 + 1e-9
    assert len(heard) <= 61


def test_who_is_new_or_of_unknown_speed_is_always_heard() -> None:
    attention = Attention("me", SPEEDS, 5.0)
    assert attention.wants("stranger", 0.0)
    attention.heard("stranger", np.array([1e6, 0.0, 0.0]), np.zeros(3), 0.0)
    assert attention.wants("stranger", 0.1)
