"""Where things are: the team's frame, degrees, and an autopilot's local NED. All conversions are here.

The team's frame is ENU in metres: east and north in the plane that touches the WGS 84 ellipsoid at its zero,
as for areas in degrees (bridges.geo_area), and up as the difference of altitudes, which is what fences and
pilots mean by height. At 1 km from the zero that plane lies 8 cm above the points of equal altitude.

An autopilot's local NED is no such plane: each converts between degrees and metres with its own sphere, and a
place 100 m north of where its estimator began may differ by 0.4 m. So setpoints go from the team's frame to
degrees and from there to what this autopilot takes for them, and positions come back the same way.

Altitudes are metres above mean sea level, as autopilots have them. Taken for ellipsoidal ones, as here for
east and north, they shift a place 1 km away by a centimetre at most.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from estimator.arrays import FloatArray

Place = tuple[float, float, float]  # latitude, longitude in degrees, altitude in metres
A, F = 6378137.0, 1 / 298.257223563  # WGS 84: semi-major axis in m, flattening
E2 = F * (2 - F)
LATITUDE_M = 0.011131884502145034 * 1e7  # metres per degree in ArduPilot
PX4_RADIUS_M = 6371000.0


def _earth(latitude: float, longitude: float, height: float) -> FloatArray:
    """Earth-centred coordinates (3,) of degrees and metres above the ellipsoid."""
    phi, lam = math.radians(latitude), math.radians(longitude)
    s, c = math.sin(phi), math.cos(phi)
    n = A / math.sqrt(1 - E2 * s * s)
    return np.array(
        [(n + height) * c * math.cos(lam), (n + height) * c * math.sin(lam), (n * (1 - E2) + height) * s]
    )


def _degrees(place: FloatArray) -> Place:
    """Latitude, longitude and height of earth-centred coordinates (3,), by Bowring's formula."""
    x, y, z = (float(value) for value in place)
    p, b = math.hypot(x, y), A * (1 - F)
    theta = math.atan2(z * A, p * b)
    up = z + (A * A - b * b) / b * math.sin(theta) ** 3
    phi = math.atan2(up, p - E2 * A * math.cos(theta) ** 3)
    n = A / math.sqrt(1 - E2 * math.sin(phi) ** 2)
    # p / cos φ fails at the poles, z / sin φ at the equator.
    height = p / math.cos(phi) - n if abs(phi) < math.pi / 4 else z / math.sin(phi) - n * (1 - E2)
    return math.degrees(phi), math.degrees(math.atan2(y, x)), height


@dataclass(frozen=True, slots=True)
class TeamFrame:
    """ENU metres around a place on the earth that has the coordinates `at` (3,)."""

    zero: Place
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    _centre: FloatArray = field(init=False, repr=False)
    _axes: FloatArray = field(init=False, repr=False)  # (3, 3) rows: east, north, up

    def __post_init__(self) -> None:
        phi, lam = math.radians(self.zero[0]), math.radians(self.zero[1])
        s, c, sl, cl = math.sin(phi), math.cos(phi), math.sin(lam), math.cos(lam)
        axes = np.array([[-sl, cl, 0.0], [-s * cl, -s * sl, c], [c * cl, c * sl, s]])
        object.__setattr__(self, "_centre", _earth(*self.zero))
        object.__setattr__(self, "_axes", axes)

    def from_degrees(self, place: Place) -> FloatArray:
        """Team coordinates (3,) of a place on the earth."""
        level = self._axes @ (_earth(place[0], place[1], self.zero[2]) - self._centre)
        return np.array([level[0] + self.at[0], level[1] + self.at[1], place[2] - self.zero[2] + self.at[2]])

    def to_degrees(self, position: FloatArray) -> Place:
        """The place on the earth of team coordinates (3,)."""
        east, north = float(position[0]) - self.at[0], float(position[1]) - self.at[1]
        up = 0.0  # in the touching plane, of the point as high above the ellipsoid as the zero is
        for _ in range(3):
            latitude, longitude, height = _degrees(self._centre + self._axes.T @ [east, north, up])
            up -= height - self.zero[2]
        return latitude, longitude, float(position[2]) - self.at[2] + self.zero[2]


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """An autopilot's local NED around the origin of its estimator, seen from the team's frame."""

    team: TeamFrame
    origin: Place
    autopilot: str  # "ArduPilot" or "PX4": how it converts degrees

    def to_team(self, ned: FloatArray) -> FloatArray:
        """Team coordinates (3,) of local NED (3,)."""
        turn = _px4_degrees if self.autopilot == "PX4" else _ardupilot_degrees
        latitude, longitude = turn(self.origin, float(ned[0]), float(ned[1]))
        return self.team.from_degrees((latitude, longitude, self.origin[2] - float(ned[2])))

    def to_ned(self, position: FloatArray) -> FloatArray:
        """Local NED (3,) of team coordinates (3,)."""
        latitude, longitude, altitude = self.team.to_degrees(position)
        turn = _px4_metres if self.autopilot == "PX4" else _ardupilot_metres
        north, east = turn(self.origin, latitude, longitude)
        return np.array([north, east, self.origin[2] - altitude])


def swapped(vector: FloatArray) -> FloatArray:
    """ENU from NED or NED from ENU, of a velocity or another difference (3,)."""
    return np.array([vector[1], vector[0], -vector[2]])


def turned(yaw: float) -> float:
    """From north clockwise to from east counter-clockwise, or back, rad in (-pi, pi]."""
    return math.remainder(math.pi / 2 - yaw, 2 * math.pi)


def _ardupilot_metres(origin: Place, latitude: float, longitude: float) -> tuple[float, float]:
    shrink = max(math.cos(math.radians((latitude + origin[0]) / 2)), 0.01)
    return (latitude - origin[0]) * LATITUDE_M, _east(longitude - origin[1]) * LATITUDE_M * shrink


def _ardupilot_degrees(origin: Place, north: float, east: float) -> tuple[float, float]:
    latitude = origin[0] + north / LATITUDE_M
    shrink = max(math.cos(math.radians((latitude + origin[0]) / 2)), 0.01)
    return latitude, _east(origin[1] + east / (LATITUDE_M * shrink))


def _px4_metres(origin: Place, latitude: float, longitude: float) -> tuple[float, float]:
    here, there, turn = (math.radians(x) for x in (origin[0], latitude, longitude - origin[1]))
    north = math.cos(here) * math.sin(there) - math.sin(here) * math.cos(there) * math.cos(turn)
    east = math.cos(there) * math.sin(turn)
    cosine = math.sin(here) * math.sin(there) + math.cos(here) * math.cos(there) * math.cos(turn)
    # atan2 where the autopilot has acos, which loses all digits nearby
    sine = math.hypot(north, east)
    stretch = PX4_RADIUS_M * (math.atan2(sine, cosine) / sine if sine > 1e-12 else 1.0)
    return stretch * north, stretch * east


def _px4_degrees(origin: Place, north: float, east: float) -> tuple[float, float]:
    angle = math.hypot(north, east) / PX4_RADIUS_M
    if angle < 1e-12:
        return origin[0], origin[1]
    here, x, y = math.radians(origin[0]), north / PX4_RADIUS_M, east / PX4_RADIUS_M
    sine = math.cos(angle) * math.sin(here) + x * math.sin(angle) * math.cos(here) / angle
    across = angle * math.cos(here) * math.cos(angle) - x * math.sin(here) * math.sin(angle)
    longitude = origin[1] + math.degrees(math.atan2(y * math.sin(angle), across))
    return math.degrees(math.asin(sine)), _east(longitude)


def _east(degrees: float) -> float:
    """A longitude, or a difference of two, in -180 to 180."""
    return math.remainder(degrees, 360.0)
