"""Every kind of sensor in 2D and 3D, with what the contract test has to know of its measurements."""

from dataclasses import dataclass
from math import pi
from typing import Any, Literal

import numpy as np

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.sensor import SensorModel
from estimator.sensors.bearing_only import BearingOnly
from estimator.sensors.detector import Detector, SoftmaxTable
from estimator.sensors.position import Position
from estimator.sensors.range_bearing import RangeBearing
from estimator.sensors.range_only import RangeOnly

SIDE = 24.0
POSE = np.array([14.0, 11.0, 8.0, 2.6])  # the robot's left side is across the seam of angles

Frame = Literal["body", "world", "map"]  # what of a measurement turns with the frame: nothing, bearing, all

MODELS: dict[str, Any] = {
    "range_bearing": RangeBearing,
    "bearing_only": BearingOnly,
    "range_only": RangeOnly,
    "position": Position,
    "detector": Detector,
}


@dataclass(frozen=True)
class Case:
    """One sensor and its measurement space: a box that holds all clutter, or whole numbers."""

    name: str
    sensor: SensorModel
    low: FloatArray  # (s,)
    high: FloatArray
    frame: Frame
    turns: bool  # the field of view turns with yaw

    @property
    def kind(self) -> str:
        return self.name.split("-")[0]

    @property
    def counted(self) -> bool:
        """Measurements are categories."""
        return self.kind == "detector"

    def anywhere(self, count: int, rng: np.random.Generator) -> tuple[FloatArray, float]:
        """Measurements (k, s) spread evenly over the space, and its volume."""
        if self.counted:
            every = np.arange(self.low[0], self.high[0] + 1.0)[:, None]
            return every, float(len(every))
        z = rng.uniform(self.low, self.high, (count, self.low.size))
        return z, float(np.prod(self.high - self.low))


def area(d: int) -> Area:
    return Area(np.zeros(d), np.full(d, SIDE))


def case(name: str, d: int) -> Case:
    """The case of a name in `NAMES`."""
    frame, turns, table = _TABLES[name]
    kind = name.partition("-")[0]
    table = {"period_s": 1.0, **_NOISE[kind], **(_NOISE_3D[kind] if d == 3 else {}), **table}
    for key in ("reach_m", "box_m"):
        if key in table:
            table[key] = table[key][:d]
    if "softmax" in table:
        rows = [row[:d] for row in table["softmax"]["weights"]]
        table["softmax"] = SoftmaxTable(**{**table["softmax"], "weights": rows})
        table["height_angle_deg"] = None
    model = MODELS[kind]
    sensor = model.of(model.Config(**table), area(d))
    low, high = _space(kind, d)
    if kind == "detector":
        high = np.full(1, float(sensor.kinds))
    return Case(f"{name}-{d}D", sensor, low, high, frame, turns)


def _space(kind: str, d: int) -> tuple[FloatArray, FloatArray]:
    angles = np.array([pi, 1.7])[: d - 1]
    if kind == "range_bearing":
        return np.append(0.0, -angles), np.append(42.0, angles)
    if kind == "bearing_only":
        return -angles, angles
    if kind == "range_only":
        return np.full(1, -1.0), np.full(1, 42.0)
    if kind == "position":
        return np.minimum(POSE[:d] - 10.0, -1.0), np.maximum(POSE[:d] + 10.0, SIDE + 1.0)
    return np.ones(1), np.ones(1)


_NOISE: dict[str, dict[str, Any]] = {
    "range_bearing": {"range_sigma_m": 0.4, "bearing_sigma_deg": 4.0, "clutter": 1.5},
    "bearing_only": {},
    "range_only": {},
    "position": {"sigma_m": 0.3, "clutter": 1.5},
    "detector": {"gain": 0.9, "clutter": 0.7},
}
_NOISE_3D: dict[str, dict[str, Any]] = {
    "range_bearing": {"elevation_sigma_deg": 5.0},
    "bearing_only": {"elevation_sigma_deg": 3.0},
    "range_only": {},
    "position": {"height_sigma_m": 0.5},
    "detector": {"height_angle_deg": 60.0},
}
_EXPONENTIAL = {"field_of_view": "exponential", "reach_m": [5.0, 6.0, 4.0]}
_SECTOR = {"field_of_view": "sector", "range_m": 9.0, "angle_deg": 130.0}
_SMOOTH = {"field_of_view": "smooth_sector", "range_m": 6.0, "angle_deg": 130.0}
_BOX = {"field_of_view": "box", "box_m": [(-3.0, 5.0), (-2.0, 6.0), (-4.0, 3.0)]}
_KINDS = {
    "weights": [[0.0, 0.0, 0.0], [0.0, 2.0, 1.0], [1.0, -1.0, 0.5], [1.2, 1.0, -0.5]],
    "biases": [4.0, -3.0, 1.0, -2.0],
    "categories": [0, 1, 2, 1],
}
_TABLES: dict[str, tuple[Frame, bool, dict[str, Any]]] = {
    "range_bearing-exponential": ("world", False, _EXPONENTIAL),
    "range_bearing-sector": ("body", True, {"bearing_frame": "body", **_SECTOR}),
    "range_bearing-smooth": ("world", True, _SMOOTH),
    "bearing_only-paper": ("body", True, {}),
    "bearing_only-gaps": (
        "world",
        True,
        {"bearing_frame": "world", "range_m": 9.0, "beam_separation_deg": 0.6, "bearing_sigma_deg": 6.0},
    ),
    "bearing_only-box": ("world", False, {"bearing_frame": "world", **_BOX}),
    "bearing_only-smooth": ("body", True, {"max_range_m": 9.0, **_SMOOTH}),
    "range_only-paper": ("body", True, {}),
    "range_only-sector": ("body", True, {"range_sigma_m": 0.4, "clutter": 1.5, **_SECTOR}),
    "range_only-exponential": ("body", False, {"range_sigma_m": 0.4, "clutter": 1.5, **_EXPONENTIAL}),
    "position-box": ("map", True, {"box_frame": "body", **_BOX}),
    "position-still": ("map", False, _BOX),
    "position-sector": ("map", True, {"min_range_m": 2.0, **_SECTOR}),
    "position-smooth": ("map", True, _SMOOTH),
    "detector-camera": ("body", True, {"range_m": 8.0, "angle_deg": 80.0}),
    "detector-kinds": ("body", True, {"softmax": _KINDS, "max_range_m": 9.0}),
}
NAMES = list(_TABLES)
