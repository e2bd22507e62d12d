"""The simulated vehicles and sensors that a mission can name."""

from typing import Any

from agents.devices import DeviceContext, Sensor, Vehicle
from estimator.filter import Area
from estimator.sensor import SensorModel
from estimator.sensors.range_bearing import RangeBearing
from planner.plan import VehicleModel
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


class RangeBearingKind:
    """`kind = "range_bearing"`: range and bearing (and elevation in 3D) of what is detected, and clutter."""

    Config = RangeBearing.Config

    @staticmethod
    def model(config: Any, area: Area) -> SensorModel:
        return RangeBearing.of(config, area)

    @staticmethod
    def device(config: Any, context: DeviceContext) -> Sensor:
        return simulated(RangeBearing.of(config, context.area), context)
