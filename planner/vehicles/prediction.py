"""What all vehicle models share when they predict: measurement instants, bounds, the sampled trajectory.

The loop over waypoints around a model's own kernel is not shared: numba keeps nothing on disk of a kernel
that is made around another one, so that every process would compile it anew.
"""

import math

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import exact_kernel
from planner.plan import Predictions, Trajectory, VehicleModel

SAMPLES = 200  # of a trajectory, at most
SAMPLE_S = 0.25  # between samples of a way, at most, unless SAMPLES forbids it
PATIENCE = 10.0  # a prediction ends after this many times the straight way's time
SETTLE_S = 5.0  # what a controller may take on top of that time on a very short way


def measure_steps(measure_period: float, control_period: float) -> int:
    """The measurement period in control steps, at least one.

    Raises:
        ValueError: if a period is not a positive number.
    """
    if not (measure_period > 0 and math.isfinite(measure_period)):
        raise ValueError(f"measure_period: must be positive and finite, got {measure_period}")
    return max(1, round(measure_period / control_period))


def step_bounds(
    gaps: FloatArray, speed: float, acceleration: float, present: float, control_period: float
) -> IntArray:
    """After how many control steps (w,) to give up ways of `gaps` (w,) metres, begun at speed `present`."""
    seconds = gaps / speed + (speed + 2.0 * present) / acceleration + SETTLE_S
    steps = np.where(np.isfinite(seconds), PATIENCE * seconds / control_period, 0.0)
    return np.ceil(np.minimum(steps, 2.0**40)).astype(np.int64)


def measure_times(offsets: IntArray, period: float) -> FloatArray:
    """When each measurement of a prediction is taken, seconds after its start, from `Predictions.offsets`."""
    rank = np.arange(offsets[-1]) - np.repeat(offsets[:-1], np.diff(offsets))
    return rank.astype(np.float64) * period


def finer(measure_steps: int, control_period: float) -> int:
    """Into how many equal parts to cut the measurement period for samples at most SAMPLE_S apart."""
    parts = max(1, math.ceil(measure_steps * control_period / SAMPLE_S - 1e-9))
    while measure_steps % parts:
        parts += 1
    return parts


def measurements_only(way: Predictions, parts: int) -> Predictions:
    """The measurements alone, of predictions with `parts` samples for each."""
    rank = np.arange(way.offsets[-1]) - np.repeat(way.offsets[:-1], np.diff(way.offsets))
    keep = rank % parts == 0
    offsets = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(keep)])[way.offsets]
    return Predictions(
        waypoints=way.waypoints,
        steps=way.steps,
        control_costs=way.control_costs,
        offsets=offsets,
        measure_times=way.measure_times[keep],
        measure_poses=way.measure_poses[keep],
        end_states=way.end_states,
    )


def sampled(
    model: VehicleModel, state: FloatArray, waypoint: FloatArray, start_time: float, measure_period: float
) -> Trajectory:
    """`VehicleModel.trajectory` for a model that can predict."""
    target = np.ascontiguousarray(waypoint, dtype=np.float64)[None]
    period = model.control_period
    every = measure_steps(measure_period, period)
    parts = finer(every, period)
    way = model.predict(state, target, every / parts * period)  # one way: measurements are every so many rows
    stride = max(1, math.ceil(way.measure_times.size / (SAMPLES - 1)))
    end_state = np.array(way.end_states[0])
    end_time = start_time + int(way.steps[0]) * period
    return Trajectory(
        waypoint=np.array(target[0]),
        start_time=start_time,
        end_time=end_time,
        measure_times=start_time + way.measure_times[::parts],
        measure_poses=way.measure_poses[::parts].copy(),
        times=np.append(start_time + way.measure_times[::stride], end_time),
        poses=np.vstack([way.measure_poses[::stride], model.pose(end_state)]),
        end_state=end_state,
        control_cost=float(way.control_costs[0]),
        route=target,
        route_times=np.array([start_time]),
    )


@exact_kernel
def grown(rows: FloatArray) -> FloatArray:
    """`rows` (k, c) with room for twice as many."""
    more = np.empty((2 * rows.shape[0], rows.shape[1]))
    more[: rows.shape[0]] = rows
    return more
