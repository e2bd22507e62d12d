import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from planner.vehicles import quadrotor_lqr as weights
from planner.vehicles.quadrotor import Quadrotor
from tests.planner.problems import drone


def twelve_states(config):
    """A, B of all 12 states and 4 inputs (torques, force), by the matrix exponential of the hover model."""
    g, period = weights.GRAVITY, 0.005
    a, b = np.zeros((12, 12)), np.zeros((12, 4))
    a[0:3, 6:9] = a[3:6, 9:12] = np.eye(3)  # position, angles from velocity, rates
    a[6, 4], a[7, 3] = g, -g
    b[9:12, 0:3] = np.diag(1 / np.array(config.inertias_kg_m2))
    b[8, 3] = 1 / config.mass_kg
    whole = np.zeros((16, 16))
    whole[:12, :12], whole[:12, 12:] = a * period, b * period
    exact = expm(whole)
    return exact[:12, :12], exact[:12, 12:]


def whole_gain(vehicle):
    config = vehicle.config
    a, b = twelve_states(config)
    q = np.diag(
        np.repeat(
            [weights.POSITION_WEIGHT, weights.ANGLE_WEIGHT, weights.VELOCITY_WEIGHT, weights.RATE_WEIGHT], 3
        )
    )
    inertias = np.array(config.inertias_kg_m2)
    r = np.diag([*(1 / inertias**2), vehicle.lqr.climb_weight / config.mass_kg**2])
    p = solve_discrete_are(a, b, q, r)
    return a, b, np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)


def test_gain_is_that_of_the_whole_12_state_system():
    vehicle = drone()
    _, _, whole = whole_gain(vehicle)
    ix, iy, iz = vehicle.config.inertias_kg_m2
    level, climb, turn = vehicle.lqr.level, vehicle.lqr.climb, vehicle.lqr.turn
    ours = np.zeros((4, 12))
    ours[1, [0, 4, 6, 10]] = iy * level
    ours[0, [1, 3, 7, 9]] = ix * level * [-1, 1, -1, 1]
    ours[2, [5, 11]] = iz * turn
    ours[3, [2, 8]] = vehicle.config.mass_kg * climb
    assert np.allclose(ours, whole, rtol=1e-6, atol=1e-9 * np.abs(whole).max())


def test_closed_loop_is_stable():
    a, b, gain = whole_gain(drone())
    assert np.abs(np.linalg.eigvals(a - b @ gain)).max() < 1


def test_flight_is_the_12_state_system_under_that_gain():
    vehicle = drone()
    a, b, gain = whole_gain(vehicle)
    rng = np.random.default_rng(1)
    state = vehicle.initial_state(np.array([1.0, 2.0, 3.0, 0.4]))
    state[3:12] += rng.normal(0, 0.05, 9)
    waypoint = np.array([20.0, -10.0, 8.0])
    lags = np.array([vehicle.lqr.lag, vehicle.lqr.lag, vehicle.lqr.climb_lag])
    for _ in range(300):
        after = vehicle.advance(state, waypoint, 1)
        position, velocity = (
            after[12:15],
            after[15:18],
        )  # the reference moves first, then the drone follows it
        error = state[:12] - np.concatenate([position - lags * velocity, np.zeros(3), velocity, np.zeros(3)])
        assert np.allclose(after[:12], a @ state[:12] - b @ (gain @ error), rtol=1e-6, atol=1e-6)
        state = after


@pytest.mark.parametrize("speed", [0.3, 2.0, 12.0])
@pytest.mark.parametrize("seed", range(4))
def test_reaches_waypoints_from_rest_straight_and_within_limits(seed, speed):
    rng = np.random.default_rng(seed)
    vehicle = drone(speed_m_s=speed, acceleration_m_s2=speed / 2, tolerance_m=speed / 20)
    start, waypoint = rng.uniform(-20, 20, 3) * speed / 5, rng.uniform(-20, 20, 3) * speed / 5
    state = vehicle.begin(vehicle.initial_state(np.append(start, 0.0)), waypoint)
    prediction = vehicle.predict(state, waypoint[None], 1.0)
    gap = np.linalg.norm(waypoint - start)
    assert prediction.steps[0] * 0.005 < gap / speed + 8
    before = vehicle.velocity(state)
    for step in range(prediction.steps[0]):
        assert not vehicle.reached(state, waypoint), f"reached at step {step} of {prediction.steps[0]}"
        state = vehicle.advance(state, waypoint, 1)
        velocity = vehicle.velocity(state)
        assert np.linalg.norm(velocity) <= 1.03 * speed
        assert np.linalg.norm(velocity - before) <= 1.08 * speed / 2 * 0.005
        before = velocity
        along = (state[:3] - start) @ (waypoint - start) / gap
        assert np.linalg.norm(state[:3] - start - along * (waypoint - start) / gap) < 0.03 * speed
    assert vehicle.reached(state, waypoint)
    state = vehicle.advance(state, waypoint, 4000)
    assert np.linalg.norm(state[:3] - waypoint) < 0.02 * speed
    assert np.linalg.norm(vehicle.velocity(state)) < 1e-3 * speed


@pytest.mark.parametrize("seed", range(6))
def test_keeps_its_speed_past_a_waypoint_and_stays_within_limits(seed):
    rng = np.random.default_rng(seed)
    vehicle = drone(speed_m_s=8.0, acceleration_m_s2=4.0)
    state = vehicle.initial_state(np.zeros(4))
    for _ in range(4):
        waypoint = rng.uniform(-30, 30, 3)
        state = vehicle.begin(state, waypoint)
        steps = min(int(vehicle.predict(state, waypoint[None], 1.0).steps[0]), int(rng.integers(100, 900)))
        before = vehicle.velocity(state)
        for _ in range(steps):
            state = vehicle.advance(state, waypoint, 1)
            velocity = vehicle.velocity(state)
            assert np.linalg.norm(velocity) <= 1.03 * 8.0
            assert np.linalg.norm(velocity - before) <= 1.1 * 4.0 * 0.005
            before = velocity
    prediction = vehicle.predict(vehicle.begin(state, waypoint), waypoint[None], 1.0)
    assert vehicle.reached(prediction.end_states[0], waypoint)


def test_passing_through_is_quicker_than_stopping():
    vehicle = drone(speed_m_s=8.0, acceleration_m_s2=2.0)
    ahead = np.array([[100.0, 0.0, 0.0]])
    flying = vehicle.advance(vehicle.initial_state(np.zeros(4)), ahead[0], 1200)
    resting = vehicle.initial_state(np.append(flying[:3], 0.0))
    assert vehicle.predict(flying, ahead, 1.0).steps[0] < vehicle.predict(resting, ahead, 1.0).steps[0] - 100


@pytest.mark.parametrize("seed", range(3))
def test_many_small_chunks_are_one_big_chunk_to_the_bit(seed):
    rng = np.random.default_rng(seed)
    vehicle = drone()
    waypoint = rng.uniform(-30, 30, 3)
    state = vehicle.begin(vehicle.initial_state(rng.uniform(-5, 5, 4)), waypoint)
    whole = vehicle.advance(state, waypoint, 1500)
    done = 0
    while done < 1500:
        chunk = min(int(rng.integers(1, 40)), 1500 - done)
        state = vehicle.advance(state, waypoint, chunk)
        done += chunk
    assert np.array_equal(state, whole)


@pytest.mark.parametrize("count", [1, 2, 5, 27])
def test_prediction_is_what_is_flown_to_the_bit(count):
    rng = np.random.default_rng(count)
    vehicle = drone()
    state = vehicle.advance(vehicle.initial_state(np.zeros(4)), np.array([9.0, 9.0, 9.0]), 500)
    waypoints = rng.uniform(-30, 30, (count, 3))
    prediction = vehicle.predict(state, waypoints, 0.7)
    for i, waypoint in enumerate(waypoints):
        begun = vehicle.begin(state, waypoint)
        assert np.array_equal(
            vehicle.advance(begun, waypoint, int(prediction.steps[i])), prediction.end_states[i]
        )
        rows = slice(prediction.offsets[i], prediction.offsets[i + 1])
        for time, pose in zip(prediction.measure_times[rows], prediction.measure_poses[rows], strict=True):
            assert np.array_equal(vehicle.pose(vehicle.advance(begun, waypoint, round(time / 0.005))), pose)


@pytest.mark.parametrize("period", [0.05, 0.7, 1.0, 30.0])
def test_measures_at_the_start_and_then_once_per_period(period):
    vehicle = drone()
    prediction = vehicle.predict(vehicle.initial_state(np.zeros(4)), np.array([[20.0, 5.0, 1.0]]), period)
    every = round(period / 0.005)
    assert len(prediction.measure_times) == -(-int(prediction.steps[0]) // every)
    assert np.allclose(prediction.measure_times, np.arange(len(prediction.measure_times)) * period)


def test_flight_turns_with_the_world():
    vehicle = drone()
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    waypoint = np.array([20.0, 7.0, 3.0])
    straight = vehicle.advance(vehicle.initial_state(np.zeros(4)), waypoint, 700)
    turned = vehicle.advance(vehicle.initial_state(np.zeros(4)), turn @ waypoint, 700)
    assert np.allclose(turned[:3], turn @ straight[:3], atol=1e-9)
    assert np.allclose(vehicle.velocity(turned), turn @ vehicle.velocity(straight), atol=1e-9)


def test_yaw_turns_to_zero():
    vehicle = drone()
    state = vehicle.initial_state(np.array([0.0, 0.0, 0.0, 2.0]))
    assert abs(vehicle.pose(vehicle.advance(state, np.zeros(3), 2000))[3]) < 1e-3


def test_control_cost_is_the_sum_of_squared_inputs():
    vehicle = drone()
    waypoint = np.array([10.0, -4.0, 6.0])
    state = vehicle.initial_state(np.zeros(4))
    prediction = vehicle.predict(state, waypoint[None], 1.0)
    cost = 0.0
    for _ in range(prediction.steps[0]):
        after = vehicle.advance(state, waypoint, 1)
        torque = np.array(vehicle.config.inertias_kg_m2) * (after[9:12] - state[9:12]) / 0.005
        force = vehicle.config.mass_kg * (after[8] - state[8]) / 0.005
        cost += torque @ torque + force**2
        state = after
    assert prediction.control_costs[0] == pytest.approx(cost, rel=1e-6)


def test_trajectory_has_both_ends():
    vehicle = drone()
    state = vehicle.initial_state(np.zeros(4))
    trajectory = vehicle.trajectory(state, np.array([40.0, 0.0, 0.0]), 5.0, 1.0)
    assert trajectory.times[0] == trajectory.start_time == trajectory.measure_times[0] == 5.0
    assert trajectory.times[-1] == trajectory.end_time
    assert (np.diff(trajectory.times) > 0).all()
    assert np.array_equal(trajectory.poses[0], vehicle.pose(state))
    assert np.array_equal(trajectory.end_pose, vehicle.pose(trajectory.end_state))
    assert vehicle.reached(trajectory.end_state, trajectory.waypoint)


def test_way_to_where_it_is_has_no_length():
    vehicle = drone()
    trajectory = vehicle.trajectory(vehicle.initial_state(np.zeros(4)), np.zeros(3), 5.0, 1.0)
    assert trajectory.end_time == 5.0
    assert len(trajectory.times) == 1
    assert trajectory.measure_times.size == 0


@pytest.mark.parametrize("place", [np.nan, np.inf, 1e300])
def test_impossible_waypoint_or_state_ends(place):
    vehicle = drone()
    state = vehicle.initial_state(np.zeros(4))
    assert vehicle.predict(state, np.array([[place, 0.0, 0.0]]), 1.0).steps[0] == 0
    state[0] = place
    assert vehicle.predict(state, np.zeros((1, 3)), 1.0).steps[0] == 0


def test_unreachable_tolerance_ends_at_the_bound():
    vehicle = drone(tolerance_m=1e-15)
    steps = vehicle.predict(vehicle.initial_state(np.zeros(4)), np.array([[1.0, 0.0, 0.0]]), 1.0).steps[0]
    assert 2000 < steps < 20000


def test_wrong_measure_period_is_refused():
    with pytest.raises(ValueError, match="measure_period"):
        drone().predict(np.zeros(18), np.ones((1, 3)), 0.0)


def test_state_from_an_autopilot_flies_on_smoothly():
    vehicle = drone()
    state = vehicle.state_at(np.array([1.0, 2.0, 3.0, 0.0]), np.array([4.0, 0.0, 1.0]))
    ahead = np.array([101.0, 2.0, 28.0])
    after = vehicle.advance(state, ahead, 20)
    assert np.allclose(vehicle.velocity(after), [4.0, 0.0, 1.0], atol=0.3)


def test_config_needs_positive_numbers():
    import msgspec

    with pytest.raises(msgspec.ValidationError, match="speed_m_s"):
        msgspec.convert({"speed_m_s": 0.0}, Quadrotor.Config)
