"""Ways through several waypoints: around obstacles, or along a planner's path.

The vehicle steers for one waypoint after the other, and goes on to the next as soon as it is near enough, so
it does not stop at each. When it goes on is part of the trajectory: what was predicted is what is driven.
"""

import math

import numpy as np

from estimator.arrays import FloatArray, IntArray
from planner.plan import Trajectory, VehicleModel
from planner.vehicles.prediction import SAMPLES, measure_steps, sampled

LOOK_S = 0.05  # how often it is asked whether a waypoint is near enough


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
    (or reached, if that comes first). One that is not is left where the model's prediction gives it up.

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
    look = _look_steps(every, period)
    state = np.array(state, dtype=np.float64)
    step, handovers, poses = 0, [], []
    for i, waypoint in enumerate(route):
        handovers.append(step)
        leg = model.predict(state, waypoint[None], look * period)
        taken = int(leg.steps[0])
        passed = leg.measure_poses[: math.ceil(taken / look)]
        if i == len(route) - 1:
            state = leg.end_states[0]
        else:
            # All legs but the last end at a look, so that measurements fall on looks too.
            close = np.linalg.norm(passed[:, :3] - waypoint, axis=1) < near
            looks = int(np.argmax(close)) if close.any() else len(passed)
            taken = looks * look
            if taken:
                state = model.advance(model.begin(state, waypoint), waypoint, taken)
            passed = passed[:looks]
        poses.append(passed)
        step += taken
    looked = np.vstack(poses) if step else model.pose(state)[None]
    stride = max(1, math.ceil(len(looked) / (SAMPLES - 1)))
    times = np.append(np.arange(0, len(looked), stride) * look, step) * period
    measured: IntArray = np.arange(0, len(looked), every // look)
    return Trajectory(
        waypoint=route[-1].copy(),
        start_time=start_time,
        end_time=start_time + step * period,
        measure_times=start_time + (measured * look).astype(np.float64) * period,
        measure_poses=looked[measured],
        times=start_time + times,
        poses=np.vstack([looked[::stride], model.pose(state)]),
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


def _look_steps(every: int, control_period: float) -> int:
    """Control steps between looks: about LOOK_S, and a whole number of times in a measurement period."""
    parts = max(1, math.ceil(every * control_period / LOOK_S - 1e-9))
    while every % parts:
        parts += 1
    return every // parts
