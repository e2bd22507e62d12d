import numpy as np
import pytest

from planner.vehicles.prediction import finer, measure_steps, measurements_only
from tests.planner.problems import drone


@pytest.mark.parametrize(("steps", "parts"), [(200, 4), (10, 1), (47, 1), (274, 137), (100, 2)])
def test_samples_divide_the_measurement_period(steps, parts):
    assert finer(steps, 0.005) == parts


@pytest.mark.parametrize("period", [0.3, 1.0])
def test_measurements_among_finer_samples_are_those_predicted_without(period):
    vehicle = drone()
    state = vehicle.initial_state(np.zeros(4))
    waypoints = np.array([[20.0, 1.0, 3.0], [0.0, 0.0, 0.0], [2.0, 9.0, 1.0]])
    expected = vehicle.predict(state, waypoints, period)
    parts = finer(measure_steps(period, 0.005), 0.005)
    found = measurements_only(vehicle.predict(state, waypoints, period / parts), parts)
    assert np.array_equal(found.offsets, expected.offsets)
    assert np.array_equal(found.measure_poses, expected.measure_poses)
    assert np.allclose(found.measure_times, expected.measure_times)


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan, np.inf])
def test_measurement_period_must_be_positive_and_finite(period):
    with pytest.raises(ValueError, match="measure_period"):
        measure_steps(period, 0.005)


@pytest.mark.parametrize(("far", "period"), [(40.0, 1.0), (400.0, 1.0), (400.0, 0.05)])
def test_trajectory_has_at_most_200_samples_and_all_measurements(far, period):
    vehicle = drone()
    trajectory = vehicle.trajectory(
        vehicle.initial_state(np.zeros(4)), np.array([far, 0.0, 0.0]), 5.0, period
    )
    assert len(trajectory.times) <= 200
    assert np.diff(trajectory.times).max() <= max(0.25, trajectory.end_time / 95) + 1e-9
    assert len(trajectory.measure_times) == np.ceil((trajectory.end_time - 5.0) / period - 1e-9)
