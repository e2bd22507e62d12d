"""Robots that see each other."""

import numpy as np
import pytest

from estimator.filter import Area
from estimator.search import Search
from estimator.sensors.known import WithKnown
from estimator.sensors.range_bearing import RangeBearing
from estimator.sensors.teammates import Teammates
from estimator.smc.smc_phd import SmcPhd

AREA = Area(np.zeros(2), np.full(2, 10.0))
SENSOR = RangeBearing.of(
    RangeBearing.Config(
        period_s=0.2,
        range_sigma_m=0.05,
        bearing_sigma_deg=1.0,
        clutter=0.01,
        gain=0.5,
        field_of_view="sector",
        range_m=8.0,
        angle_deg=90.0,
    ),
    AREA,
)
POSES = {"a": np.array([1.0, 1.0, 0.0, 0.8]), "b": np.array([4.0, 4.0, 0.0, 0.0])}


def found_after(teammates: Teammates | None, sets: int = 60) -> int:
    """Found targets after robot a saw nothing but the standing robot b in half of its sets."""
    search = Search(
        SmcPhd(SmcPhd.Config(particles=2000)),
        AREA,
        [5, 5],
        radius=0.05,
        mass=0.8,
        gate=0.2,
        teammates=teammates,
    )
    rng = np.random.default_rng(0)
    state = search.init(rng)
    for i in range(sets):
        z = SENSOR.measure(POSES["b"][:2, None], POSES["a"]) + rng.standard_normal((1, 2)) * SENSOR.sigmas
        state = search.apply(state, SENSOR, POSES["a"], z[: rng.integers(0, 2)], 0.2 * i, rng, "a")
    return state.found.shape[1]


def test_a_standing_teammate_is_a_found_target_unless_it_is_expected() -> None:
    assert found_after(None) >= 1
    assert found_after(Teammates(POSES, spread=0.1, rate=4.0)) == 0


def test_a_robot_does_not_expect_to_see_itself() -> None:
    expecting = Teammates(POSES, spread=0.1, rate=4.0).expected_by("a", SENSOR, POSES)
    assert isinstance(expecting, WithKnown)
    assert expecting.positions.T.tolist() == [[4.0, 4.0]]


def test_without_others_or_rate_the_sensor_stays_as_it_is() -> None:
    assert Teammates(POSES, 0.1, 4.0).expected_by("a", SENSOR, {"a": POSES["a"]}) is SENSOR
    assert Teammates(POSES, 0.1, 0.0).expected_by("a", SENSOR, POSES) is SENSOR


@pytest.mark.parametrize("late", [False, True])
def test_teammates_are_expected_at_the_pose_of_their_newest_set(late: bool) -> None:
    search = Search(
        SmcPhd(SmcPhd.Config()),
        AREA,
        [5, 5],
        radius=0.1,
        mass=0.8,
        gate=0.2,
        teammates=Teammates(POSES, 0.1, 4.0),
    )
    rng = np.random.default_rng(0)
    state = search.init(rng)
    moves = [(1.0, np.array([5.0, 5.0, 0.0, 0.0])), (2.0, np.array([6.0, 6.0, 0.0, 0.0]))]
    for time, pose in moves[::-1] if late else moves:
        state = search.apply(state, SENSOR, pose, np.zeros((0, 2)), time, rng, "b")
    assert state.poses["b"].tolist() == [6.0, 6.0, 0.0, 0.0]
    assert state.poses["a"].tolist() == POSES["a"].tolist()
