"""A mission made real: the filter, the planner, and every robot's models and devices, from their plugins."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import msgspec

from agents import plugins
from agents.devices import (
    DeviceContext,
    LiveSensor,
    LiveSensorKind,
    LiveVehicle,
    LiveVehicleKind,
    Sensor,
    Vehicle,
    World,
)
from agents.errors import MissionError
from agents.mission.ground import team_ground
from agents.mission.mission import Mission, RobotTable, start_pose
from agents.mission.tables import convert
from agents.robot.alone import AloneSetup
from estimator.filter import Area, Filter
from estimator.maps.line_of_sight import LineOfSight
from estimator.maps.sight import Sight
from estimator.search import Search
from estimator.sensor import SensorModel
from estimator.sensors.teammates import Teammates
from planner.allocation.desk import Desk, TaskPlanner
from planner.plan import Ground, Planner, PlannerSetup, VehicleModel
from planner.vehicles.power import Powered


@dataclass(frozen=True, slots=True)
class Team:
    """What a mission's tables stand for. Models are shared and pure; devices are made anew by each call."""

    mission: Mission
    area: Area
    filter: Filter[Any]
    planner: Planner
    vehicle_models: Mapping[str, VehicleModel]  # by robot id
    sensor_models: Mapping[str, SensorModel]
    measure_periods: Mapping[str, float]  # seconds
    sight: Sight | None  # what hides targets from sensors; None: nothing does
    ground: Ground | None  # where robots may be; None: anywhere
    _world: Callable[[int], World]
    _vehicles: Mapping[str, Callable[[DeviceContext], Vehicle]]
    _live: Mapping[str, Callable[[DeviceContext], LiveVehicle]]  # of robots that are real
    _sensors: Mapping[str, Callable[[DeviceContext], Sensor]]
    _heard: Mapping[str, Callable[[DeviceContext], LiveSensor]]  # real sensors

    @classmethod
    def of(cls, mission: Mission) -> "Team":
        """The team of a mission that `mission_file.load` has checked.

        Raises:
            MissionError: if a plugin refuses its table in the light of the rest of the mission.
            DataError: if the map, or another file of the ground, cannot be read.
        """
        made = team_ground(mission)
        area, sight = made.area, made.sight
        vehicle_models, periods = {}, {}
        sensor_models: dict[str, SensorModel] = {}
        vehicles, live, sensors, heard = {}, {}, {}, {}
        for i, robot in enumerate(mission.robots):
            with _naming(f"robots[{i}].vehicle"):
                kind, config = _plugin("vehicles", robot.vehicle, mission)
                vehicle_models[robot.id] = kind.model(config, area)
                if robot.budget is not None and robot.budget.energy_wh is not None:
                    _say_power(f"robots[{i}].budget.energy_wh", robot, vehicle_models[robot.id])
                vehicles[robot.id] = partial(kind.device, config)
                if isinstance(kind, LiveVehicleKind):
                    live[robot.id] = partial(kind.connect, config)
            with _naming(f"robots[{i}].sensor"):
                kind, config = _plugin("sensors", robot.sensor, mission)
                model = kind.model(config, area)
                sensor_models[robot.id] = model if sight is None else LineOfSight(model, sight)
                sensors[robot.id] = partial(kind.device, config)
                if isinstance(kind, LiveSensorKind):
                    heard[robot.id] = partial(kind.listen, config)
                periods[robot.id] = float(config.period_s)
        with _naming("filter"):
            kind, config = _plugin("filters", mission.filter, mission)
            team_filter = kind(config)
        with _naming("planner"):
            kind, config = _plugin("planners", mission.planner, mission)
            planner = kind(config, PlannerSetup(vehicle_models, sensor_models, area, made.ground))
        kind, config = _plugin("worlds", mission.world, mission)
        return cls(
            mission,
            area,
            team_filter,
            planner,
            vehicle_models,
            sensor_models,
            periods,
            sight,
            made.ground,
            partial(kind.world, config, area),
            vehicles,
            live,
            sensors,
            heard,
        )

    def alone(self, seed: int, fingerprint: str = "") -> AloneSetup | None:
        """What a robot needs to go on without a fusion, where the mission has it so."""
        if self.mission.fusion.share_state_s == 0.0:
            return None
        return AloneSetup(self.mission, self.search(), self.sensor_models, seed, fingerprint)

    def search(self) -> Search[Any]:
        """The team's estimate around the mission's filter, with the mission's thresholds."""
        found = self.mission.found
        return Search(
            self.filter,
            self.area,
            self.mission.exploration.points,
            radius=found.radius_m,
            mass=found.mass,
            gate=found.gate_m,
            same=found.same_sigmas,
            blur=found.blur_m,
            period=found.period_s,
            teammates=self._teammates(),
            remove=found.remove,
        )

    def _teammates(self) -> Teammates | None:
        table = self.mission.teammates
        if table.rate == 0.0:
            return None
        starts = {robot.id: start_pose(robot) for robot in self.mission.robots}
        return Teammates(starts, table.spread_m, table.rate)

    def desk(self, robot_id: str) -> Desk | None:
        """One robot's part in sharing tasks; None if the mission's planner shares none."""
        return self.planner.desk(robot_id) if isinstance(self.planner, TaskPlanner) else None

    def world(self, seed: int) -> World:
        """What is really there in the run of this seed.

        Raises:
            DataError: if it is a recording that cannot be read.
        """
        return self._world(seed)

    def vehicle(
        self, robot_id: str, seed: int, world: World, *, now: float = 0.0, speed: float = 1.0
    ) -> Vehicle:
        """One robot's body, made at team time `now` (s), where time runs `speed` times as fast as the wall's.

        Raises:
            DataError, LinkError: if it cannot be had.
        """
        return self._vehicles[robot_id](self._context(robot_id, seed, world, now, speed))

    def connect(self, robot_id: str, seed: int) -> LiveVehicle | None:
        """One robot's real vehicle, if that is what its table names; to be closed.

        Raises:
            MissionError, DataError: if its table is wrong in the light of the mission.
        """
        made = self._live.get(robot_id)
        return None if made is None else made(self._context(robot_id, seed, self.world(seed), 0.0, 1.0))

    def sensor(
        self, robot_id: str, seed: int, world: World, *, now: float = 0.0, speed: float = 1.0
    ) -> Sensor:
        """One robot's sensor, as `vehicle`."""
        return self._sensors[robot_id](self._context(robot_id, seed, world, now, speed))

    def listen(
        self, robot_id: str, seed: int, world: World, *, now: float, speed: float
    ) -> LiveSensor | None:
        """One robot's real sensor, if that is what its table names.

        Raises:
            MissionError, LinkError, DataError: if it cannot be had.
        """
        made = self._heard.get(robot_id)
        return None if made is None else made(self._context(robot_id, seed, world, now, speed))

    def _context(self, robot_id: str, seed: int, world: World, now: float, speed: float) -> DeviceContext:
        robot: RobotTable = self.mission.robot(robot_id)
        origin, table = self.mission.origin, self.mission.ground
        altitude = None if table is None else table.altitude_m
        return DeviceContext(
            robot=robot_id,
            seed=seed,
            area=self.area,
            world=world,
            start=start_pose(robot),
            now=now,
            speed=speed,
            sight=self.sight,
            ground=self.ground,
            altitude=None if altitude is None else (altitude[0], altitude[1]),
            origin=None if origin is None else (origin.latitude, origin.longitude, origin.altitude),
        )


def _plugin(group: str, table: Mapping[str, Any], mission: Mission) -> tuple[Any, Any]:
    """A table's plugin, and its Config with relative paths taken from the mission's directory."""
    kind = plugins.load(group, table["kind"])
    body = {key: value for key, value in table.items() if key != "kind"}
    return kind, convert(body, kind.Config, mission.directory or None)


@contextmanager
def _naming(key: str) -> Iterator[None]:
    """Say which table a plugin refused."""
    try:
        yield
    except (ValueError, msgspec.ValidationError) as error:
        raise MissionError(f"{key}: {error}") from error


def _say_power(key: str, robot: RobotTable, model: VehicleModel) -> None:
    """A battery is no limit for a vehicle that does not say what it takes out of it."""
    if not isinstance(model, Powered):
        kind = robot.vehicle["kind"]
        raise MissionError(
            f"{key}: vehicles of kind {kind!r} do not say what they consume; leave the key out, or limit "
            "distance_m or time_s"
        )
