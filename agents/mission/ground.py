"""The ground of a mission: its map, obstacles, zones and fences, made into what models and planners ask."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from agents import plugins
from agents.errors import DataError, MissionError
from agents.mission.ground_tables import GroundTable, OriginTable, ZoneTable
from agents.mission.mission import Mission, start_pose
from agents.mission.tables import resolve_path, show
from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.maps.occupancy import OccupancyMap
from estimator.maps.sight import Sight
from planner.ground.build import GroundPlan, built, target_map
from planner.ground.grid_ground import GridGround
from planner.ground.shapes import EVERYWHERE, Shape, Zone


@dataclass(frozen=True, slots=True)
class TeamGround:
    """What a mission's tables `area`, `map` and `ground` stand for."""

    area: Area  # where targets can be
    sight: Sight | None  # what hides targets from sensors; None: nothing does
    ground: GridGround | None  # where robots may be; None: anywhere


def team_ground(mission: Mission) -> TeamGround:
    """The ground of a mission that `mission_file.load` has checked.

    Raises:
        MissionError: if a table is wrong in the light of the rest; names the key.
        DataError: if a file cannot be read; names it.
    """
    area, table = mission.box(), mission.ground
    if mission.map is None and table is None:
        return TeamGround(area, None, None)
    known = None if mission.map is None else _map(mission, mission.map.kind, mission.map.file)
    starts = np.array([start_pose(robot) for robot in mission.robots]).T[:3]
    plan = _plan(mission, table or GroundTable(), known)
    try:
        ground = built(plan, area, starts)
    except ValueError as error:
        raise MissionError(f"ground.{error}") from None
    _check_starts(mission, ground, starts)
    targets = target_map(plan, area, ground)
    if targets is not None:
        targets = targets.reachable_from(starts) if _free(targets, starts).all() else targets
        _check_area(area, targets)
    solids = plan.obstacles if area.dimension == 3 else ()
    return TeamGround(replace(area, map=targets, solids=solids), _sight(mission, plan, area, ground), ground)


def ground_plan(mission: Mission) -> GroundPlan:
    """What a mission says of where robots may be, without its map: fences, obstacles, zones to keep out of.

    Raises:
        MissionError: if a table is wrong in the light of the rest; names the key.
        DataError: if a file cannot be read; names it.
    """
    return _plan(mission, mission.ground or GroundTable(), None)


def _map(mission: Mission, kind: str, file: str) -> OccupancyMap:
    known: OccupancyMap = plugins.load("maps", kind)(resolve_path(mission.directory or None, file))
    starts = np.array([robot.start[:2] for robot in mission.robots]).T
    for i in np.flatnonzero(~known.is_free(starts)):
        raise MissionError(
            f"robots[{i}].start: found {show(mission.robots[i].start)}; allowed are places in free space of "
            f"{file}"
        )
    return known


def _plan(mission: Mission, table: GroundTable, known: OccupancyMap | None) -> GroundPlan:
    obstacles = _shapes(mission, "ground.obstacles", table.obstacles)
    keep_out = _shapes(mission, "ground.keep_out", table.keep_out)
    fences: list[Shape] = []
    for i, zone in enumerate(table.geofence):
        if zone.altitude is not None:
            allowed = "no altitude; ground.altitude_m says between which altitudes robots stay"
            raise MissionError(f"ground.geofence[{i}].altitude: found {zone.altitude}; allowed is {allowed}")
        zones = _zones(mission, f"ground.geofence[{i}]", zone)
        inside = [each for each in zones if each.role == "inside"]
        inside = inside or [each for each in zones if each.role == "area"]
        if not inside:
            raise MissionError(f"ground.geofence[{i}].file: {zone.file} has no area to stay inside of")
        fences += [each.shape for each in inside]
        keep_out += [each.shape for each in zones if each.role == "outside"]
    altitude = table.altitude_m
    if altitude is not None and not altitude[0] < altitude[1]:
        allowed = "two numbers, the first below the second"
        raise MissionError(f"ground.altitude_m: found {altitude}; allowed are {allowed}")
    return GroundPlan(
        map=known,
        obstacles=tuple(obstacles),
        keep_out=tuple(keep_out),
        fences=tuple(fences),
        radius=table.robot_radius_m,
        room=table.room_m,
        resolution=table.resolution_m,
        layer=table.layer_m,
        altitude=None if altitude is None else (altitude[0], altitude[1]),
        climb=table.climb,
    )


def _shapes(mission: Mission, key: str, tables: Sequence[ZoneTable]) -> list[Shape]:
    return [zone.shape for i, table in enumerate(tables) for zone in _zones(mission, f"{key}[{i}]", table)]


def _zones(mission: Mission, key: str, table: ZoneTable) -> tuple[Zone, ...]:
    altitude = EVERYWHERE if table.altitude is None else (table.altitude[0], table.altitude[1])
    try:
        if table.polygon is not None:
            return (Zone(Shape.polygon([np.array(table.polygon, dtype=np.float64)], altitude), "inside"),)
        if table.circle is not None:
            x, y, radius = table.circle
            return (Zone(Shape.disc(x, y, radius, altitude), "inside"),)
        zones = _read(mission, key, resolve_path(mission.directory or None, str(table.file)))
        return tuple(replace(zone, shape=replace(zone.shape, altitude=altitude)) for zone in zones)
    except ValueError as error:
        raise MissionError(f"{key}.{error}") from None


def _read(mission: Mission, key: str, file: Path) -> tuple[Zone, ...]:
    kind = file.suffix.removeprefix(".").lower()
    if kind not in plugins.kinds("areas"):
        allowed = ", ".join(f".{known}" for known in plugins.kinds("areas"))
        raise MissionError(f"{key}.file: found {show(file.name)}; allowed are files that end in {allowed}")
    origin: OriginTable | None = mission.origin
    if origin is None:
        raise MissionError(
            f"origin: found nothing, but {key}.file gives places in degrees; allowed is a table"
        )
    try:
        place = (origin.latitude, origin.longitude, origin.altitude)
        zones: tuple[Zone, ...] = plugins.load("areas", kind)(file, place)
    except DataError as error:
        raise DataError(f"{key}.file: {error}") from None
    return zones


def _check_starts(mission: Mission, ground: GridGround, starts: FloatArray) -> None:
    for i in np.flatnonzero(~ground.clear(starts)):
        place = np.ascontiguousarray(starts[:, i])
        if ground.solid(place[:, None])[0]:
            allowed = "places outside of obstacles and keep-out zones and inside the fence"
        elif ground.way_out(place) is None:
            allowed = "places with robot_radius_m of room around them, or near such"
        else:
            continue
        raise MissionError(f"robots[{i}].start: found {show(mission.robots[i].start)}; allowed are {allowed}")


def _free(targets: OccupancyMap, starts: FloatArray) -> np.ndarray:
    return targets.is_free(starts)


def _check_area(area: Area, targets: OccupancyMap) -> None:
    """The area must hold a place for a target."""
    u = np.linspace(area.low[0], area.high[0], 200)
    v = np.linspace(area.low[1], area.high[1], 200)
    points = np.stack([axis.ravel() for axis in np.meshgrid(u, v)])
    if not targets.is_free(points).any():
        raise MissionError(
            "ground: nothing of the area is free: it lies outside the fence or within obstacles"
        )


def _sight(mission: Mission, plan: GroundPlan, area: Area, ground: GridGround) -> Sight | None:
    """What sensors do not see through: walls of the map, obstacles that reach through all altitudes."""
    from_map = mission.map is not None and mission.map.line_of_sight
    solids = tuple(shape for shape in plan.obstacles if shape.endless or area.dimension == 2)
    hiding = bool(solids) and mission.ground is not None and mission.ground.line_of_sight
    if not from_map and not hiding:
        return None
    kept = replace(plan, map=plan.map if from_map else None, obstacles=solids if hiding else (), fences=())
    walls = target_map(
        kept, area, ground if plan.map is None or from_map else built(kept, area, _nowhere(area))
    )
    unknown = mission.map is not None and from_map and mission.map.unknown == "blocks"
    return None if walls is None else Sight.of(walls, unknown_blocks=unknown)


def _nowhere(area: Area) -> FloatArray:
    """The middle of the area (3, 1)."""
    middle = np.zeros((3, 1))
    middle[: area.dimension, 0] = 0.5 * (area.low + area.high)
    return middle
