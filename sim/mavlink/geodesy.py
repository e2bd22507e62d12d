"""Degrees and metres as the two autopilots convert them: each by its own sphere, not by the ellipsoid.

A hundred metres may differ from the ellipsoid's by up to some decimetres. That is so on real vehicles too,
so whoever converts exactly must be content with it.
"""

import math
from abc import ABC, abstractmethod

LATITUDE_M = 0.011131884502145034 * 1e7  # m per degree in ArduPilot's Location
RADIUS_M = 6371000.0  # of PX4's map projection


class Projection(ABC):
    """From degrees to metres north and east of an origin, and back."""

    def __init__(self, latitude: float, longitude: float) -> None:
        self.latitude, self.longitude = latitude, longitude

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.latitude:.7f}, {self.longitude:.7f})"

    @abstractmethod
    def to_metres(self, latitude: float, longitude: float) -> tuple[float, float]:
        """North and east of the origin, m."""

    @abstractmethod
    def to_degrees(self, north: float, east: float) -> tuple[float, float]:
        """Latitude and longitude, degrees."""


class FlatEarth(Projection):
    """ArduPilot: equal degrees of latitude, longitude shrunk by the cosine of the middle latitude."""

    def to_metres(self, latitude: float, longitude: float) -> tuple[float, float]:
        shrink = max(math.cos(math.radians((latitude + self.latitude) / 2)), 0.01)
        return (latitude - self.latitude) * LATITUDE_M, (longitude - self.longitude) * LATITUDE_M * shrink

    def to_degrees(self, north: float, east: float) -> tuple[float, float]:
        latitude = self.latitude + north / LATITUDE_M
        shrink = max(math.cos(math.radians((latitude + self.latitude) / 2)), 0.01)
        return latitude, self.longitude + east / (LATITUDE_M * shrink)


class Azimuthal(Projection):
    """PX4: the azimuthal equidistant projection of a sphere."""

    def to_metres(self, latitude: float, longitude: float) -> tuple[float, float]:
        here, there = math.radians(self.latitude), math.radians(latitude)
        turn = math.radians(longitude - self.longitude)
        cosine = math.sin(here) * math.sin(there) + math.cos(here) * math.cos(there) * math.cos(turn)
        angle = math.acos(min(max(cosine, -1.0), 1.0))
        stretch = RADIUS_M * (angle / math.sin(angle) if angle > 1e-12 else 1.0)
        north = math.cos(here) * math.sin(there) - math.sin(here) * math.cos(there) * math.cos(turn)
        return stretch * north, stretch * math.cos(there) * math.sin(turn)

    def to_degrees(self, north: float, east: float) -> tuple[float, float]:
        angle = math.hypot(north, east) / RADIUS_M
        if angle < 1e-12:
            return self.latitude, self.longitude
        here, x, y = math.radians(self.latitude), north / RADIUS_M, east / RADIUS_M
        sine = math.cos(angle) * math.sin(here) + x * math.sin(angle) * math.cos(here) / angle
        turn = math.atan2(
            y * math.sin(angle),
            angle * math.cos(here) * math.cos(angle) - x * math.sin(here) * math.sin(angle),
        )
        return math.degrees(math.asin(sine)), self.longitude + math.degrees(turn)
