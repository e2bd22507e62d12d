"""Read areas on the earth into the team's frame: GeoJSON polygons and QGroundControl's .plan files.

Both give places in degrees of WGS 84. They are projected into the plane that touches the earth at the team's
origin, metres east and north, by pyproj. A place 5 km away then lies half a millimetre nearer than along the
earth's surface.

GeoJSON (RFC 7946): every Polygon and MultiPolygon, within features and collections, is an area; holes are cut
GeoJSON (RFC 7946): every Polygon and MultiPolygon within features and collections is an area; holes are cut
the polygons of surveys are areas to search, and serve as a fence where the file has no inclusion.
"""

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from agents.errors import DataError
from estimator.arrays import FloatArray
from planner.ground.shapes import Role, Shape, Zone

Origin = tuple[float, float, float]  # latitude, longitude in degrees, altitude in metres above the ellipsoid
Project = Callable[[FloatArray], FloatArray]  # (n, 2) longitude, latitude -> (n, 2) east, north
MAX_BYTES = 50_000_000


def read_geojson(file: Path, origin: Origin) -> tuple[Zone, ...]:
    """The polygons of a GeoJSON file, in metres from the origin.

    Raises:
        DataError: if the file is missing or wrong; names it, and the key.
    """
    table, project = _load(file), projection(origin)
    zones = []
    for key, polygon in _polygons(file, table, ""):
        rings = [_ring(file, f"{key}[{i}]", ring, project, swapped=False) for i, ring in enumerate(polygon)]
        zones.append(Zone(_shape(file, key, rings), "inside", key))
    if not zones:
        raise DataError(f"{file}: expected at least one Polygon or MultiPolygon, found none")
    return tuple(zones)


def read_plan(file: Path, origin: Origin) -> tuple[Zone, ...]:
    """The geofence and the survey areas of a QGroundControl .plan file, in metres from the origin.

    Raises:
        DataError: if the file is missing or wrong; names it, and the key.
    """
    table, project = _load(file), projection(origin)
    if table.get("fileType") != "Plan":
        raise DataError(f'{file}: fileType: expected "Plan", found {_show(table.get("fileType"))}')
    fence = _table(file, table, "geoFence")
    zones = []
    for i, entry in enumerate(_list(file, fence, "geoFence.polygons")):
        key = f"geoFence.polygons[{i}]"
        ring = _ring(file, f"{key}.polygon", _entry(file, key, entry, "polygon"), project, swapped=True)
        zones.append(Zone(_shape(file, key, [ring]), _role(file, key, entry), key))
    for i, entry in enumerate(_list(file, fence, "geoFence.circles")):
        key = f"geoFence.circles[{i}]"
        circle = _entry(file, key, entry, "circle")
        if not isinstance(circle, dict):
            raise DataError(f"{file}: {key}.circle: expected a table, found {_show(circle)}")
        radius: Any = circle.get("radius")
        if not _is_number(radius) or radius <= 0:
            raise DataError(f"{file}: {key}.circle.radius: expected metres > 0, found {_show(radius)}")
        centre = _places(file, f"{key}.circle.center", [circle.get("center")], project, swapped=True)[0]
        disc = Shape.disc(float(centre[0]), float(centre[1]), float(radius))
        zones.append(Zone(disc, _role(file, key, entry), key))
    zones += list(_surveys(file, table, project))
    if not zones:
        raise DataError(f"{file}: expected a geofence or a survey with an area, found none")
    return tuple(zones)


def projection(origin: Origin) -> Project:
    """From degrees to metres east and north of the origin, in the plane that touches the earth there.

    Raises:
        DataError: if pyproj is not installed.
    """
    try:
        from pyproj import Transformer  # noqa: PLC0415 - 0.1 s, and only missions with geodetic areas need it
    except ImportError:
        raise DataError("areas in degrees need the package pyproj: pip install pyproj") from None
    latitude, longitude, altitude = (float(x) for x in origin)
    made = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lon_0={longitude!r} +lat_0={latitude!r} +h_0={altitude!r}"
    )

    def project(places: FloatArray) -> FloatArray:
        height = np.full(len(places), altitude)
        east, north, _ = made.transform(places[:, 0], places[:, 1], height)
        return np.stack([np.asarray(east), np.asarray(north)], axis=1)

    return project


def _load(file: Path) -> dict[str, Any]:
    try:
        if file.stat().st_size > MAX_BYTES:
            raise DataError(f"{file} has more than {MAX_BYTES:,} bytes: too many for an area")
        table = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{file} cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise DataError(f"{file} is not JSON: {error}") from None
    if not isinstance(table, dict):
        raise DataError(f"{file}: expected an object, found {_show(table)}")
    return table


def _polygons(file: Path, table: Any, key: str) -> Iterator[tuple[str, list[Any]]]:
    """All polygons below a GeoJSON object, each with the path of keys to its coordinates."""
    dot = f"{key}." if key else ""
    if not isinstance(table, dict):
        raise DataError(f"{file}: {key or 'file'}: expected an object, found {_show(table)}")
    kind = table.get("type")
    if kind == "FeatureCollection":
        for i, feature in enumerate(_list(file, table, f"{dot}features")):
            yield from _polygons(file, feature, f"{dot}features[{i}]")
    elif kind == "Feature":
        yield from _polygons(file, table.get("geometry"), f"{dot}geometry")
    elif kind == "GeometryCollection":
        for i, geometry in enumerate(_list(file, table, f"{dot}geometries")):
            yield from _polygons(file, geometry, f"{dot}geometries[{i}]")
    elif kind == "Polygon":
        yield f"{dot}coordinates", _list(file, table, f"{dot}coordinates")
    elif kind == "MultiPolygon":
        for i, polygon in enumerate(_list(file, table, f"{dot}coordinates")):
            if not isinstance(polygon, list):
                raise DataError(f"{file}: {dot}coordinates[{i}]: expected a list, found {_show(polygon)}")
            yield f"{dot}coordinates[{i}]", polygon
    else:
        allowed = "Polygon, MultiPolygon or a collection of them"
        raise DataError(f"{file}: {dot}type: expected {allowed}, found {_show(kind)}")


def _surveys(file: Path, table: dict[str, Any], project: Project) -> Iterator[Zone]:
    mission = _table(file, table, "mission")
    for i, item in enumerate(_list(file, mission, "mission.items")):
        if isinstance(item, dict) and item.get("type") == "ComplexItem" and "polygon" in item:
            key = f"mission.items[{i}].polygon"
            yield Zone(
                _shape(file, key, [_ring(file, key, item["polygon"], project, swapped=True)]), "area", key
            )


def _shape(file: Path, key: str, rings: list[FloatArray]) -> Shape:
    try:
        return Shape.polygon(rings)
    except ValueError as error:
        raise DataError(f"{file}: {key}: {error}") from None


def _ring(file: Path, key: str, value: Any, project: Project, *, swapped: bool) -> FloatArray:
    """Corners (n, 2) in metres. GeoJSON gives longitude first, QGroundControl latitude (`swapped`)."""
    if not isinstance(value, list) or len(value) < 3:
        raise DataError(f"{file}: {key}: expected a list of at least 3 places, found {_show(value)}")
    return _places(file, key, value, project, swapped=swapped)


def _places(file: Path, key: str, value: list[Any], project: Project, *, swapped: bool) -> FloatArray:
    order = "latitude, longitude" if swapped else "longitude, latitude"
    for i, place in enumerate(value):
        right = isinstance(place, list) and len(place) >= 2 and all(map(_is_number, place[:2]))
        if right:
            longitude, latitude = (place[1], place[0]) if swapped else (place[0], place[1])
            right = abs(longitude) <= 180 and abs(latitude) <= 90
        if not right:
            raise DataError(f"{file}: {key}[{i}]: expected {order} in degrees, found {_show(place)}")
    places = np.array([place[:2] for place in value], dtype=np.float64)
    metres = project(places[:, ::-1] if swapped else places)
    if not np.isfinite(metres).all() or np.abs(metres).max() > 1e6:
        far = "a place more than 1,000 km away"
        raise DataError(f"{file}: {key}: expected places near the mission's origin, found {far}")
    return metres


def _role(file: Path, key: str, entry: dict[str, Any]) -> Role:
    inclusion = entry.get("inclusion")
    if not isinstance(inclusion, bool):
        raise DataError(f"{file}: {key}.inclusion: expected true or false, found {_show(inclusion)}")
    return "inside" if inclusion else "outside"


def _table(file: Path, table: dict[str, Any], key: str) -> dict[str, Any]:
    value = table.get(key, {})
    if not isinstance(value, dict):
        raise DataError(f"{file}: {key}: expected an object, found {_show(value)}")
    return value


def _list(file: Path, table: dict[str, Any], key: str) -> list[Any]:
    name = key.rpartition(".")[2]
    value = table.get(name, [])
    if not isinstance(value, list):
        raise DataError(f"{file}: {key}: expected a list, found {_show(value)}")
    return value


def _entry(file: Path, key: str, entry: Any, name: str) -> Any:
    if not isinstance(entry, dict) or name not in entry:
        raise DataError(f"{file}: {key}: expected an object with {name}, found {_show(entry)}")
    return entry[name]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _show(value: Any) -> str:
    text = "nothing" if value is None else json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."
