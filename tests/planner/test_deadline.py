import math

import pytest

from planner.deadline import Deadline


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
