"""The seam to a robot's body: what it moves with and what it senses with, simulated, recorded or real.

A *kind* is what a mission names (`vehicle = { kind = "quadrotor", ... }`). It is found through the entry
points searchparty.vehicles, .sensors and .worlds, says what its table may hold, and makes both the model
that the estimator and the planners reason with and the device that the driver runs.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol, runtime_checkable

import msgspec

from agents.clock import Clock
from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.maps.sight import Sight
from estimator.sensor import SensorModel
from planner.plan import Ground, Trajectory, VehicleModel


class World(Protocol):
    """What is really there. Only simulated or recorded devices and the scoreboard look at it."""

    def targets(self, time: float) -> FloatArray:
        """True target positions (d, n) at a team time."""


@dataclass(frozen=True, slots=True)
class DeviceContext:
    """What a device is made with."""

    robot: str
    seed: int
    area: Area
    world: World
    start: FloatArray  # (4,) pose at the mission's start
    now: float = 0.0  # team time at which the device is made
    speed: float = 1.0  # team seconds per wall second
    sight: Sight | None = None  # what hides targets from a simulated sensor
    ground: Ground | None = None  # where robots may be; None: anywhere
    altitude: tuple[float, float] | None = None  # between which robots stay; None: any
    origin: tuple[float, float, float] | None = None  # the frame's zero: degrees, degrees, m; None: anywhere
    extra: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class VehicleState:
    """What a vehicle reports of itself."""

    time: float
    pose: FloatArray  # (4,)
    velocity: FloatArray  # (3,)
    state: FloatArray  # (n,) as its model wants it for prediction
    travelled: float  # metres since the start
    arrived: bool  # at the waypoint last given, or none was given
    energy: float | None = None  # joules since the start; None: it does not say
    able: bool = True  # goes where it is told; a real one may still take off, or be in somebody else's hands
    doing: str = ""  # what it does while it is not able, in a word or two


class Vehicle(ABC):
    """A body that moves towards waypoints. Never blocks."""

    follows_plans: bool = True  # False: it goes its own way (a recording), and nobody plans for it

    @abstractmethod
    def state(self, now: float) -> VehicleState:
        """How the vehicle is at team time `now`; calls come with growing times."""

    @abstractmethod
    def follow(self, trajectory: Trajectory | None, now: float) -> None:
        """Go this way from now on; None: hold here."""

    def detour(self, waypoint: FloatArray | None, now: float) -> None:
        """Steer for this waypoint (3,) instead, to keep apart from others; None: go on along the way.

        A vehicle that sees to that itself, or goes its own way, need not listen.
        """

    def close(self) -> None:
        """Let go of what it holds open."""


@dataclass(frozen=True, slots=True)
class VehicleHealth:
    """How a real vehicle is."""

    words: str  # for people, one line of at most 200 characters
    gauges: Mapping[str, float]
    counters: Mapping[str, int]


class LiveVehicle(Vehicle):
    """A real vehicle: found before the team starts, flown by its robot alone, brought down when that ends."""

    @abstractmethod
    def prepare(self) -> None:
        """Find it and see that nothing keeps it from flying. Blocks until so or until its patience ends.

        Raises:
            MissionError, LinkError, DataError: with what is wrong, and with nothing armed.
        """

    @abstractmethod
    def join(self, clock: Clock) -> None:
        """The team's time is known: every `now` is of this clock, and it takes off when it is tended.

        Raises:
            MissionError: if that time does not run as fast as the wall's.
        """

    @abstractmethod
    def tend(self, now: float, team_age: float) -> None:
        """Ten times a second: steer. The team was heard `team_age` seconds ago."""

    @abstractmethod
    def astray(self, now: float) -> bool:
        """Whether its way is to be reckoned anew, as it is not where it should be by now."""

    @abstractmethod
    def news(self) -> list[tuple[str, str]]:
        """What people should read, each once: level ("info", "warning", "error") and text."""

    @abstractmethod
    def health(self) -> VehicleHealth:
        """How it is."""

    @abstractmethod
    def resume(self) -> None:
        """Go on after somebody else had it, or after a fallback: a person's explicit act."""

    @abstractmethod
    def leave(self) -> bool:
        """Bring it to an end as its table says; whether that is under way without us. Called until it is."""


class Sensor(ABC):
    """A device that returns measurement sets."""

    @abstractmethod
    def measure(self, now: float, pose: FloatArray) -> FloatArray:
        """The measurement set (m, s) taken at team time `now` from pose (4,)."""

    def next_capture(self, after: float) -> float | None:
        """When the device itself will have the next set (a recording, a camera); None: whenever asked."""
        return None

    def close(self) -> None:
        """Let go of what it holds open."""


@dataclass(frozen=True, slots=True)
class Seen:
    """A measurement set of a real sensor."""

    time: float  # team time of its capture
    pose: FloatArray  # (4,) of the robot then
    measurements: FloatArray  # (m, s); none: it looked and saw nothing


Poses = Callable[[float], FloatArray | None]
"""Where the robot was at a team time, (4,); None: nobody remembers."""


class LiveSensor(ABC):
    """A real sensor: its sets come when they come, or not at all. Never blocks."""

    @abstractmethod
    def arrived(self, now: float, poses: Poses) -> list[Seen]:
        """The sets that came since the last call, in the order of their capture; `now` is team time."""

    @abstractmethod
    def news(self) -> list[tuple[str, str]]:
        """What people should read, each once: level ("info", "warning", "error") and text."""

    @abstractmethod
    def counters(self) -> Mapping[str, int]:
        """What came, and what was not taken by reason."""

    def close(self) -> None:
        """Let go of what it holds open."""


class VehicleKind(Protocol):
    """A vehicle that a mission can name."""

    Config: ClassVar[type[msgspec.Struct]]

    @staticmethod
    def model(config: Any, area: Area) -> VehicleModel:
        """How it moves, for prediction."""

    @staticmethod
    def device(config: Any, context: DeviceContext) -> Vehicle:
        """The vehicle itself.

        Raises:
            DataError, LinkError: if it cannot be had.
        """


@runtime_checkable
class LiveVehicleKind(Protocol):
    """A vehicle kind for real vehicles, whose `device` is a simulation, for rehearsals in virtual time."""

    @staticmethod
    def connect(config: Any, context: DeviceContext) -> LiveVehicle:
        """The real vehicle; begins to look for it.

        Raises:
            MissionError, DataError: if its table is wrong in the light of the context.
        """


class SensorKind(Protocol):
    """A sensor that a mission can name."""

    Config: ClassVar[type[msgspec.Struct]]  # has period_s

    @staticmethod
    def model(config: Any, area: Area) -> SensorModel:
        """p_D, g and c, for filters and planners."""

    @staticmethod
    def device(config: Any, context: DeviceContext) -> Sensor:
        """The sensor itself."""


@runtime_checkable
class LiveSensorKind(Protocol):
    """A sensor kind for real sensors, whose `device` is their simulation, for rehearsals in virtual time."""

    @staticmethod
    def listen(config: Any, context: DeviceContext) -> LiveSensor:
        """The real sensor.

        Raises:
            MissionError, LinkError, DataError: if it cannot be had.
        """


class WorldKind(Protocol):
    """A world that a mission can name."""

    Config: ClassVar[type[msgspec.Struct]]

    @staticmethod
    def world(config: Any, area: Area, seed: int) -> World:
        """The world of one seed."""
