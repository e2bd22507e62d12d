"""The sensors that a mission can name: model and simulated device from the same table."""

from typing import Any

import numpy as np
import pytest

from agents import plugins
from agents.devices import DeviceContext
from agents.mission.tables import convert
from estimator.filter import Area

AREA = Area(np.zeros(2), np.full(2, 20.0))
TABLES: dict[str, dict[str, Any]] = {
    "range_bearing": {"range_sigma_m": 0.5, "bearing_sigma_deg": 1.0, "reach_m": [9, 9]},
    "bearing_only": {},
    "range_only": {},
    "position": {"sigma_m": 0.2, "box_m": [[-4, 4], [-4, 4]]},
    "detector": {"range_m": 6.0, "angle_deg": 90.0, "clutter": 0.2},
}


class Somewhere:
    def targets(self, time: float) -> np.ndarray:
        return np.array([[11.0, 12.0], [10.5, 9.0]])


@pytest.mark.parametrize("name", TABLES)
def test_a_named_sensor_measures_as_its_model_says_and_by_its_seed(name: str) -> None:
    kind = plugins.load("sensors", name)
    config = convert({"period_s": 0.5, **TABLES[name]}, kind.Config)
    model, pose = kind.model(config, AREA), np.array([10.0, 10.0, 0.0, 0.0])

    def sets(seed: int) -> list[np.ndarray]:
        context = DeviceContext(robot="r1", seed=seed, area=AREA, world=Somewhere(), start=pose)
        device = kind.device(config, context)
        return [device.measure(float(k), pose) for k in range(60)]

    first = sets(1)
    assert all(z.shape == (len(z), model.measurement_size) for z in first)
    expected = 60 * (model.detection(Somewhere().targets(0.0), pose).sum() + model.clutter)
    assert abs(sum(map(len, first)) - expected) < 5 * np.sqrt(expected)
    assert all(np.array_equal(a, b) for a, b in zip(first, sets(1), strict=True))
    assert any(not np.array_equal(a, b) for a, b in zip(first, sets(2), strict=True))
