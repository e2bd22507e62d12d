"""Ways through several waypoints: around obstacles, or along a planner's path.

The vehicle steers for one waypoint after the other, and goes on to the next as soon as it is near enough, so
it does not stop at each. When it goes on is part of the trajectory: what was predicted is what is driven.
"""

import math

import numpy as np

from estimator.arrays import FloatArray
from planner.plan import Trajectory, VehicleModel
from planner.vehicles.prediction import SAMPLES, measure_steps, sampled

LOOK_S = 0.05  # how often it is asked whether a waypoint is near enough
PATIENCE_S = 600.0  # for one leg


def routed(
    model: VehicleModel,
    state: FloatArray,
    route: FloatArray,
    start_time: float,
    measure_period: float,
    *,
    near: float,
) -> Trajectory:
    """The trajectory through waypoints `route` (r, 3), each but the last passed within `near` metres
    (or reached, if that comes first).

    It measures at its start and every `measure_period` seconds from there.

    Raises:
        ValueError: if the route is empty or not finite, or `near` is not positive.
    """
    route = np.ascontiguousarray(route, dtype=np.float64)
    if route.ndim != 2 or route.shape[1:] != (3,) or len(route) == 0 or not np.isfinite(route).all():
        raise ValueError(f"route: expected finite numbers of shape (r, 3), r >= 1, got shape {route.shape}")
    if not near > 0:
        raise ValueError(f"near: expected a positive number of metres, got {near}")
    if len(route) == 1:
        return sampled(model, state, route[0], start_time, measure_period)
    period = model.control_period
    every = measure_steps(measure_period, period)
    look = max(1, round(LOOK_S / period))
    step, handovers = 0, []
    steps, poses = [0], [model.pose(state)]
    measured_steps, measured = [0], [model.pose(state)]
    for i, waypoint in enumerate(route):
        state = model.begin(state, waypoint)
        handovers.append(step)
        last, given_up = i == len(route) - 1, step + round(PATIENCE_S / period)
        while step < given_up and not _there(model, state, waypoint, None if last else near):
            to_measure = every - step % every
            stride = 1 if last and _close(model, state, waypoint, look * period) else min(look, to_measure)
            state = model.advance(state, waypoint, stride)
            step += stride
            if step % every == 0:
                measured_steps.append(step)
                measured.append(model.pose(state))
            if step % look == 0:
                steps.append(step)
                poses.append(model.pose(state))
    stride = max(1, math.ceil(len(steps) / (SAMPLES - 1)))
    times = np.append(np.array(steps[::stride], dtype=np.float64), step) * period
    before = [k for k, taken in enumerate(measured_steps) if taken < step or k == 0]
    return Trajectory(
        waypoint=route[-1].copy(),
        start_time=start_time,
        end_time=start_time + step * period,
        measure_times=start_time + np.array([measured_steps[k] for k in before]) * period,
        measure_poses=np.stack([measured[k] for k in before]),
        times=start_time + times,
        poses=np.vstack([np.stack(poses[::stride]), model.pose(state)]),
        end_state=np.array(state),
        control_cost=0.0,
        route=route,
        route_times=start_time + np.array(handovers) * period,
    )


def advanced(
    model: VehicleModel, state: FloatArray, trajectory: Trajectory, time: float, steps: int
) -> FloatArray:
    """The state `steps` control periods after team time `time`, when the vehicle on its way has `state`."""
    period = model.control_period
    begins = np.round((trajectory.route_times - time) / period).astype(np.int64)  # relative to `time`
    done = 0
    for i, waypoint in enumerate(trajectory.route):
        until = min(steps, int(begins[i + 1])) if i + 1 < len(begins) else steps
        if begins[i] > 0 and begins[i] <= steps:
            state = model.begin(state, waypoint)
        if until > done:
            state = model.advance(state, waypoint, until - done)
            done = until
    return state


def _there(model: VehicleModel, state: FloatArray, waypoint: FloatArray, near: float | None) -> bool:
    if near is None or model.reached(state, waypoint):
        return model.reached(state, waypoint)
    return bool(np.linalg.norm(model.pose(state)[:3] - waypoint) < near)


def _close(model: VehicleModel, state: FloatArray, waypoint: FloatArray, seconds: float) -> bool:
    """Whether the waypoint may be reached within so many seconds."""
    gap = float(np.linalg.norm(model.pose(state)[:3] - waypoint))
    return gap <= 2.0 * seconds * float(np.linalg.norm(model.velocity(state))) + 0.5
