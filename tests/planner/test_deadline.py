import math

import pytest

from planner.deadline import Deadline, Reserve


class Clock:
    """Stands still until it is told to go on."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_deadline_is_over_when_its_seconds_have_passed() -> None:
    clock = Clock()
    deadline = Deadline(2.0, clock)
    clock.now += 1.5
    assert not deadline.over()
    assert deadline.left() == 0.5
    clock.now += 0.5
    assert deadline.over()
    assert deadline.left() == 0.0
    clock.now += 10.0
    assert deadline.left() == 0.0


def test_an_infinite_deadline_is_never_over_and_a_negative_one_at_once() -> None:
    assert not Deadline(math.inf).over()
    assert Deadline(math.inf).left() == math.inf
    assert Deadline(-1.0).over()
    assert Deadline(0.0).over()


def test_a_deadline_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="seconds"):
        Deadline(math.nan)


def test_one_that_is_over_sooner_begins_at_the_same_time() -> None:
    clock = Clock()
    deadline = Deadline(2.0, clock)
    clock.now += 0.5
    sooner = deadline.less(1.0)
    assert (sooner.left(), deadline.left()) == (0.5, 1.5)
    assert sooner.passed() == deadline.passed() == 0.5
    clock.now += 0.5
    assert sooner.over()
    assert not deadline.over()
    assert not Deadline(math.inf, clock).less(1.0).over()


def test_a_step_is_begun_only_if_what_it_took_before_is_left() -> None:
    clock = Clock()
    reserve = Reserve(1.0)
    assert reserve.fits(Deadline(1.5, clock))
    assert not reserve.fits(Deadline(0.9, clock))
    deadline = Deadline(math.inf, clock)
    for took in (3.0, 2.0):
        with reserve.measured(deadline):
            clock.now += took
    assert reserve.seconds == pytest.approx(1.2 * 0.7 * 3.0)
    assert not reserve.fits(Deadline(2.3, clock))
    assert reserve.fits(Deadline(2.6, clock))


def test_a_slow_first_time_is_forgotten_soon_but_not_what_a_step_always_takes() -> None:
    clock = Clock()
    reserve = Reserve(1.0)
    for took in (300.0, 2.0):
        with reserve.measured(Deadline(math.inf, clock)):
            clock.now += took
    assert not reserve.fits(Deadline(8.0, clock))
    assert reserve.fits(Deadline(8.0, clock))
    for _ in range(20):  # it takes 2 s: with half of that it is refused for long
        assert not reserve.fits(Deadline(1.0, clock))
    refused = 0
    while not reserve.fits(Deadline(1.0, clock)):  # but not for ever
        refused += 1
    assert refused < 100


def test_a_step_that_looks_at_the_clock_is_begun_with_a_quarter_of_the_whole_time() -> None:
    clock = Clock()
    reserve = Reserve(5.0, yields=True)
    deadline = Deadline(4.0, clock)
    assert reserve.kept(deadline) == 1.0
    assert reserve.kept(Deadline(math.inf, clock)) == 5.0
    clock.now += 2.9
    assert reserve.fits(deadline)
    clock.now += 0.2
    assert not reserve.fits(deadline)


def test_a_step_that_fails_is_measured_too() -> None:
    clock = Clock()
    reserve = Reserve(0.1)

    def step() -> None:
        with reserve.measured(Deadline(math.inf, clock)):
            clock.now += 1.0
            raise RuntimeError

    with pytest.raises(RuntimeError):
        step()
    assert reserve.seconds == pytest.approx(1.2)


def test_of_a_step_that_asks_for_the_time_only_the_longest_while_without_asking_counts() -> None:
    clock = Clock()
    reserve = Reserve(0.1)
    deadline = Deadline(5.0, clock)
    with reserve.watched(deadline) as over:
        for took in (1.0, 2.0, 1.5):
            clock.now += took
            assert not over()
        clock.now += 1.0
        assert over()
        clock.now += 0.25
    assert reserve.seconds == pytest.approx(1.2 * 2.0)


def test_what_had_no_turn_is_refused_with_less_and_less_until_it_has_one() -> None:
    reserve = Reserve(1.0)
    reserve.refused()
    assert reserve.seconds == pytest.approx(0.97)
    for _ in range(200):
        reserve.refused()
    assert reserve.fits(Deadline(0.01, Clock()))
