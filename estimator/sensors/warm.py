"""One small call per kind of sensor that compiles every kernel it uses at run time, to the cache on disk."""

from typing import Any

import numpy as np

from estimator.filter import Area
from estimator.sensor import SensorModel
from estimator.sensors.bearing_only import BearingOnly
from estimator.sensors.detector import Detector
from estimator.sensors.field_of_view import FieldOfView, Shape
from estimator.sensors.position import Position
from estimator.sensors.range_bearing import RangeBearing
from estimator.sensors.range_only import RangeOnly

KINDS = ("range_bearing", "bearing_only", "range_only", "position", "detector", "fields")


def run(kind: str, d: int) -> None:
    """Everything that filters, planners and simulated devices call of one of `KINDS` in d dimensions."""
    rng = np.random.default_rng(0)
    pose = np.array([10.0, 10.0, 5.0, 0.5])
    points = rng.uniform(8.0, 12.0, (d, 50))
    fixed = points.copy()
    fixed.flags.writeable = False  # such as the nodes of a grid, which numba takes for another type
    if kind == "fields":
        for shape, size in _fields(d).items():
            one = np.ones(1)
            field = FieldOfView(d, shape, 1.0, np.array(size), False, one, one, 5.0)
            for some in (points, fixed):
                field.detection(some, pose)
                if shape in ("exponential", "smooth_sector"):
                    FieldOfView(d, shape, 1.0, np.array(size)).slopes(some, pose)
        return
    sensor = _sensor(kind, d)
    sensor.detection(fixed, pose)
    measurements = sensor.sample(points, pose, rng)
    sensor.look(points, pose, measurements)
    sensor.look(fixed, pose, measurements)
    sensor.locate(measurements, pose)
    if own_look := getattr(sensor, "own_look", None):
        owners = np.zeros(points.shape[1], np.int64)
        own_look(points, pose, measurements, owners)
        owners.flags.writeable = False
        own_look(points, pose, measurements, owners)
    if jacobian := getattr(sensor, "jacobian", None):
        jacobian(points, pose)
        jacobian(fixed, pose)


def _fields(d: int) -> dict[Shape, list[float]]:
    return {
        "exponential": [5.0] * d,
        "box": [-3.0, 3.0] * d,
        "sector": [0.0, 5.0, 2.0],
        "smooth_sector": [1.0, 10.0, 2.0],
    }


def _sensor(kind: str, d: int) -> SensorModel:
    area = Area(np.zeros(d), np.full(d, 20.0))
    up: dict[str, Any] = {}
    if kind == "range_bearing":
        up = {"elevation_sigma_deg": 2.0} if d == 3 else {}
        up |= {"range_sigma_m": 0.5, "bearing_sigma_deg": 2.0, "clutter": 3.0, "reach_m": [10.0] * d}
        return RangeBearing.of(RangeBearing.Config(period_s=1.0, **up), area)
    if kind == "bearing_only":
        up = {"elevation_sigma_deg": 2.0} if d == 3 else {}
        return BearingOnly.of(BearingOnly.Config(period_s=1.0, **up), area)
    if kind == "range_only":
        return RangeOnly.of(RangeOnly.Config(period_s=1.0), area)
    if kind == "position":
        up = {"height_sigma_m": 0.5} if d == 3 else {}
        config = Position.Config(period_s=1.0, sigma_m=0.5, clutter=1.0, box_m=[(-3.0, 3.0)] * d, **up)
        return Position.of(config, area)
    up = {"height_angle_deg": 60.0} if d == 3 else {}
    return Detector.of(Detector.Config(period_s=1.0, range_m=5.0, angle_deg=60.0, clutter=1.0, **up), area)
