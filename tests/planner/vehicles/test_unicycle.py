import math

import numpy as np
import pytest

from planner.vehicles.unicycle import Unicycle


def robot(**changes):
    defaults = {"speed_m_s": 0.5, "turn_rate_deg_s": 90.0, "acceleration_m_s2": 0.5, "tolerance_m": 0.02}
    return Unicycle(Unicycle.Config(**{**defaults, **changes}))


def error(state, waypoint):
    """Distance and heading error to a waypoint."""
    dx, dy = waypoint[:2] - state[:2]
    heading = math.atan2(dy, dx) - state[3]
    return math.hypot(dx, dy), math.remainder(heading, 2 * math.pi)


@pytest.mark.parametrize("seed", range(8))
def test_reaches_waypoints_within_limits_and_lyapunov_falls(seed):
    rng = np.random.default_rng(seed)
    vehicle = robot()
    waypoint = rng.uniform(-3, 3, 3)
    state = vehicle.begin(
        vehicle.initial_state(np.append(rng.uniform(-3, 3, 3), rng.uniform(-3, 3))), waypoint
    )
    prediction = vehicle.predict(state, waypoint[None], 1.0)
    before = math.inf
    for _ in range(prediction.steps[0]):
        assert not vehicle.reached(state, waypoint)
        after = vehicle.advance(state, waypoint, 1)
        assert 0 <= after[4] <= 0.5 + 1e-12
        assert abs(after[4] - state[4]) <= 0.5 * 0.005 + 1e-12
        assert abs(math.remainder(after[3] - state[3], 2 * math.pi)) <= math.radians(90) * 0.005 + 1e-9
        distance, heading = error(after, waypoint)
        assert (distance**2 + heading**2) / 2 <= before + 1e-9
        before = (distance**2 + heading**2) / 2
        state = after
    assert vehicle.reached(state, waypoint)


@pytest.mark.parametrize("seed", range(8))
def test_reaches_the_next_waypoint_from_full_speed(seed):
    rng = np.random.default_rng(seed)
    vehicle = robot(speed_m_s=2.0, turn_rate_deg_s=60.0)
    state = vehicle.advance(vehicle.initial_state(np.zeros(4)), np.array([30.0, 0.0, 0.0]), 2000)
    waypoint = state[:3] + rng.uniform(-1.5, 1.5, 3)
    prediction = vehicle.predict(vehicle.begin(state, waypoint), waypoint[None], 1.0)
    assert vehicle.reached(prediction.end_states[0], waypoint)


def test_many_small_chunks_are_one_big_chunk_to_the_bit():
    rng = np.random.default_rng(5)
    vehicle = robot()
    waypoint = np.array([-2.0, 0.5, 0.0])
    state = vehicle.initial_state(np.array([0.3, 0.1, 0.0, 0.2]))
    whole = vehicle.advance(state, waypoint, 2000)
    done = 0
    while done < 2000:
        chunk = min(int(rng.integers(1, 50)), 2000 - done)
        state = vehicle.advance(state, waypoint, chunk)
        done += chunk
    assert np.array_equal(state, whole)


def test_prediction_is_what_is_driven_to_the_bit():
    vehicle = robot()
    state = vehicle.advance(vehicle.initial_state(np.zeros(4)), np.array([1.0, 1.0, 0.0]), 300)
    waypoints = np.random.default_rng(2).uniform(-3, 3, (9, 3))
    prediction = vehicle.predict(state, waypoints, 0.5)
    for i, waypoint in enumerate(waypoints):
        assert np.array_equal(
            vehicle.advance(state, waypoint, int(prediction.steps[i])), prediction.end_states[i]
        )
        rows = slice(prediction.offsets[i], prediction.offsets[i + 1])
        for time, pose in zip(prediction.measure_times[rows], prediction.measure_poses[rows], strict=True):
            assert np.array_equal(vehicle.pose(vehicle.advance(state, waypoint, round(time / 0.005))), pose)


@pytest.mark.parametrize("angle", [0.7, 2.0, -2.9])
def test_drive_turns_with_the_world(angle):
    vehicle = robot()
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    waypoint = np.array([2.0, 1.0, 0.0])
    straight = vehicle.advance(vehicle.initial_state(np.array([0.1, 0.2, 0.0, 0.3])), waypoint, 900)
    start = np.append(turn @ [0.1, 0.2, 0.0], 0.3 + angle)
    turned = vehicle.advance(vehicle.initial_state(start), turn @ waypoint, 900)
    assert np.allclose(turned[:3], turn @ straight[:3], atol=1e-9)
    assert math.remainder(turned[3] - straight[3] - angle, 2 * math.pi) == pytest.approx(0, abs=1e-9)


def test_waypoint_behind_is_reached_by_turning_on_the_spot_first():
    vehicle = robot()
    state = vehicle.advance(vehicle.initial_state(np.zeros(4)), np.array([-1.0, 0.0, 0.0]), 150)
    assert np.allclose(state[:2], 0, atol=1e-3)
    assert abs(state[3]) > 0.8


def test_keeps_its_altitude_and_ignores_that_of_the_waypoint():
    vehicle = robot()
    trajectory = vehicle.trajectory(
        vehicle.initial_state(np.array([0.0, 0.0, 0.3, 0.0])), np.array([1.0, 0.0, 9.0]), 0.0, 1.0
    )
    assert (trajectory.poses[:, 2] == 0.3).all()
    assert vehicle.reached(trajectory.end_state, trajectory.waypoint)


def test_control_cost_is_the_sum_of_squared_inputs():
    vehicle = robot()
    waypoint = np.array([1.0, 1.0, 0.0])
    state = vehicle.initial_state(np.zeros(4))
    prediction = vehicle.predict(state, waypoint[None], 1.0)
    cost = 0.0
    for _ in range(prediction.steps[0]):
        state = vehicle.advance(state, waypoint, 1)
        cost += state[4] ** 2 + state[5] ** 2
    assert prediction.control_costs[0] == pytest.approx(cost)


@pytest.mark.parametrize("place", [np.nan, np.inf])
def test_impossible_waypoint_or_state_ends(place):
    vehicle = robot()
    state = vehicle.initial_state(np.zeros(4))
    assert vehicle.predict(state, np.array([[place, 0.0, 0.0]]), 1.0).steps[0] == 0
    state[0] = place
    assert vehicle.predict(state, np.zeros((1, 3)), 1.0).steps[0] == 0
