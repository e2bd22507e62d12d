"""What a mission says of where robots may be: its tables `origin` and `ground`."""

from typing import Annotated

import msgspec
from msgspec import Meta

from estimator.arrays import NonNegative, Positive

Pair = Annotated[list[float], Meta(min_length=2, max_length=2)]


class OriginTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the team's frame, metres east, north and up, has its zero on the earth (WGS 84)."""

    latitude: Annotated[float, Meta(ge=-90, le=90)]  # degrees
    longitude: Annotated[float, Meta(ge=-180, le=180)]  # degrees
    altitude: float = 0.0  # metres above the ellipsoid


class ZoneTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A part of the ground: exactly one of polygon, circle and file."""

    polygon: Annotated[list[Pair], Meta(min_length=3)] | None = None  # corners x, y in metres
    circle: Annotated[list[float], Meta(min_length=3, max_length=3)] | None = None  # x, y, radius in metres
    file: Annotated[str, Meta(min_length=1)] | None = None  # of geodetic shapes; needs the table origin
    altitude: Pair | None = None  # metres from and to; left out: all altitudes

    def __post_init__(self) -> None:
        given = [name for name in ("polygon", "circle", "file") if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "none"
            raise ValueError(f"exactly one of polygon, circle and file; found {found}")


class GroundTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where robots may be, beside the map's free space."""

    robot_radius_m: NonNegative = 0.0  # from a robot's middle; nothing may come nearer
    room_m: NonNegative = 0.0  # ways keep this much more room where there is any
    resolution_m: Positive | None = None  # of the grid; left out: the map's, or a 250th of the longest side
    layer_m: Positive | None = None  # its height in layers, where altitudes count; left out: resolution_m
    altitude_m: Pair | None = None  # robots stay between these altitudes; left out: any
    climb: bool = (
        False  # ways may leave the altitude of start and goal to be shorter; false: only if they must
    )
    line_of_sight: bool = True  # sensors do not see through obstacles of all altitudes
    obstacles: list[ZoneTable] = []  # robots stay outside, and no target is in them
    keep_out: list[ZoneTable] = []  # robots stay outside
    geofence: list[ZoneTable] = []  # robots stay inside one of them, and all targets are; none: no fence
