"""What the controller takes from a team's own models: sensing domain, noise, the robot's limits."""

import math

import numpy as np

from estimator.arrays import FloatArray
from estimator.sensor import SensorModel
from estimator.sensors.field_of_view import FieldOfView
from planner.irrt.kinematics import FORWARD, Kinematics
from planner.mpc.model import Domain, Limits
from planner.plan import VehicleModel

ACCELERATION = 1.0  # m/s^2, of a vehicle that does not say


def domain_of(sensor: SensorModel, heads: bool, alpha_1: float | None, alpha_2: float | None) -> Domain:
    """(7) of a sensor's field of view: its own numbers if it is a smooth sector, else of like size.

    Given alphas count more. A robot whose yaw is not its direction of travel is taken to see all around.
    """
    inner: object = sensor
    while hasattr(inner, "sensor"):
        inner = inner.sensor
    view = getattr(inner, "field", None)
    gain, near, sharp, opening = 1.0, 0.01, 10.0, 2.0 * math.pi
    if isinstance(view, FieldOfView):
        gain = view.gain
        if view.shape == "smooth_sector":
            near, sharp, opening = (float(x) for x in view.size)
        elif view.shape == "sector":
            near, opening = float(view.size[1]) ** -2, float(view.size[2])
        else:
            near = float(np.abs(view.size[:2]).max()) ** -2
    around = not heads or opening >= 2.0 * math.pi - 1e-9
    edge = -math.inf if around else math.cos(0.5 * opening)
    return Domain(gain, alpha_1 or near, alpha_2 or sharp, edge)


def noise_of(sensor: SensorModel, dimension: int, domain: Domain) -> FloatArray:
    """R (3,) in m^2 of the places that a sensor gives, of a target half its range ahead."""
    ahead = np.zeros((dimension, 1))
    ahead[0] = 0.5 * domain.reach
    spread = np.eye(dimension)
    if hasattr(sensor, "measure"):
        measured = np.asarray(sensor.measure(ahead, np.zeros(4)))
        spread = sensor.location_covariance(measured, np.zeros(4))[0]
    r = np.array([spread[0, 0], 0.0, spread[1, 1]])
    return np.maximum(np.where(np.isfinite(r), r, 1.0), [1e-6, 0.0, 1e-6])


def limits_of(kinematics: Kinematics, braking: float, accelerating: float, turn_rate: float) -> Limits:
    """U and X of (6d): the vehicle's speed and turning, and what it is asked at most."""
    return Limits(
        slowest=kinematics.speed if kinematics.mode == FORWARD else 0.0,
        fastest=kinematics.speed,
        braking=-braking,
        accelerating=accelerating,
        turn_rate=min(turn_rate, kinematics.turn_rate),
    )


def acceleration_of(vehicle: VehicleModel) -> float:
    """m/s^2 that a vehicle can do, as it says for keeping robots apart."""
    return float(getattr(getattr(vehicle, "evasion", None), "acceleration", ACCELERATION))


def turning_of(vehicle: VehicleModel, pose: FloatArray) -> float:
    """rad/s that a vehicle turns from a pose (4,) towards what lies behind it, in the first second."""
    behind = pose[:3] - 10.0 * np.array([math.cos(pose[3] + 0.1), math.sin(pose[3] + 0.1), 0.0])
    state = vehicle.begin(vehicle.initial_state(pose), behind)
    turned = vehicle.pose(vehicle.advance(state, behind, round(1.0 / vehicle.control_period)))[3] - pose[3]
    return abs(math.remainder(float(turned), 2.0 * math.pi))
