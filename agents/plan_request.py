"""What a robot asks its planner: one frozen problem out of all that it believes."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from agents.belief import Belief
from agents.devices import VehicleState
from agents.messages import PoseMessage
from agents.mission import Mission
from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.sensor import SensorModel
from planner.plan import Commitment, PlanProblem, Trajectory, VehicleModel
from planner.vehicles.route import advanced


@dataclass(frozen=True, slots=True)
class RobotSetup:
    """What one robot is made with."""

    mission: Mission
    robot: str
    boot: str
    vehicle: VehicleModel
    sensors: Mapping[str, SensorModel]
    periods: Mapping[str, float]  # measure clock Δ by robot, s
    follows_plans: bool = True
    first_capture: float | None = None  # of a sensor that has its own times
    plan_lead_s: float = 0.25  # how long before its start a plan is asked for
    stagger_s: float = 0.1  # at the start, robot i of the mission waits i times this before it plans
    area: Area | None = None  # with its map; None: the mission's box
    patience: float = 1.0  # scales the re-offer time, for teams that run faster than the wall


def plan_problem(
    setup: RobotSetup,
    belief: Belief,
    number: int,
    now: float,
    body: VehicleState,
    trajectory: Trajectory | None,
) -> PlanProblem:
    """The problem of the robot's plan `number`, asked for at `now` on its way along `trajectory`."""
    mission, robot = setup.mission, setup.robot
    start, state = _departure(setup, now, body, trajectory)
    others = tuple(commitment for other, commitment in sorted(belief.commitments.items()) if other != robot)
    standing = tuple(
        _standing(pose, start, setup.periods)
        for other, pose in sorted(belief.poses.items())
        if other != robot and other not in belief.commitments and other in setup.periods
    )
    return PlanProblem(
        robot=robot,
        state=state,
        start_time=start,
        measure_period=setup.periods[robot],
        clusters=belief.clusters(),
        exploration=belief.exploration(),
        others=others + standing,
        area=setup.area or mission.box(),
        separation=mission.settings.separation_m,
        intensity=belief.intensity(),
        seed=zlib.crc32(f"{mission.seed} {robot} {number}".encode()),
    )


def _departure(
    setup: RobotSetup, now: float, body: VehicleState, trajectory: Trajectory | None
) -> tuple[float, FloatArray]:
    """When and from which full vehicle state the next trajectory begins."""
    lead = setup.plan_lead_s
    if trajectory is None:
        return now + lead, body.state
    if now + lead >= trajectory.end_time - 1e-9:
        return max(trajectory.end_time, now), trajectory.end_state
    period = setup.vehicle.control_period
    steps = max(0, round((now + lead - body.time) / period))
    state = advanced(setup.vehicle, body.state, trajectory, body.time, steps)
    return body.time + steps * period, state


def _standing(pose: PoseMessage, now: float, periods: Mapping[str, float]) -> Commitment:
    """A robot whose plan is not known: expected to stay where it is and to measure there."""
    return Commitment(
        robot=pose.sender,
        version=-1,
        measure_times=np.array([now]),
        measure_poses=pose.pose[None, :],
        times=np.array([now]),
        poses=pose.pose[None, :],
        measure_period=periods[pose.sender],
        boot=pose.boot,
    )
