import numpy as np
import pytest

from planner.commitments import looks, position_at, usable
from planner.plan import Commitment


def commitment(measure_times=(10.0, 11.0, 12.0), end=12.4, period=1.0):
    count = len(measure_times)
    return Commitment(
        robot="b",
        version=1,
        measure_times=np.array(measure_times, dtype=float),
        measure_poses=np.arange(4.0 * count).reshape(count, 4),
        times=np.array([10.0, end]),
        poses=np.array([[0.0, 0.0, 0.0, 0.0], [24.0, 0.0, 0.0, 0.0]]),
        measure_period=period,
    )


def test_tail_begins_with_the_plan_and_standing_begins_on_arrival():
    other = looks(commitment(), 10.5)
    assert other.times.tolist() == [11.0, 12.0]
    assert other.poses[0, 0] == 4.0
    assert other.stand_time == 12.4
    assert other.stand_pose[0] == 24.0


def test_robot_that_has_stood_long_keeps_its_beat():
    other = looks(commitment(), 20.0)
    assert other.times.size == 0
    assert other.stand_time == pytest.approx(20.4)


def test_measurement_on_arrival_is_not_counted_twice():
    assert looks(commitment(end=12.0), 10.0).stand_time == pytest.approx(13.0)


@pytest.mark.parametrize("period", [0.0, -1.0, np.inf, np.nan])
def test_without_a_period_nobody_measures_standing(period):
    assert looks(commitment(period=period), 10.0).stand_time == np.inf


def test_position_is_between_samples_and_stays_at_the_end():
    assert position_at(commitment(), 11.2)[0] == pytest.approx(12.0)
    assert position_at(commitment(), 99.0)[0] == 24.0
    assert position_at(commitment(), 0.0)[0] == 0.0


def test_damaged_commitment_is_not_usable():
    assert usable(commitment())
    assert not usable(commitment(measure_times=(10.0, np.nan)))
    nothing = np.zeros(0)
    assert not usable(Commitment("b", 1, nothing, np.zeros((0, 4)), nothing, np.zeros((0, 4)), 1.0))
