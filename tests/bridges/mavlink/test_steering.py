"""Where a vehicle is told to steer: pure, in the team's frame and time."""

from typing import Any

import numpy as np
import pytest

from agents.devices import DeviceContext
from bridges.mavlink.kind import MavlinkConfig, MavlinkKind
from bridges.mavlink.steering import AHEAD_S, WAIT_S, Steering
from estimator.filter import Area
from planner.plan import Trajectory

AREA = Area(np.array([0.0, 0.0]), np.array([100.0, 100.0]))
HIGH = np.array([10.0, 10.0, 12.0])


def steering(body: str = "copter", **changes: Any) -> Steering:
    config = MavlinkConfig(url="tcp:127.0.0.1:5760", body=body, **changes)  # type: ignore[arg-type]
    start = np.array([10.0, 10.0, 12.0 if body == "copter" else 0.0, 0.0])
    context = DeviceContext("r1", 0, AREA, None, start)  # type: ignore[arg-type]
    return Steering(MavlinkKind.model(config, AREA), config, context)


def way(one: Steering, x: float, y: float, start: float, begin: np.ndarray = HIGH) -> Trajectory:
    model = one._model
    state = model.initial_state(np.append(begin, 0.0))
    return model.trajectory(state, np.array([x, y, begin[2]]), start, 1.0)


def flying(body: str = "copter", **changes: Any) -> Steering:
    one = steering(body, **changes)
    here = HIGH if body == "copter" else np.array([10.0, 10.0, 0.0])
    one.target(0.0, here)
    one.look("flying", here)
    return one


def test_it_first_climbs_above_where_it_stands() -> None:
    one = steering()
    stands = np.array([11.5, 9.0, 0.2])
    assert one.target(0.0, stands) == pytest.approx([11.5, 9.0, 12.0])
    one.look("climbing", np.array([11.5, 9.0, 12.0]))
    assert not one.up  # the pilot has not said that it flies
    one.look("flying", np.array([11.0, 9.5, 8.0]))
    assert not one.up
    one.look("flying", np.array([11.0, 9.5, 11.6]))
    assert one.up
    assert one.target(1.0, np.array([11.0, 9.5, 11.6])) == pytest.approx([11.5, 9.0, 12.0])


def test_a_copter_is_led_along_its_way_and_a_rover_is_given_the_waypoint() -> None:
    one = flying()
    leg = way(one, 60.0, 10.0, 5.0)
    one.follow(leg, 4.9, HIGH)
    for now in (5.0, 8.0, 11.0):
        ahead = [np.interp(now + AHEAD_S, leg.times, leg.poses[:, axis]) for axis in range(3)]
        here = np.array([np.interp(now, leg.times, leg.poses[:, axis]) for axis in range(3)])
        assert one.target(now, here) == pytest.approx(ahead)
    assert one.target(leg.end_time, np.array([57.0, 10.0, 12.0])) == pytest.approx([60.0, 10.0, 12.0])
    rover = flying("rover", speed_m_s=1.5)
    ground = np.array([10.0, 10.0, 0.0])
    rover.follow(way(rover, 30.0, 20.0, 5.0, ground), 5.0, ground)
    assert rover.target(5.0, ground) == pytest.approx([30.0, 20.0, 0.0])


def test_one_that_is_late_is_not_sent_so_far_ahead_that_it_would_race() -> None:
    one = flying(speed_m_s=4.0)
    one.follow(way(one, 90.0, 10.0, 0.0), 0.0, HIGH)
    target = one.target(15.0, HIGH)  # it has not moved at all
    assert target is not None
    assert np.linalg.norm(target - HIGH) == pytest.approx(1.0 + 1.3 * 4.0)


def test_the_next_way_begins_when_the_waypoint_was_reached_or_after_a_while() -> None:
    one = flying()
    first = way(one, 30.0, 10.0, 0.0)
    second = way(one, 30.0, 40.0, first.end_time, np.array([30.0, 10.0, 12.0]))
    end = first.end_time
    one.follow(first, 0.0, HIGH)
    one.follow(second, end - 0.2, HIGH)
    late, there = np.array([28.0, 10.0, 12.0]), np.array([29.6, 10.0, 12.0])
    assert one.target(end + 0.3, late) == pytest.approx([30.0, 10.0, 12.0])
    one.look("flying", there)
    turned = one.target(end + 0.5, there)
    assert turned is not None
    assert turned[1] > 10.0
    assert one.gauges()["mavlink.waypoint_worst_m"] == pytest.approx(0.4)
    assert one.counters() == {"mavlink.waypoints": 1}
    other = flying()
    other.follow(first, 0.0, HIGH)
    other.follow(second, end - 0.2, HIGH)
    gone_on = other.target(end + WAIT_S, late)
    assert gone_on is not None
    assert gone_on[1] > 10.0


def test_turned_aside_it_steers_there_and_back_on_its_way_afterwards() -> None:
    one = flying()
    leg = way(one, 60.0, 10.0, 0.0)
    one.follow(leg, 0.0, HIGH)
    one.aside = np.array([20.0, 30.0, 12.0])
    assert one.target(3.0, HIGH) == pytest.approx([20.0, 30.0, 12.0])
    one.aside = None
    back = one.target(3.0, HIGH)
    assert back is not None
    assert back[1] == pytest.approx(10.0)


def test_told_to_hold_it_holds_where_it_is_at_its_own_altitude() -> None:
    one = flying()
    one.follow(way(one, 60.0, 10.0, 0.0), 0.0, HIGH)
    one.follow(None, 3.0, np.array([20.0, 10.0, 11.7]))
    assert one.target(4.0, np.array([22.0, 10.0, 11.6])) == pytest.approx([20.0, 10.0, 12.0])
    assert one.arrived(np.array([22.0, 10.0, 11.6]))


def test_what_an_altimeter_is_off_does_not_add_up_from_plan_to_plan() -> None:
    one = flying()
    state = one.model_state(np.array([20.0, 30.0, 11.4, 0.3]), np.array([1.0, 2.0, -0.2]))
    assert state == pytest.approx([20.0, 30.0, 12.0, 0.3, 1.0, 2.0, 0.0])
    rover = flying("rover")
    driven = rover.model_state(np.array([20.0, 30.0, 0.7, 0.3]), np.array([0.3, 0.4, 0.0]))
    assert driven == pytest.approx([20.0, 30.0, 0.0, 0.3, 0.5, 0.0])


def test_given_back_it_begins_where_it_then_is() -> None:
    one = flying()
    one.follow(way(one, 60.0, 10.0, 0.0), 0.0, HIGH)
    one.begin()
    assert not one.up
    assert one.target(9.0, np.array([40.0, 41.0, 3.0])) == pytest.approx([40.0, 41.0, 12.0])


def test_far_from_where_it_should_be_its_way_is_reckoned_anew_from_time_to_time() -> None:
    one = flying(speed_m_s=4.0)
    leg = way(one, 90.0, 10.0, 0.0)
    one.follow(leg, 0.0, HIGH)
    planned = np.array([np.interp(8.0, leg.times, leg.poses[:, axis]) for axis in range(3)])
    assert not one.astray(8.0, planned - [8.9, 0.0, 0.0])
    assert one.astray(8.0, planned - [9.1, 0.0, 0.0])
    assert not one.astray(9.0, HIGH)  # that was just done
    assert one.astray(10.1, HIGH)
    one.aside = np.array([20.0, 30.0, 12.0])
    assert not one.astray(13.0, HIGH)  # others are kept apart from, which has its own ways


def test_a_way_that_replaces_another_in_its_midst_begins_at_once() -> None:
    one = flying()
    one.follow(way(one, 60.0, 10.0, 0.0), 0.0, HIGH)
    here = np.array([20.0, 10.0, 12.0])
    one.follow(way(one, 20.0, 60.0, 4.0, here), 3.8, here)
    before, after = one.target(3.9, here), one.target(4.0, here)
    assert before is not None
    assert after is not None
    assert before[1] == pytest.approx(10.0)
    assert after[1] > 11.0
    assert one.counters() == {"mavlink.waypoints": 0}
