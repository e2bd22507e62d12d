"""What a robot can do, as far as sharing tasks needs to know: how fast it is and how much it sees."""

import numpy as np

from estimator.filter import Area
from estimator.sensor import SensorModel
from planner.plan import VehicleModel

_SAMPLES = 41  # of the line over which a sensor's width is taken
_AHEAD = 9  # lines ahead of the robot, for sensors that look forward


def cruise(vehicle: VehicleModel, area: Area) -> float:
    """The mean speed in m/s of a vehicle on its way across a quarter of the area."""
    start, goal = np.zeros(4), np.zeros(3)
    d = area.dimension
    start[:d] = area.low + 0.375 * (area.high - area.low)
    goal[:3] = start[:3]
    goal[:d] = area.low + 0.625 * (area.high - area.low)
    way = vehicle.predict(vehicle.initial_state(start), goal[None], 10.0)
    seconds = float(way.steps[0]) * vehicle.control_period
    gap = float(np.linalg.norm(goal - start[:3]))
    return gap / seconds if seconds > 0 and gap > 0 else 1.0


def sweep_width(sensor: SensorModel, area: Area, altitude: float) -> float:
    """The metres that a passing robot sees: p_D along a line across its way, summed up.

    Of lines at different distances ahead that with the most counts.
    """
    d = area.dimension
    half = 0.5 * float((area.high - area.low)[:2].max())
    line = np.linspace(-half, half, _SAMPLES)
    middle = 0.5 * (area.low + area.high)
    points = np.tile(middle[:, None], (1, _AHEAD * _SAMPLES))
    points[0] += np.repeat(np.linspace(0.0, half, _AHEAD), _SAMPLES)
    points[1] += np.tile(line, _AHEAD)
    pose = np.zeros(4)
    pose[:2] = middle[:2]
    pose[2] = middle[2] if d == 3 else altitude
    seen = sensor.detection(np.ascontiguousarray(points), pose[None])[0]
    widths = np.nan_to_num(seen).reshape(_AHEAD, _SAMPLES).sum(axis=1) * float(line[1] - line[0])
    return max(float(widths.max()), 1e-3 * half)
