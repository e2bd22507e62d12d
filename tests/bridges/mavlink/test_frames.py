"""The team's frame against pyproj, and local NED against what the two autopilots make of degrees."""

import math

import numpy as np
import pytest
from pyproj import Geod, Transformer

from bridges.geo_area import projection
from bridges.mavlink.frames import LocalFrame, TeamFrame, swapped, turned
from sim.mavlink.geodesy import Azimuthal, FlatEarth

PLACES = [(47.397742, 8.545594, 488.0), (-33.9, 151.2, 20.0), (0.0, 0.0, 0.0), (69.6, -18.9, 5.0)]


def topocentric(zero: tuple[float, float, float]) -> Transformer:
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 +step "
        f"+proj=topocentric +ellps=WGS84 +lon_0={zero[1]} +lat_0={zero[0]} +h_0={zero[2]}"
    )


@pytest.mark.parametrize("zero", PLACES)
@pytest.mark.parametrize("seed", range(3))
def test_east_and_north_are_those_of_pyproj(zero: tuple[float, float, float], seed: int) -> None:
    rng, frame, proj = np.random.default_rng(seed), TeamFrame(zero), topocentric(zero)
    for _ in range(20):
        latitude = zero[0] + rng.uniform(-0.04, 0.04)
        longitude = zero[1] + rng.uniform(-0.04, 0.04)
        ours = frame.from_degrees((latitude, longitude, zero[2] + 30.0))
        east, north, _ = proj.transform(longitude, latitude, zero[2])
        assert ours == pytest.approx([east, north, 30.0], abs=1e-6), f"seed {seed}, {zero}"


@pytest.mark.parametrize("zero", PLACES)
@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (10.0, -20.0, 3.0)])
def test_degrees_and_back_is_the_same_place(
    zero: tuple[float, float, float], at: tuple[float, float, float]
) -> None:
    frame = TeamFrame(zero, at)
    for point in ([0, 0, 0], [1500, -2500, 60], [-4000, 10, -3]):
        assert frame.from_degrees(frame.to_degrees(np.array(point, float))) == pytest.approx(point, abs=1e-6)


def test_areas_in_degrees_and_vehicles_share_one_frame() -> None:
    zero = PLACES[0]
    corner = (zero[1] + 0.01, zero[0] - 0.02)
    area = projection(zero)(np.array([corner]))[0]
    assert TeamFrame(zero).from_degrees((corner[1], corner[0], zero[2]))[:2] == pytest.approx(area, abs=1e-6)


def test_a_hundred_metres_are_a_hundred_metres_on_the_ellipsoid() -> None:
    latitude, longitude, altitude = TeamFrame(PLACES[0]).to_degrees(np.array([60.0, 80.0, 12.0]))
    _, _, length = Geod(ellps="WGS84").inv(PLACES[0][1], PLACES[0][0], longitude, latitude)
    # at 488 m above the ellipsoid the ground below is shorter by 488 m in 6,371 km
    assert length * (1 + 488 / 6371000) == pytest.approx(100.0, abs=1e-3)
    assert altitude == pytest.approx(500.0)


@pytest.mark.parametrize("autopilot", ["ArduPilot", "PX4"])
@pytest.mark.parametrize("zero", PLACES)
def test_a_setpoint_is_where_the_autopilot_takes_it_for(
    zero: tuple[float, float, float], autopilot: str
) -> None:
    """The autopilot turns NED into degrees in its own way; what it then flies to is the team's place."""
    origin = (zero[0] + 0.001, zero[1] - 0.002, zero[2] + 7.0)
    local = LocalFrame(TeamFrame(zero), origin, autopilot)
    its = Azimuthal(*origin[:2]) if autopilot == "PX4" else FlatEarth(*origin[:2])
    for place in ([0.0, 0.0, 10.0], [250.0, -400.0, 30.0], [-900.0, 900.0, 0.0]):
        ned = local.to_ned(np.array(place))
        latitude, longitude = its.to_degrees(ned[0], ned[1])
        east, north, _ = topocentric(zero).transform(longitude, latitude, zero[2])
        assert [east, north] == pytest.approx(place[:2], abs=1e-4)
        assert origin[2] - ned[2] == pytest.approx(zero[2] + place[2])
        assert local.to_team(ned) == pytest.approx(place, abs=1e-4)


def test_a_plane_of_its_own_would_miss_by_decimetres() -> None:
    """Why the autopilot's sphere is reckoned with: 100 m north of its origin ArduPilot is 12 cm off here."""
    local = LocalFrame(TeamFrame(PLACES[0]), PLACES[0], "ArduPilot")
    assert 0.1 < abs(local.to_ned(np.array([0.0, 100.0, 0.0]))[0] - 100.0) < 0.2
    far = LocalFrame(TeamFrame(PLACES[2]), PLACES[2], "ArduPilot").to_ned(np.array([0.0, 100.0, 0.0]))
    assert 0.6 < abs(far[0] - 100.0) < 0.7


def test_axes_and_yaw_are_swapped_both_ways() -> None:
    assert swapped(np.array([1.0, 2.0, 3.0])) == pytest.approx([2.0, 1.0, -3.0])
    assert swapped(swapped(np.array([1.0, 2.0, 3.0]))) == pytest.approx([1.0, 2.0, 3.0])
    assert turned(0.0) == pytest.approx(math.pi / 2)  # north
    assert turned(math.pi / 2) == pytest.approx(0.0)  # east
    assert abs(turned(-math.pi / 2)) == pytest.approx(math.pi)  # west
    assert turned(turned(0.3)) == pytest.approx(0.3)
