"""A mission's area as the fence that an autopilot keeps by itself, and a planned way as its mission.

An autopilot's fence knows places, not altitudes: what a zone forbids between two altitudes only cannot be
said to it and is left to the bridge's own check of every setpoint. Its limits of height are parameters.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bridges.mavlink.dialect import mavlink
from bridges.mavlink.mission_items import ABSOLUTE, Item, waypoint
from estimator.arrays import FloatArray
from planner.ground.shapes import Shape

POLYGON_IN = int(mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION)
POLYGON_OUT = int(mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
CIRCLE_IN = int(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION)
CIRCLE_OUT = int(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION)
Degrees = Callable[[FloatArray], FloatArray]
"""From metres east and north of the team's origin (n, 2) to degrees of latitude and longitude (n, 2)."""


@dataclass(frozen=True, slots=True)
class Fence:
    """What goes on board, and what could not be said."""

    items: tuple[Item, ...]
    left_out: tuple[str, ...]  # a sentence each
    inclusions: int


def fence_items(inside: Sequence[Shape], outside: Sequence[Shape], degrees: Degrees) -> Fence:
    """A fence around `inside` and without `outside`, in the team's metres.

    Holes of polygons in `inside` become exclusions. Zones of `outside` that do not reach through all
    altitudes are left out.
    """
    items: list[Item] = []
    left_out = []
    for shape in inside:
        items += _shape(shape, degrees, POLYGON_IN, CIRCLE_IN)
    for number, shape in enumerate(outside):
        if shape.endless:
            items += _shape(shape, degrees, POLYGON_OUT, CIRCLE_OUT)
        else:
            low, high = shape.altitude
            left_out.append(
                f"zone {number + 1} to stay out of reaches from {low:g} to {high:g} m only; "
                "an autopilot's fence knows no altitudes of zones"
            )
    return Fence(tuple(items), tuple(left_out), len(inside))


def box_shape(low: FloatArray, high: FloatArray) -> Shape:
    """The area of a mission that names no fence, as a rectangle."""
    (a, b), (c, d) = low[:2], high[:2]
    return Shape.polygon([np.array([[a, b], [c, b], [c, d], [a, d]])])


def way_items(route: FloatArray, degrees: Degrees, home_height: float, within: float = 1.0) -> list[Item]:
    """A planned way as a mission: `route` (r, 3) in the team's frame, home at `home_height` of its z.

    Give it `Trajectory.route`: the corners that the vehicle steers for in turn.
    """
    places = degrees(np.asarray(route[:, :2], dtype=np.float64))
    return [
        waypoint(float(latitude), float(longitude), float(z - home_height), within=within)
        for (latitude, longitude), z in zip(places, route[:, 2], strict=True)
    ]


def _shape(shape: Shape, degrees: Degrees, polygon: int, circle: int) -> list[Item]:
    if shape.circle[2] > 0:
        (place,) = degrees(shape.circle[None, :2])
        radius = (float(shape.circle[2]), 0.0, 0.0, 0.0)
        return [Item(circle, float(place[0]), float(place[1]), params=radius, frame=ABSOLUTE)]
    items = []
    for index, ring in enumerate(rings_of(shape)):
        command = polygon if index == 0 else (POLYGON_OUT if polygon == POLYGON_IN else POLYGON_IN)
        if index > 0 and command == POLYGON_IN:
            continue  # a hole in a zone to stay out of cannot be reached from outside
        count = (float(len(ring)), 0.0, 0.0, 0.0)
        for latitude, longitude in degrees(ring):
            items.append(Item(command, float(latitude), float(longitude), params=count, frame=ABSOLUTE))
    return items


def rings_of(shape: Shape) -> list[FloatArray]:
    """The rings (n, 2) of a polygon's edges, the outer one first."""
    rings: list[list[FloatArray]] = [[]]
    begin: FloatArray | None = None
    for edge in shape.edges:
        if begin is None:
            begin = edge[:2]
        rings[-1].append(edge[:2])
        if (edge[2:] == begin).all():
            rings.append([])
            begin = None
    return [np.array(ring) for ring in rings if ring]
