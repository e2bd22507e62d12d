"""The position sensor's table and footprint; the rest is the contract's."""

from typing import Any

import numpy as np
import pytest

from estimator.filter import Area
from estimator.sensors.position import Position

POSE = np.array([3.0, 2.0, 1.0, np.pi / 2])


def camera(d: int = 2, **table: Any) -> Position:
    config = Position.Config(period_s=1.0, sigma_m=0.1, **table)
    return Position.of(config, Area(np.zeros(d), np.full(d, 30.0)))


@pytest.mark.parametrize(("frame", "seen"), [("world", [1.0, 0.0]), ("body", [0.0, 1.0])])
def test_an_off_centre_footprint_turns_with_the_robot_or_not(frame: str, seen: list[float]) -> None:
    sensor = camera(box_m=[(0.0, 2.0), (-1.0, 1.0)], box_frame=frame)
    east_and_north = POSE[:2, None] + np.array([[1.5, 0.0], [0.0, 1.5]])
    assert sensor.detection(east_and_north, POSE)[0].tolist() == seen


def test_a_footprint_in_three_dimensions_has_a_floor() -> None:
    sensor = camera(3, height_sigma_m=0.2, box_m=[(-1.0, 1.0), (-1.0, 1.0), (-1.0, 0.0)])
    below_and_above = POSE[:3, None] + np.array([[0.0, 0.0], [0.0, 0.0], [-0.5, 0.5]])
    assert sensor.detection(below_and_above, POSE)[0].tolist() == [1.0, 0.0]
    assert np.diag(sensor.noise) == pytest.approx([0.01, 0.01, 0.04])


@pytest.mark.parametrize(
    ("d", "table", "key"),
    [
        (3, {"box_m": [(-1.0, 1.0)] * 3}, "height_sigma_m"),
        (2, {"box_m": [(-1.0, 1.0)] * 2, "height_sigma_m": 1.0}, "height_sigma_m"),
        (2, {}, "box_m"),
    ],
)
def test_a_table_that_does_not_fit_is_refused_by_key(d: int, table: dict[str, Any], key: str) -> None:
    with pytest.raises(ValueError, match=key):
        camera(d, **table)
