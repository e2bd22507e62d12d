"""Ways through several waypoints are driven as they were predicted."""

import numpy as np
import pytest

from agents.devices import VehicleState
from planner.plan import VehicleModel
from planner.vehicles.quadrotor import Quadrotor
from planner.vehicles.route import advanced, routed
from planner.vehicles.unicycle import Unicycle
from sim.vehicle import SimulatedVehicle

MODELS = {"unicycle": Unicycle(Unicycle.Config()), "quadrotor": Quadrotor(Quadrotor.Config())}
START = np.array([1.0, 2.0, 3.0, 0.4])
ROUTE = np.array([[6.0, 2.0, 3.0], [6.0, 7.0, 3.0], [1.0, 7.0, 3.0]])


@pytest.mark.parametrize("kind", MODELS)
def test_a_route_passes_every_waypoint_in_turn_and_ends_at_the_last(kind: str) -> None:
    model = MODELS[kind]
    way = routed(model, model.initial_state(START), ROUTE, 10.0, 0.5, near=0.8)
    assert model.reached(way.end_state, ROUTE[-1])
    assert (np.diff(way.route_times) > 0).all()
    for waypoint, handover in zip(ROUTE[:-1], way.route_times[1:], strict=True):
        passed = np.linalg.norm(way.poses[:, :3] - waypoint, axis=1)
        assert passed.min() < 0.8
        assert abs(way.times[int(np.argmax(passed < 0.8))] - handover) < 0.3
    np.testing.assert_allclose(np.diff(way.measure_times), 0.5)
    assert way.measure_times[0] == way.start_time == way.route_times[0] == 10.0


@pytest.mark.parametrize("kind", MODELS)
def test_what_was_predicted_is_what_is_driven(kind: str) -> None:
    model = MODELS[kind]
    way = routed(model, model.initial_state(START), ROUTE, 10.0, 0.5, near=0.8)
    vehicle = SimulatedVehicle(model, START, 9.0)
    vehicle.follow(way, 9.5)
    for time, pose in zip(way.measure_times, way.measure_poses, strict=True):
        np.testing.assert_allclose(vehicle.state(time).pose, pose, atol=1e-9)
    end = vehicle.state(way.end_time)
    assert end.arrived
    np.testing.assert_allclose(end.state, way.end_state, atol=1e-9)


@pytest.mark.parametrize("kind", MODELS)
def test_a_state_is_carried_forward_over_the_corners(kind: str) -> None:
    model = MODELS[kind]
    way = routed(model, model.initial_state(START), ROUTE, 10.0, 0.5, near=0.8)
    vehicle = SimulatedVehicle(model, START, 10.0)
    vehicle.follow(way, 10.0)
    early: VehicleState = vehicle.state(10.0 + 0.3 * (way.end_time - 10.0))
    steps = round((way.end_time - early.time) / model.control_period)
    state = advanced(model, early.state, way, early.time, steps)
    np.testing.assert_allclose(state, way.end_state, atol=1e-9)


def test_the_rest_of_a_route_is_driven_until_the_next_begins() -> None:
    model = MODELS["unicycle"]
    first = routed(model, model.initial_state(START), ROUTE, 0.0, 0.5, near=0.8)
    second = routed(model, first.end_state, ROUTE[::-1], first.end_time, 0.5, near=0.8)
    vehicle = SimulatedVehicle(model, START, 0.0)
    vehicle.follow(first, 0.0)
    vehicle.state(1.0)
    vehicle.follow(second, 1.0)  # long before it begins
    np.testing.assert_allclose(vehicle.state(first.end_time).state, first.end_state, atol=1e-9)
    np.testing.assert_allclose(vehicle.state(second.end_time).state, second.end_state, atol=1e-9)


@pytest.mark.parametrize("route", [np.zeros((0, 3)), np.zeros((2, 2)), np.full((2, 3), np.nan)])
def test_a_route_that_is_none_is_refused(route: np.ndarray) -> None:
    model: VehicleModel = MODELS["unicycle"]
    with pytest.raises(ValueError, match="route"):
        routed(model, model.initial_state(START), route, 0.0, 1.0, near=1.0)
