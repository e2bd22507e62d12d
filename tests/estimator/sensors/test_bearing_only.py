"""The bearing-only sensor against the numbers of Dames & Kumar 2015 section IV-A."""

from math import pi
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from estimator.filter import Area
from estimator.sensors.bearing_only import BearingOnly

POSE = np.array([3.0, 2.0, 0.0, 0.7])


def laser(d: int = 2, **table: Any) -> BearingOnly:
    return BearingOnly.of(BearingOnly.Config(period_s=1.0, **table), Area(np.zeros(d), np.full(d, 30.0)))


def at(ranges: list[float], degrees: list[float]) -> np.ndarray:
    turn = np.radians(degrees) + POSE[3]
    return POSE[:2, None] + np.array(ranges) * np.stack([np.cos(turn), np.sin(turn)])


def test_the_papers_laser_misses_a_fifth_within_five_metres_and_three_quarters_of_a_turn() -> None:
    points = at([0.5, 4.9, 5.1, 3.0, 3.0, 3.0], [0.0, 90.0, 0.0, 134.0, 136.0, -134.0])
    assert laser().detection(points, POSE)[0] == pytest.approx([0.79, 0.79, 0.0, 0.79, 0.0, 0.79])


def test_targets_slip_between_beams_further_off_than_their_width_over_the_beams_angle() -> None:
    ranges, separation = [0.5, 1.0, 1.8, 2.0, 4.0], np.radians(1.0)
    expected = [0.79 * min(1.0, 0.0325 / (r * separation)) for r in ranges]  # (29)
    sensor = laser(beam_separation_deg=1.0)
    assert sensor.detection(at(ranges, [10.0] * 5), POSE)[0] == pytest.approx(expected)
    assert expected[0] == 0.79 > expected[3]
    assert laser(beam_separation_deg=0.0).detection(at([4.0], [0.0]), POSE)[0, 0] == pytest.approx(0.79)


@pytest.mark.parametrize("frame", ["body", "world"])
def test_clutter_is_even_with_peaks_at_both_sides_of_the_robot(frame: str) -> None:
    sensor = laser(bearing_frame=frame)
    turn = 0.0 if frame == "body" else POSE[3]

    def c(degrees: float) -> float:
        return float(sensor.clutter_intensity(np.array([[np.radians(degrees) + turn]]), POSE)[0])

    even, peak = 0.725 * 0.532 / (1.5 * pi), 0.275 * 0.532 / (2 * 0.2 * pi)  # (31)
    assert [c(x) for x in (0.0, 71.0, 109.0, -134.0)] == pytest.approx([even] * 4)
    assert [c(x) for x in (90.0, -90.0, 73.0, -107.0)] == pytest.approx([even + peak] * 4)
    assert [c(x) for x in (136.0, 180.0, -170.0)] == [0.0] * 3
    edges = [x for s in (-1, 1) for x in (s * 72, s * 108, s * 135)]
    assert quad(c, -180, 180, points=edges)[0] * pi / 180 == pytest.approx(0.532, rel=1e-6)


def test_a_measurement_says_that_a_target_is_on_a_ray_as_far_as_the_sensor_reaches() -> None:
    place = laser().locate(np.zeros((1, 1)), POSE)[:, 0]
    spread = laser().location_covariance(np.zeros((1, 1)), POSE)[0]
    along = np.array([np.cos(POSE[3]), np.sin(POSE[3])])
    aside = np.array([-along[1], along[0]])
    # the density over the range is r on 0..5: mean 2/3 5, variance 5^2 / 18, mean square 5^2 / 2
    assert place == pytest.approx(POSE[:2] + 10.0 / 3.0 * along, abs=0.01)
    assert along @ spread @ along == pytest.approx(25.0 / 18.0, rel=0.01)
    assert aside @ spread @ aside == pytest.approx(12.5 * np.radians(2.25) ** 2, rel=0.01)
    assert abs(along @ spread @ aside) < 1e-12


def test_a_bearing_at_which_nothing_is_ever_detected_has_a_place_on_its_ray_all_the_same() -> None:
    behind = laser().locate(np.array([[pi]]), POSE)[:, 0] - POSE[:2]
    assert np.arctan2(behind[1], behind[0]) == pytest.approx(POSE[3] - pi)
    assert np.hypot(*behind) == pytest.approx(10.0 / 3.0, abs=0.01)


@pytest.mark.parametrize(
    ("d", "table", "key"),
    [
        (3, {}, "elevation_sigma_deg"),
        (2, {"elevation_sigma_deg": 1.0}, "elevation_sigma_deg"),
        (2, {"angle_deg": 90.0}, "clutter_uniform"),
        (2, {"field_of_view": "exponential"}, "reach_m"),
    ],
)
def test_a_table_that_does_not_fit_is_refused_by_key(d: int, table: dict[str, Any], key: str) -> None:
    with pytest.raises(ValueError, match=key):
        laser(d, **table)


def test_a_narrow_opening_is_fine_without_peaks() -> None:
    assert laser(angle_deg=90.0, clutter_uniform=1.0).opening == pytest.approx(pi / 2)
