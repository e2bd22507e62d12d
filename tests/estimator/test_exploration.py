"""The exploration function, (MA)ASI (20), (30)."""

import numpy as np
import pytest

from estimator.exploration import Exploration
from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing

AREA = Area(np.array([0.0, -10.0]), np.array([40.0, 30.0]))
SENSOR = RangeBearing.of(
    RangeBearing.Config(
        period_s=1.0, range_sigma_m=0.5, bearing_sigma_deg=1.0, reach_m=[8.0, 12.0], gain=0.9
    ),
    AREA,
)
POSES = np.array([[3.0, 4.0, 9.0, 0.0], [30.0, 20.0, 9.0, 1.0], [18.0, 2.0, 9.0, 2.0]])


def explicit(poses: np.ndarray) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0.0, 40.0, 9), np.linspace(-10.0, 30.0, 11), indexing="ij")
    e = np.ones((9, 11))
    for q in poses:
        e *= 1.0 - 0.9 * np.exp(-np.hypot((x - q[0]) / 8.0, (y - q[1]) / 12.0) / 2.0)
    return e


def test_nothing_is_explored_at_the_start() -> None:
    assert (Exploration.unexplored(AREA, [9, 11]).values == 1.0).all()


def test_each_look_multiplies_by_what_it_would_miss() -> None:
    after = Exploration.unexplored(AREA, [9, 11]).after(SENSOR, POSES)
    assert np.allclose(after.values, explicit(POSES), rtol=1e-11)


def test_the_order_of_looks_does_not_matter() -> None:
    start = Exploration.unexplored(AREA, [9, 11])
    one_by_one = start
    for pose in POSES[::-1]:
        one_by_one = one_by_one.after(SENSOR, pose)
    assert np.allclose(one_by_one.values, start.after(SENSOR, POSES).values, rtol=1e-13)


def test_no_look_changes_nothing_and_the_old_function_is_kept() -> None:
    start = Exploration.unexplored(AREA, [9, 11])
    assert start.after(SENSOR, np.zeros((0, 4))) is start
    start.after(SENSOR, POSES)
    assert (start.values == 1.0).all()


def test_values_between_grid_points_are_interpolated() -> None:
    after = Exploration.unexplored(AREA, [9, 11]).after(SENSOR, POSES)
    middle = np.array([[2.5], [-8.0]])
    assert after.at(middle)[0] == pytest.approx(after.values[:2, :2].mean())


@pytest.mark.parametrize("points", [[9], [9, 11, 3], [0, 4]])
def test_a_grid_that_does_not_fit_the_area_is_refused(points: list[int]) -> None:
    with pytest.raises(ValueError, match="points"):
        Exploration.unexplored(AREA, points)
