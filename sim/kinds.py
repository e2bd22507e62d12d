"""The simulated vehicles and sensors that a mission can name."""

from typing import Any, ClassVar

from agents.devices import DeviceContext, Sensor, Vehicle
from estimator.filter import Area
from estimator.sensor import SensorModel
from estimator.sensors.bearing_only import BearingOnly
from estimator.sensors.detector import Detector
from estimator.sensors.position import Position
from estimator.sensors.range_bearing import RangeBearing
from estimator.sensors.range_only import RangeOnly
from planner.plan import VehicleModel
from planner.vehicles.fixed_wing import FixedWing
from planner.vehicles.point_mass import PointMass
from planner.vehicles.quadrotor import Quadrotor
from planner.vehicles.unicycle import Unicycle
from sim.sensor import simulated
from sim.vehicle import SimulatedVehicle


class QuadrotorKind:
    """`kind = "quadrotor"`: the Parrot Mambo of (MA)ASI section 5.1 within speed and acceleration limits."""

    Config = Quadrotor.Config

    @staticmethod
    def model(config: Any, area: Area) -> VehicleModel:
        return Quadrotor(config)

    @staticmethod
    def device(config: Any, context: DeviceContext) -> Vehicle:
        return SimulatedVehicle(Quadrotor(config), context.start, context.now)


class UnicycleKind:
    """`kind = "unicycle"`: a ground robot with a stabilising waypoint controller."""

    Config = Unicycle.Config

    @staticmethod
    def model(config: Any, area: Area) -> VehicleModel:
        return Unicycle(config)

    @staticmethod
    def device(config: Any, context: DeviceContext) -> Vehicle:
        return SimulatedVehicle(Unicycle(config), context.start, context.now)


class FixedWingKind:
    """`kind = "fixed_wing"`: an aircraft that flies shortest Dubins ways and holds on a loiter circle."""

    Config = FixedWing.Config

    @staticmethod
    def model(config: Any, area: Area) -> VehicleModel:
        return FixedWing(config)

    @staticmethod
    def device(config: Any, context: DeviceContext) -> Vehicle:
        return SimulatedVehicle(FixedWing(config), context.start, context.now)


class PointMassKind:
    """`kind = "point_mass"`: goes anywhere within limits of speed and acceleration."""

    Config = PointMass.Config

    @staticmethod
    def model(config: Any, area: Area) -> VehicleModel:
        return PointMass(config)

    @staticmethod
    def device(config: Any, context: DeviceContext) -> Vehicle:
        return SimulatedVehicle(PointMass(config), context.start, context.now)


class _SensorKind:
    """A sensor simulated by drawing from the very model that the filter believes in."""

    Model: ClassVar[Any]  # with Config and of(config, area)

    @classmethod
    def model(cls, config: Any, area: Area) -> SensorModel:
        made: SensorModel = cls.Model.of(config, area)
        return made

    @classmethod
    def device(cls, config: Any, context: DeviceContext) -> Sensor:
        return simulated(cls.model(config, context.area), context)


class RangeBearingKind(_SensorKind):
    """`kind = "range_bearing"`: range and bearing (and elevation in 3D) of what is detected, and clutter."""

    Model, Config = RangeBearing, RangeBearing.Config


class BearingOnlyKind(_SensorKind):
    """`kind = "bearing_only"`: the laser of Dames & Kumar, that gives directions."""

    Model, Config = BearingOnly, BearingOnly.Config


class RangeOnlyKind(_SensorKind):
    """`kind = "range_only"`: the radio of Dames & Kumar, that gives distances."""

    Model, Config = RangeOnly, RangeOnly.Config


class PositionKind(_SensorKind):
    """`kind = "position"`: a camera that looks down and gives positions."""

    Model, Config = Position, Position.Config


class DetectorKind(_SensorKind):
    """`kind = "detector"`: a camera of Ponda et al. that says "detection" or nothing."""

    Model, Config = Detector, Detector.Config
