"""Whether a position is where an uploaded fence does not let it be."""

from sim.mavlink.geodesy import Projection
from sim.mavlink.plans import Item

POLYGON_IN, POLYGON_OUT, CIRCLE_IN, CIRCLE_OUT = 5001, 5002, 5003, 5004


def outside(items: list[Item], projection: Projection, position: tuple[float, float, float]) -> bool:
    """True: outside an inclusion or inside an exclusion of a sound fence."""
    index = 0
    while index < len(items):
        item = items[index]
        if item.command in (POLYGON_IN, POLYGON_OUT):
            count = int(item.params[0])
            ring = [projection.to_metres(one.x, one.y) for one in items[index : index + count]]
            if _inside(ring, position[0], position[1]) != (item.command == POLYGON_IN):
                return True
            index += count
            continue
        if item.command in (CIRCLE_IN, CIRCLE_OUT):
            north, east = projection.to_metres(item.x, item.y)
            within = (north - position[0]) ** 2 + (east - position[1]) ** 2 <= item.params[0] ** 2
            if within != (item.command == CIRCLE_IN):
                return True
        index += 1
    return False


def _inside(ring: list[tuple[float, float]], north: float, east: float) -> bool:
    """By the number of edges that a ray to the north crosses."""
    odd = False
    for (a, b), (c, d) in zip(ring, ring[1:] + ring[:1], strict=True):
        if (b > east) != (d > east) and north < a + (east - b) * (c - a) / (d - b):
            odd = not odd
    return odd
