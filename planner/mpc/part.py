"""The first seconds of a way, so that a robot that plans anew every few seconds need not stop in between."""

from dataclasses import replace

import numpy as np

from estimator.arrays import FloatArray
from planner.plan import Trajectory, VehicleModel
from planner.vehicles.route import advanced


def begun(vehicle: VehicleModel, state: FloatArray, way: Trajectory, seconds: float) -> Trajectory:
    """A way's first `seconds`, or all of it if it is not longer; it still steers for the way's end.

    The end is a control step. If no other plan comes by then, the robot goes on along the whole way.
    """
    period = vehicle.control_period
    steps = max(1, round(seconds / period))
    end = way.start_time + steps * period
    if end >= way.end_time:
        return way
    state_then = advanced(vehicle, vehicle.begin(state, way.route[0]), way, way.start_time, steps)
    kept = way.times < end - 1e-9
    measured = way.measure_times < end - 1e-9
    return replace(
        way,
        end_time=end,
        measure_times=way.measure_times[measured],
        measure_poses=way.measure_poses[measured],
        times=np.append(way.times[kept], end),
        poses=np.vstack([way.poses[kept], vehicle.pose(state_then)]),
        end_state=state_then,
    )
