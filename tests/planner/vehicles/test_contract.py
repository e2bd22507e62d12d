"""What every kind of vehicle promises."""

import math

import numpy as np
import pytest

from planner.avoidance.halt import Evader
from planner.vehicles.fixed_wing import FixedWing
from planner.vehicles.point_mass import PointMass
from planner.vehicles.quadrotor import Quadrotor
from planner.vehicles.unicycle import Unicycle
from sim.vehicle import SimulatedVehicle

VEHICLES = {
    "quadrotor": Quadrotor(Quadrotor.Config()),
    "unicycle": Unicycle(Unicycle.Config()),
    "point_mass": PointMass(PointMass.Config()),
    "fixed_wing": FixedWing(FixedWing.Config()),
}
SCALES = {"quadrotor": 60.0, "unicycle": 6.0, "point_mass": 30.0, "fixed_wing": 200.0}


@pytest.fixture(params=sorted(VEHICLES))
def kind(request):
    return request.param


@pytest.fixture
def vehicle(kind):
    return VEHICLES[kind]


def place(kind, rng):
    point = rng.uniform(-1, 1, 3) * SCALES[kind]
    if kind == "unicycle":
        point[2] = 0.0
    return point


@pytest.mark.parametrize("seed", range(3))
def test_what_is_predicted_is_what_the_simulated_vehicle_does(kind, vehicle, seed):
    rng = np.random.default_rng(seed)
    start = np.append(place(kind, rng), rng.uniform(-3, 3))
    device = SimulatedVehicle(vehicle, start, 0.0)
    way = vehicle.trajectory(device.state(1.0).state, place(kind, rng), 1.0, 0.5)
    device.follow(way, 1.0)
    for time, pose in zip(way.measure_times, way.measure_poses, strict=True):
        assert (device.state(time).pose == pose).all()
    end = device.state(way.end_time)
    assert (end.state == way.end_state).all()
    assert end.arrived


@pytest.mark.parametrize("seed", range(3))
def test_measurements_come_one_period_apart_and_end_before_arrival(kind, vehicle, seed):
    rng = np.random.default_rng(seed)
    state = vehicle.initial_state(np.append(place(kind, rng), 0.3))
    targets = np.stack([place(kind, rng) for _ in range(5)])
    found = vehicle.predict(state, targets, 0.4)
    for i in range(5):
        times = found.measure_times[found.offsets[i] : found.offsets[i + 1]]
        np.testing.assert_allclose(times, np.arange(times.size) * 0.4, atol=1e-12)
        assert times[-1] < found.steps[i] * vehicle.control_period
        assert vehicle.reached(found.end_states[i], targets[i])
        alone = vehicle.predict(state, targets[i : i + 1], 0.4)
        assert (alone.end_states[0] == found.end_states[i]).all()
        assert alone.steps[0] == found.steps[i]


@pytest.mark.parametrize("seed", range(3))
def test_limits_are_never_exceeded(kind, vehicle, seed):
    rng = np.random.default_rng(seed)
    state = vehicle.initial_state(np.append(place(kind, rng), rng.uniform(-3, 3)))
    period, config = vehicle.control_period, vehicle.config
    for _ in range(4):  # new waypoints in full motion
        waypoint = place(kind, rng)
        state = vehicle.begin(state, waypoint)
        for _ in range(200):
            after = vehicle.advance(state, waypoint, 1)
            before_pose, pose = vehicle.pose(state), vehicle.pose(after)
            moved = np.linalg.norm(pose[:3] - before_pose[:3]) / period
            turned = abs(math.remainder(pose[3] - before_pose[3], 2 * math.pi)) / period
            change = np.linalg.norm(vehicle.velocity(after) - vehicle.velocity(state)) / period
            if kind == "fixed_wing":
                level = np.linalg.norm(pose[:2] - before_pose[:2]) / period
                assert level == pytest.approx(config.speed_m_s, rel=1e-3)
                assert turned <= config.speed_m_s / config.turn_radius_m + 1e-9
                assert -config.sink_m_s - 1e-9 <= (pose[2] - before_pose[2]) / period
                assert (pose[2] - before_pose[2]) / period <= config.climb_m_s + 1e-9
            elif kind == "unicycle":
                assert moved <= config.speed_m_s + 1e-9
                assert turned <= math.radians(config.turn_rate_deg_s) + 1e-9
            else:
                assert moved <= config.speed_m_s * (1.0 + 0.1 * (kind == "quadrotor")) + 1e-9
                assert change <= config.acceleration_m_s2 * (1.0 + 0.5 * (kind == "quadrotor")) + 1e-9
            state = after


def test_many_small_steps_are_one_large_step_to_the_bit(kind, vehicle):
    rng = np.random.default_rng(7)
    waypoint = place(kind, rng)
    state = vehicle.begin(vehicle.initial_state(np.append(place(kind, rng), 1.0)), waypoint)
    whole, parts = vehicle.advance(state, waypoint, 700), state
    for steps in (1, 2, 3, 94, 600):
        parts = vehicle.advance(parts, waypoint, steps)
    assert (whole == parts).all()


def test_a_waypoint_where_it_is_takes_no_time(vehicle):
    state = vehicle.initial_state(np.array([1.0, 2.0, 3.0, 0.5]))
    found = vehicle.predict(state, state[None, :3], 0.5)
    assert found.steps[0] == 0
    assert found.offsets.tolist() == [0, 0]
    way = vehicle.trajectory(state, state[:3], 2.0, 0.5)
    assert way.end_time == 2.0
    assert np.isfinite(way.poses).all()


def test_waypoints_out_of_all_reach_end_without_nonsense(vehicle):
    state = vehicle.initial_state(np.zeros(4))
    targets = np.array([[np.nan, 0, 0], [np.inf, 0, 0], [1e300, 0, 0]])
    if isinstance(vehicle, FixedWing):
        found = vehicle.predict(state, targets, 0.5)
        assert np.isfinite(found.end_states).all()
        assert (found.steps == 0).all()
        assert not any(
            vehicle.reached(end, target) for end, target in zip(found.end_states, targets, strict=True)
        )


@pytest.mark.parametrize("period", [0.0, -1.0, math.nan, math.inf])
def test_measurement_periods_that_are_none_are_refused(vehicle, period):
    state = vehicle.initial_state(np.zeros(4))
    with pytest.raises(ValueError, match="measure_period"):
        vehicle.predict(state, np.ones((1, 3)), period)


def test_every_kind_can_get_out_of_the_way(vehicle):
    assert isinstance(vehicle, Evader)


def test_an_aircraft_never_stops_and_holds_on_a_circle_to_its_left():
    plane = VEHICLES["fixed_wing"]
    device = SimulatedVehicle(plane, np.array([0.0, 0.0, 50.0, 0.0]), 0.0)
    device.follow(None, 0.0)
    centre = np.array([0.0, plane.config.turn_radius_m])
    for time in np.arange(0.0, 60.0, 0.7):
        body = device.state(time)
        assert np.linalg.norm(body.pose[:2] - centre) == pytest.approx(plane.config.turn_radius_m)
        assert np.linalg.norm(body.velocity) == pytest.approx(plane.config.speed_m_s)


def test_an_aircraft_climbs_on_until_it_meets_a_high_waypoint():
    plane = VEHICLES["fixed_wing"]
    way = plane.trajectory(plane.initial_state(np.zeros(4)), np.array([100.0, 0.0, 90.0]), 0.0, 1.0)
    assert plane.reached(way.end_state, way.waypoint)
    assert way.end_time >= (90.0 - plane.config.tolerance_m) / plane.config.climb_m_s


def test_an_aircraft_that_would_fly_past_its_waypoints_is_refused():
    with pytest.raises(ValueError, match="tolerance_m"):
        FixedWing(FixedWing.Config(tolerance_m=0.01))
