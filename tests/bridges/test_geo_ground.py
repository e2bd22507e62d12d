"""Where robots may be by a hand-made fence, against geometry worked out another way from the same degrees.

Polygons by winding numbers and distances to segments, in metres of an azimuthal equidistant projection; the
reader projects to the plane that touches the earth at the origin.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import Proj

from agents.mission.ground import team_ground
from agents.mission.mission_file import load
from bridges.geo_area import read_geojson, read_plan

LATITUDE, LONGITUDE, ALTITUDE = 47.3977, 8.5456, 488.0
ORIGIN = (LATITUDE, LONGITUDE, ALTITUDE)
METRES = Proj(proj="aeqd", lat_0=LATITUDE, lon_0=LONGITUDE, ellps="WGS84")
RADIUS, CELL = 1.5, 0.5

# In metres east and north of the origin; written to the files in degrees.
OUTER = [(-90, -80), (100, -95), (120, 60), (20, 110), (-100, 70), (-60, 0)]
HOLE = [(-20, -20), (15, -25), (10, 20), (-25, 15)]
PIT = [(50, -60), (80, -60), (80, -30), (65, -45), (50, -30)]  # not convex
POND = (60.0, 30.0, 17.0)
RING = (-40.0, 60.0, 8.0)

MISSION = """
name = "field"
[area]
min = [-60, -60]
max = [60, 60]
[world]
kind = "uniform"
targets = 20
[filter]
kind = "smc_phd"
[planner]
kind = "maasi"
[origin]
latitude = {0}
longitude = {1}
altitude = {2}
[ground]
geofence = [{{ file = "{3}" }}]
robot_radius_m = {4}
resolution_m = {5}
{6}
[[robots]]
id = "r1"
start = [-50, -60]
vehicle = {{ kind = "unicycle" }}
[robots.sensor]
kind = "range_bearing"
period_s = 1
range_sigma_m = 1
bearing_sigma_deg = 1
reach_m = [9, 9]
"""


def degrees(places: list[tuple[float, float]]) -> list[list[float]]:
    """Longitude and latitude."""
    return [list(METRES(x, y, inverse=True)) for x, y in places]


def swapped(places: list[tuple[float, float]]) -> list[list[float]]:
    return [[latitude, longitude] for longitude, latitude in degrees(places)]


def inside(points: np.ndarray, ring: list[tuple[float, float]]) -> np.ndarray:
    """(n,) by the angle that each edge is seen under: all of them go once around a point inside."""
    corners = np.array([*ring, ring[0]], dtype=float)
    gaps = corners[:, None] - points
    turns = np.angle(np.exp(1j * np.diff(np.unwrap(np.arctan2(gaps[..., 1], gaps[..., 0]), axis=0), axis=0)))
    return np.asarray(np.abs(turns.sum(axis=0)) > np.pi)


def away(points: np.ndarray, ring: list[tuple[float, float]]) -> np.ndarray:
    """(n,) metres to the ring's edges."""
    best = np.full(len(points), np.inf)
    for a, b in zip(np.array(ring, dtype=float), np.array([*ring[1:], ring[0]], dtype=float), strict=True):
        share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
    return best


def room(points: np.ndarray, holes: list[Any], discs: list[tuple[float, float, float]]) -> np.ndarray:
    """(n,) metres to where robots may not be; below 0 there."""
    out = np.where(inside(points, OUTER), 1.0, -1.0) * away(points, OUTER)
    for ring in holes:
        out = np.minimum(out, np.where(inside(points, ring), -1.0, 1.0) * away(points, ring))
    for x, y, radius in discs:
        out = np.minimum(out, np.hypot(points[:, 0] - x, points[:, 1] - y) - radius)
    return out


def geojson() -> dict[str, Any]:
    close = [OUTER[0]]
    polygon = {"type": "Polygon", "coordinates": [degrees([*OUTER, *close]), degrees([*HOLE, HOLE[0]])]}
    return {"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": polygon}]}


def plan() -> dict[str, Any]:
    discs = [
        {"circle": {"center": swapped([disc[:2]])[0], "radius": disc[2]}, "inclusion": False}
        for disc in (POND, RING)
    ]
    polygons = [
        {"inclusion": True, "polygon": swapped(OUTER)},
        {"inclusion": False, "polygon": swapped(HOLE)},
        {"inclusion": False, "polygon": swapped(PIT)},
    ]
    return {
        "fileType": "Plan",
        "geoFence": {"circles": discs, "polygons": polygons},
        "mission": {"items": []},
    }


@pytest.mark.parametrize("kind", ["geojson", "plan"])
def test_robots_may_be_where_the_file_lets_them_with_room_for_their_radius(kind: str, tmp_path: Path) -> None:
    keep_out, holes, discs = "", [HOLE], []
    if kind == "plan":
        table, holes, discs = plan(), [HOLE, PIT], [POND, RING]
    else:  # the other zones from a file of their own
        table, holes = geojson(), [HOLE, PIT]
        pit = {"type": "Polygon", "coordinates": [degrees([*PIT, PIT[0]])]}
        (tmp_path / "pit.geojson").write_text(json.dumps(pit))
        keep_out = 'keep_out = [{ file = "pit.geojson" }]'
    (tmp_path / f"field.{kind}").write_text(json.dumps(table))
    text = MISSION.format(*ORIGIN, f"field.{kind}", RADIUS, CELL, keep_out)
    (tmp_path / "m.toml").write_text(text)
    ground = team_ground(load(tmp_path / "m.toml")).ground
    assert ground is not None
    points = np.random.default_rng(1).uniform([-110, -105], [130, 120], (20_000, 2))
    clear, metres = ground.clear(np.ascontiguousarray(points.T)), room(points, holes, discs)
    # The two projections differ by millimetres here, and a cell is clear only if all of it is.
    assert metres[clear].min() >= RADIUS - 0.02
    assert clear[metres >= RADIUS + 1.5 * np.sqrt(2.0) * CELL + 0.02].all()
    assert 0.3 < clear.mean() < 0.8


def test_shapes_are_those_of_the_files(tmp_path: Path) -> None:
    (tmp_path / "a.geojson").write_text(json.dumps(geojson()))
    (tmp_path / "a.plan").write_text(json.dumps(plan()))
    (field,) = read_geojson(tmp_path / "a.geojson", ORIGIN)
    zones = read_plan(tmp_path / "a.plan", ORIGIN)
    assert [zone.role for zone in zones] == ["inside", "outside", "outside", "outside", "outside"]
    points = np.random.default_rng(2).uniform([-110, -105], [130, 120], (5000, 2))
    columns = np.ascontiguousarray(points.T)
    far = np.abs(room(points, [HOLE], [])) > 0.02
    within = inside(points, OUTER) & ~inside(points, HOLE)
    np.testing.assert_array_equal(field.shape.contains(columns)[far], within[far])
    rings, discs = (OUTER, HOLE, PIT), (POND, RING)
    for zone, ring in zip(zones[:3], rings, strict=True):
        off = away(points, ring) > 0.02
        np.testing.assert_array_equal(zone.shape.contains(columns)[off], inside(points, ring)[off])
        np.testing.assert_allclose(np.abs(zone.shape.distances(columns)), away(points, ring), atol=0.02)
    for zone, (x, y, radius) in zip(zones[3:], discs, strict=True):
        expected = np.hypot(points[:, 0] - x, points[:, 1] - y) - radius
        np.testing.assert_allclose(zone.shape.distances(columns), expected, atol=0.02)
