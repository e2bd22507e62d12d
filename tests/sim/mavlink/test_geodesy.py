"""The autopilots' projections against pyproj's ellipsoid and sphere."""

import math

import pytest
from pyproj import Geod

from sim.mavlink.geodesy import Azimuthal, FlatEarth

ORIGIN = (47.397742, 8.545594)
PLACES = [(100.0, 0.0), (0.0, 100.0), (-300.0, 400.0), (5000.0, -3000.0)]


@pytest.mark.parametrize("place", PLACES)
def test_px4s_projection_is_that_of_its_sphere(place: tuple[float, float]) -> None:
    latitude, longitude = Azimuthal(*ORIGIN).to_degrees(*place)
    azimuth, _, distance = Geod(a=6371000.0, b=6371000.0).inv(ORIGIN[1], ORIGIN[0], longitude, latitude)
    assert distance == pytest.approx(math.hypot(*place), abs=1e-3)
    assert math.remainder(math.radians(azimuth) - math.atan2(place[1], place[0]), 2 * math.pi) == (
        pytest.approx(0.0, abs=1e-6)
    )


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("projection", [Azimuthal, FlatEarth])
def test_there_and_back_is_the_same_place_and_near_the_ellipsoids(
    projection: type[Azimuthal] | type[FlatEarth], place: tuple[float, float]
) -> None:
    made = projection(*ORIGIN)
    latitude, longitude = made.to_degrees(*place)
    assert made.to_metres(latitude, longitude) == pytest.approx(place, abs=0.01)
    distance = Geod(ellps="WGS84").inv(ORIGIN[1], ORIGIN[0], longitude, latitude)[2]
    assert distance == pytest.approx(math.hypot(*place), rel=0.004)
