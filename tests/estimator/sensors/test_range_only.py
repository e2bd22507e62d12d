"""The range-only sensor against Dames & Kumar 2015 section V-E."""

import numpy as np
import pytest

from estimator.filter import Area
from estimator.sensors.range_only import RangeOnly

POSE = np.array([3.0, 2.0, 1.0, 0.7])


def radio(d: int = 2, **table: object) -> RangeOnly:
    return RangeOnly.of(RangeOnly.Config(period_s=1.0, **table), Area(np.zeros(d), np.full(d, 30.0)))


@pytest.mark.parametrize("d", [2, 3])
def test_detection_decays_steadily_to_nothing_at_five_metres(d: int) -> None:
    ranges = np.array([0.0, 1.0, 2.5, 4.0, 4.999, 6.0])
    points = POSE[:d, None] + np.eye(d)[:, [d - 1]] * ranges
    expected = np.maximum(1.0 - ranges / 5.0, 0.0)
    assert radio(d).detection(points, POSE)[0] == pytest.approx(expected)


def test_a_table_over_the_range_replaces_the_decay() -> None:
    sensor = radio(range_breaks_m=[0.0], range_gains=[0.6])
    assert sensor.detection(POSE[:2, None] + np.array([[4.0], [0.0]]), POSE)[0, 0] == pytest.approx(0.6)


def test_clutter_is_even_over_the_reach_and_noise_is_a_metre() -> None:
    z = np.array([[-0.1], [0.1], [4.9], [5.1]])
    assert radio().clutter_intensity(z, POSE) == pytest.approx([0.0, 0.02, 0.02, 0.0])
    assert radio().noise.tolist() == [[1.0]]


@pytest.mark.parametrize("d", [2, 3])
def test_a_range_all_around_has_the_robot_as_its_place_and_the_ring_as_its_spread(d: int) -> None:
    z, sensor = np.array([[3.0]]), radio(d, range_sigma_m=0.1)
    assert sensor.locate(z, POSE)[:, 0] == pytest.approx(POSE[:d], abs=0.02)
    spread = sensor.location_covariance(z, POSE)[0]
    assert spread == pytest.approx((9.0 + 0.01) / d * np.eye(d), abs=0.03)


def test_a_negative_range_is_a_measurement_like_any_other() -> None:
    sensor, z = radio(), np.array([[-0.5]])
    look = sensor.look(POSE[:2, None], POSE, z)
    assert look.likelihood == pytest.approx([np.exp(-0.125) / np.sqrt(2 * np.pi)])
    assert sensor.locate(z, POSE)[:, 0] == pytest.approx(POSE[:2])
