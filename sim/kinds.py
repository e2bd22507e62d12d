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


class _VehicleKind:
    """A vehicle simulated by the very model that planners predict with."""

    Model: ClassVar[Any]  # with Config, made of one

    @classmethod
    def model(cls, config: Any, area: Area) -> VehicleModel:
        made: VehicleModel = cls.Model(config)
        return made

    @classmethod
    def device(cls, config: Any, context: DeviceContext) -> Vehicle:
        return SimulatedVehicle(cls.model(config, context.area), context.start, context.now)


class QuadrotorKind(_VehicleKind):
    """`kind = "quadrotor"`: the Parrot Mambo of (MA)ASI section 5.1 within speed and acceleration limits."""

    Model, Config = Quadrotor, Quadrotor.Config


class UnicycleKind(_VehicleKind):
    """`kind = "unicycle"`: a ground robot with a stabilising waypoint controller."""

    Model, Config = Unicycle, Unicycle.Config


class FixedWingKind(_VehicleKind):
    """`kind = "fixed_wing"`: an aircraft that flies shortest Dubins ways and holds on a loiter circle."""

    Model, Config = FixedWing, FixedWing.Config


class PointMassKind(_VehicleKind):
    """`kind = "point_mass"`: goes anywhere within limits of speed and acceleration."""

    Model, Config = PointMass, PointMass.Config


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
