"""Every kernel of this room once with tiny data of run-time types, so that no robot compiles in flight."""

from collections.abc import Callable
from functools import partial

import numpy as np

from estimator.exploration import Exploration
from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from planner.allocation.warm import warm_allocation
from planner.avoidance.meeting import meet
from planner.ground.warm import run as run_ground
from planner.information.warm import warm_information
from planner.irrt.warm import warm_irrt
from planner.maasi.candidates import CandidateGrid
from planner.maasi.maasi import Maasi
from planner.maasi.maasi_joint import MaasiJoint
from planner.plan import Commitment, PlannerSetup, PlanProblem, VehicleModel
from planner.sampling.warm import warm_sampling
from planner.vehicles.fixed_wing import FixedWing
from planner.vehicles.point_mass import PointMass
from planner.vehicles.quadrotor import Quadrotor
from planner.vehicles.unicycle import Unicycle


def warmups() -> list[tuple[str, Callable[[], None]]]:
    """Names for people, and what to call."""
    return [
        ("quadrotor", partial(_move, Quadrotor(Quadrotor.Config()))),
        ("unicycle", partial(_move, Unicycle(Unicycle.Config()))),
        ("point mass", partial(_move, PointMass(PointMass.Config()))),
        ("fixed wing", partial(_move, FixedWing(FixedWing.Config()))),
        ("separation", _keep_apart),
        ("ways over the ground", run_ground),
        ("(MA)ASI planner", _plan),
        ("CBBA", warm_allocation),
        ("sampled paths", warm_sampling),
        ("information-rich tree", warm_irrt),
        ("mutual information", warm_information),
    ]


def _move(vehicle: VehicleModel) -> None:
    state = vehicle.initial_state(np.zeros(4))
    waypoint = np.array([1.0, 0.0, 0.0])
    vehicle.advance(vehicle.begin(state, waypoint), waypoint, 2)
    vehicle.trajectory(state, waypoint, 0.0, 0.1)


def _keep_apart() -> None:
    for vehicle in (Unicycle(Unicycle.Config()), Quadrotor(Quadrotor.Config())):
        meet(vehicle)


def _sensor(dimension: int) -> RangeBearing:
    config = RangeBearing.Config(
        period_s=1.0,
        range_sigma_m=1.0,
        bearing_sigma_deg=1.0,
        elevation_sigma_deg=1.0 if dimension == 3 else None,
        reach_m=[5.0] * dimension,
    )
    return RangeBearing.of(config, Area(np.zeros(dimension), np.full(dimension, 10.0)))


def _plan() -> None:
    for dimension in (2, 3):
        area = Area(np.zeros(dimension), np.full(dimension, 10.0))
        vehicle = Quadrotor(Quadrotor.Config())
        sensor = _sensor(dimension)
        setup = PlannerSetup({"a": vehicle, "b": vehicle}, {"a": sensor, "b": sensor}, area)
        grid = CandidateGrid.over(area, 2)
        other = Commitment(
            robot="c",
            version=0,
            measure_times=np.zeros(1),
            measure_poses=np.full((1, 4), 30.0),
            times=np.array([0.0, 1.0]),
            poses=np.full((2, 4), 30.0),
            measure_period=1.0,
        )
        problems = tuple(
            PlanProblem(
                robot=robot,
                state=vehicle.initial_state(np.array([place, 0.0, 0.0, 0.0])),
                start_time=0.0,
                measure_period=1.0,
                clusters=np.ones((dimension, 1)),
                exploration=Exploration.unexplored(area, [3] * dimension),
                others=(other,),
                area=area,
                separation=0.5,
            )
            for robot, place in (("a", 0.0), ("b", 10.0))
        )
        Maasi(Maasi.Config(candidates=grid), setup).plan(problems[0])
        MaasiJoint(MaasiJoint.Config(candidates=grid), setup).plan_jointly(problems)
