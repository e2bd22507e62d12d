"""The offset between two clocks, held to the clocks that made the readings."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.process.clock_offset import ClockOffset, Exchange

SECONDS = st.floats(-1e4, 1e4)
DELAYS = st.floats(0.0, 5.0)


def exchange(at: float, offset: float, there: float, held: float, back: float, rate: float = 0.0) -> Exchange:
    """What two clocks show; the other one's is `offset` + `rate` times true time ahead of the asker's."""

    def other(true: float) -> float:
        return true + offset + rate * true

    return Exchange(at, other(at + there), other(at + there + held), at + there + held + back)


def middle(estimate: ClockOffset, now: float) -> float:
    bounds = estimate.bounds(now)
    assert bounds is not None
    return 0.5 * (bounds[0] + bounds[1])


@given(offset=SECONDS, ways=st.lists(st.tuples(DELAYS, DELAYS, DELAYS), min_size=1, max_size=40))
@settings(max_examples=200, deadline=None)
def test_offset_is_within_half_the_best_round_trip_however_uneven_the_ways(
    offset: float, ways: list[tuple[float, float, float]]
) -> None:
    estimate = ClockOffset(drift=0.0)
    for i, (there, held, back) in enumerate(ways):
        assert estimate.add(exchange(20.0 * i, offset, there, held, back))
    best = min(there + back for there, _, back in ways)
    now = 20.0 * len(ways)
    bounds = estimate.bounds(now)
    assert bounds is not None
    assert bounds[0] - 1e-8 <= offset <= bounds[1] + 1e-8
    assert abs(middle(estimate, now) - offset) <= 0.5 * best + 1e-8


@given(
    offset=SECONDS,
    rate=st.floats(-1e-4, 1e-4),
    ways=st.lists(st.tuples(DELAYS, DELAYS, DELAYS), min_size=1, max_size=100),
)
@settings(max_examples=200, deadline=None)
def test_a_drifting_clock_never_leaves_the_bounds(
    offset: float, rate: float, ways: list[tuple[float, float, float]]
) -> None:
    estimate = ClockOffset(drift=2e-4)
    for i, (there, held, back) in enumerate(ways):
        now = 20.0 * i + there + held + back
        assert estimate.add(exchange(20.0 * i, offset, there, held, back, rate))
        bounds = estimate.bounds(now)
        assert bounds is not None
        assert bounds[0] - 1e-6 <= offset + rate * now <= bounds[1] + 1e-6
    assert estimate.forgotten == 0


@pytest.mark.parametrize("seed", range(5))
def test_jitter_costs_nothing_once_one_exchange_was_quick(seed: int) -> None:
    rng = np.random.default_rng(seed)
    estimate = ClockOffset()
    for i in range(60):
        there, back = 0.002 + rng.exponential(0.05, 2)
        estimate.add(exchange(float(i), 3.0, there, 0.01, back))
    assert abs(middle(estimate, 60.0) - 3.0) < 0.012, f"seed {seed}"  # a single one is off by 50 ms at times


def test_a_clock_that_is_set_is_followed_from_the_next_exchange_on() -> None:
    estimate = ClockOffset()
    for i in range(30):
        estimate.add(exchange(float(i), 0.0, 0.001, 0.0, 0.001))
    estimate.add(exchange(30.0, 2.0, 0.001, 0.0, 0.001))
    assert middle(estimate, 30.1) == pytest.approx(2.0, abs=0.001)
    assert estimate.forgotten == 30


def test_without_answers_the_bounds_widen_by_what_clocks_run_apart() -> None:
    estimate = ClockOffset(drift=1e-4)
    estimate.add(exchange(0.0, 1.0, 0.001, 0.0, 0.001))
    low, high = estimate.bounds(100.0) or (0.0, 0.0)
    assert high - low == pytest.approx(0.002 + 2 * 1e-4 * 100.0, rel=0.01)


@pytest.mark.parametrize(
    "wrong",
    [
        Exchange(1.0, 5.0, 5.0, 0.9),
        Exchange(1.0, 5.0, 4.0, 2.0),
        Exchange(1.0, math.nan, 5.0, 2.0),
        Exchange(1.0, 5.0, math.inf, 2.0),
        Exchange(1.0, 5.0, 9.0, 2.0),
    ],
)
def test_readings_that_cannot_be_are_refused_and_change_nothing(wrong: Exchange) -> None:
    estimate = ClockOffset()
    estimate.add(exchange(0.0, 1.0, 0.1, 0.0, 0.1))
    before = estimate.bounds(3.0)
    assert not estimate.add(wrong)
    assert estimate.bounds(3.0) == before


def test_nothing_is_known_before_the_first_exchange() -> None:
    assert ClockOffset().bounds(0.0) is None
