import msgspec
import numpy as np
import pytest

from estimator.filter import Area
from planner.maasi.candidates import CandidateGrid


def test_paper_grid_has_27_places_80_metres_apart():
    places = CandidateGrid(low=[10, 10, 10], high=[170, 170, 170], points=[3, 3, 3]).waypoints(55.0)
    assert places.shape == (27, 3)
    assert set(places.ravel()) == {10.0, 90.0, 170.0}
    assert len({tuple(place) for place in places}) == 27


def test_grid_of_two_axes_lies_at_the_altitude_of_the_robot():
    places = CandidateGrid(low=[0, 0], high=[2, 4], points=[2, 3]).waypoints(7.0)
    assert places.tolist() == [[0, 0, 7], [0, 2, 7], [0, 4, 7], [2, 0, 7], [2, 2, 7], [2, 4, 7]]


def test_single_point_is_in_the_middle():
    assert CandidateGrid(low=[0, 0], high=[2, 4], points=[1, 1]).waypoints(0.0).tolist() == [[1, 2, 0]]


@pytest.mark.parametrize("side", [1e-9, 1.0, 1e6])
def test_grid_over_an_area_lies_inside_it(side):
    area = Area(np.array([-1.0, 5.0]), np.array([-1.0, 5.0]) + side)
    places = CandidateGrid.over(area, 4).waypoints(0.0)
    assert places.shape == (16, 3)
    assert (places[:, :2] >= area.low).all()
    assert (places[:, :2] <= area.high).all()


@pytest.mark.parametrize(
    ("table", "named"),
    [
        ({"low": [0, 0], "high": [1, 1, 1], "points": [2, 2]}, "one number per axis"),
        ({"low": [0, 2], "high": [1, 1], "points": [2, 2]}, "low"),
        ({"low": [0, float("nan")], "high": [1, 1], "points": [2, 2]}, "finite"),
        ({"low": [0, 0], "high": [1, 1], "points": [2, 0]}, "points"),
        ({"low": [0, 0], "high": [1, 1], "points": [2, 2], "step": 1}, "step"),
    ],
)
def test_wrong_grid_is_refused_by_name(table, named):
    with pytest.raises(msgspec.ValidationError, match=named):
        msgspec.convert(table, CandidateGrid)
