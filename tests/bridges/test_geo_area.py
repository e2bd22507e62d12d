"""Areas on the earth against pyproj's geodesics, and what a wrong file is told."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import Geod

from agents.errors import DataError, MissionError
from agents.mission.ground import team_ground
from agents.mission.mission_file import load
from bridges.geo_area import projection, read_geojson, read_plan

ORIGIN = (47.3977, 8.5456, 488.0)
SQUARE = [[8.545, 47.397], [8.547, 47.397], [8.547, 47.399], [8.545, 47.399], [8.545, 47.397]]
PLAN: dict[str, Any] = {
    "fileType": "Plan",
    "geoFence": {
        "circles": [
            {"circle": {"center": [47.398, 8.546], "radius": 12.5}, "inclusion": False, "version": 1}
        ],
        "polygons": [{"inclusion": True, "polygon": [[y, x] for x, y in SQUARE[:4]], "version": 1}],
        "version": 2,
    },
    "mission": {
        "items": [
            {"type": "SimpleItem", "command": 22},
            {
                "type": "ComplexItem",
                "complexItemType": "survey",
                "polygon": [[47.3972, 8.5452], [47.3972, 8.5468], [47.3988, 8.546]],
            },
        ]
    },
    "rallyPoints": {"points": []},
}


def write(tmp_path: Path, table: Any, name: str = "a.geojson") -> Path:
    file = tmp_path / name
    file.write_text(table if isinstance(table, str) else json.dumps(table))
    return file


@pytest.mark.parametrize("azimuth", [0.0, 37.0, 90.0, 200.0, 301.0])
@pytest.mark.parametrize("metres", [1.0, 500.0, 5000.0])
def test_places_lie_where_geodesics_from_the_origin_lead(azimuth: float, metres: float) -> None:
    latitude, longitude, _ = ORIGIN
    there = Geod(ellps="WGS84").fwd(longitude, latitude, azimuth, metres)
    found = projection((latitude, longitude, 0.0))(np.array([[there[0], there[1]]]))[0]
    expected = metres * np.array([np.sin(np.radians(azimuth)), np.cos(np.radians(azimuth))])
    np.testing.assert_allclose(found, expected, atol=1e-3 * (metres / 5000) + 1e-8)


def test_a_polygon_with_a_hole_is_read_from_geojson(tmp_path: Path) -> None:
    hole = [[8.5455, 47.3975], [8.5465, 47.3975], [8.546, 47.3985]]
    feature = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "Polygon", "coordinates": [SQUARE, hole]},
    }
    more = {"type": "MultiPolygon", "coordinates": [[[[x + 0.01, y] for x, y in SQUARE]]]}
    table = {"type": "FeatureCollection", "features": [feature, {"type": "Feature", "geometry": more}]}
    first, second = read_geojson(write(tmp_path, table), ORIGIN)
    area, _ = Geod(ellps="WGS84").polygon_area_perimeter(*zip(*SQUARE, strict=True))
    edges = first.shape.edges[:4]
    enclosed = 0.5 * abs(np.sum(edges[:, 0] * edges[:, 3] - edges[:, 2] * edges[:, 1]))
    assert enclosed == pytest.approx(abs(area), rel=2e-4)  # 488 m above the ellipsoid all is that much larger
    inside, in_hole = projection(ORIGIN)(np.array([[8.5452, 47.3972], [8.546, 47.398]]))
    assert first.shape.contains(np.stack([inside, in_hole], axis=1)).tolist() == [True, False]
    assert not second.shape.contains(inside[:, None])[0]
    assert second.name == "features[1].geometry.coordinates[0]"


def test_a_plans_fence_exclusions_and_surveys_are_read(tmp_path: Path) -> None:
    fence, circle, survey = read_plan(write(tmp_path, PLAN, "a.plan"), ORIGIN)
    assert [fence.role, circle.role, survey.role] == ["inside", "outside", "area"]
    np.testing.assert_allclose(circle.shape.circle[:2], projection(ORIGIN)(np.array([[8.546, 47.398]]))[0])
    assert circle.shape.circle[2] == 12.5
    assert fence.shape.contains(survey.shape.edges[:, :2].T).all()


def broken(**change: Any) -> dict[str, Any]:
    table: dict[str, Any] = json.loads(json.dumps(PLAN))
    table["geoFence"]["polygons"][0].update(change)
    return table


BOW = [SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3], SQUARE[0]]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("{", "is not JSON"),
        ("[]", "expected an object"),
        ({"type": "Point", "coordinates": [8, 47]}, 'type: expected Polygon.*found "Point"'),
        ({"type": "FeatureCollection", "features": []}, "at least one Polygon"),
        (
            {"type": "Polygon", "coordinates": [SQUARE[:2]]},
            r"coordinates\[0\]: expected a list of at least 3",
        ),
        (
            {"type": "Polygon", "coordinates": [[[8, 95], *SQUARE]]},
            r"coordinates\[0\]\[0\]: expected longitude",
        ),
        (
            {"type": "Polygon", "coordinates": [[["a", 4], *SQUARE]]},
            r"coordinates\[0\]\[0\]: expected longitude",
        ),
        ({"type": "Polygon", "coordinates": [BOW]}, "intersects itself near"),
        ({"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1]]]}, "near the mission's origin"),
        ({"type": "Feature", "geometry": None}, "geometry: expected an object, found nothing"),
    ],
)
def test_a_wrong_geojson_is_told_with_file_and_key(tmp_path: Path, table: Any, words: str) -> None:
    with pytest.raises(DataError, match=words) as told:
        read_geojson(write(tmp_path, table), ORIGIN)
    assert "a.geojson" in str(told.value)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"fileType": "Mission"}, 'fileType: expected "Plan", found "Mission"'),
        ({"fileType": "Plan"}, "expected a geofence or a survey"),
        ({"fileType": "Plan", "geoFence": 3}, "geoFence: expected an object"),
        (broken(inclusion="yes"), r"geoFence.polygons\[0\].inclusion: expected true or false"),
        (broken(polygon=[[47, 8]]), r"geoFence.polygons\[0\].polygon: expected a list of at least 3"),
        (broken(polygon=[[147.0, 8.5]] * 3), r"polygon\[0\]: expected latitude, longitude"),
    ],
)
def test_a_wrong_plan_is_told_with_file_and_key(tmp_path: Path, table: Any, words: str) -> None:
    with pytest.raises(DataError, match=words):
        read_plan(write(tmp_path, table, "a.plan"), ORIGIN)


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"none\.plan cannot be read"):
        read_plan(tmp_path / "none.plan", ORIGIN)


MISSION = """
name = "field"
[area]
min = [-50, -80]
max = [100, 140]
[world]
kind = "uniform"
targets = 20
[filter]
kind = "smc_phd"
[planner]
kind = "maasi"
[[robots]]
id = "r1"
start = [-30, -60]
vehicle = { kind = "unicycle" }
sensor = { kind = "range_bearing", period_s = 1, range_sigma_m = 1, bearing_sigma_deg = 1, reach_m = [9, 9] }
"""
PLACE = "[origin]\nlatitude = 47.3977\nlongitude = 8.5456\naltitude = 488\n"


def mission(tmp_path: Path, *tables: str) -> Path:
    write(tmp_path, PLAN, "field.plan")
    write(tmp_path, {"type": "Polygon", "coordinates": [SQUARE]}, "field.geojson")
    return write(tmp_path, MISSION + "".join(tables), "m.toml")


def test_a_missions_fence_comes_from_a_plan(tmp_path: Path) -> None:
    made = team_ground(load(mission(tmp_path, PLACE, '[ground]\ngeofence = [{ file = "field.plan" }]\n')))
    assert made.ground is not None
    circle, beyond = projection(ORIGIN)(np.array([[8.546, 47.398], [8.5475, 47.398]]))
    points = np.stack([circle, beyond, [-30.0, -60.0]], axis=1)
    assert made.ground.clear(points).tolist() == [False, False, True]
    assert made.area.is_free(points).tolist() == [True, False, True]  # one may look into an exclusion


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        (
            ['[ground]\ngeofence = [{ file = "field.plan" }]\n'],
            r"origin: found nothing, but ground.geofence\[0\]",
        ),
        ([PLACE, '[ground]\nkeep_out = [{ file = "x.shp" }]\n'], r"ground.keep_out\[0\].file: found .*x.shp"),
        (
            [PLACE, '[ground]\nobstacles = [{ file = "x.geojson" }]\n'],
            r"ground.obstacles\[0\].file: .*x.geojson cannot",
        ),
        (
            ["[ground]\nobstacles = [{ polygon = [[0, 0], [9, 9], [9, 0], [0, 9]] }]\n"],
            r"obstacles\[0\].polygon: it inter",
        ),
        (
            ["[ground]\nobstacles = [{ circle = [-30, -60, 5] }]\n"],
            r"robots\[0\].start: .*outside of obstacles",
        ),
        (["[ground]\ngeofence = [{ circle = [500, 500, 9] }]\n"], r"robots\[0\].start: .*inside the fence"),
        (["[ground]\nkeep_out = [{ circle = [0, 0, -1] }]\n"], r"keep_out\[0\].circle: .*radius > 0"),
        (["[ground]\nkeep_out = [{ circle = [0, 0, 1], altitude = [3, 2] }]\n"], r"keep_out\[0\].altitude: "),
        (["[ground]\naltitude_m = [3, 2]\n"], "ground.altitude_m: "),
        (["[ground]\nresolution_m = 0.001\n"], "ground.resolution_m: "),
    ],
)
def test_a_wrong_ground_is_told_with_its_key(tmp_path: Path, tables: list[str], words: str) -> None:
    made = load(mission(tmp_path, *tables))
    with pytest.raises((MissionError, DataError), match=words):
        team_ground(made)


def test_a_zone_is_exactly_one_thing(tmp_path: Path) -> None:
    both = '[ground]\nkeep_out = [{ circle = [0, 0, 1], file = "field.plan" }]\n'
    with pytest.raises(MissionError, match="exactly one of polygon, circle and file; found circle and file"):
        load(mission(tmp_path, both))
