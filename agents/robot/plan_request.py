"""What a robot asks its planner: one frozen problem out of all that it believes."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from agents.devices import VehicleState
from agents.mission.mission import Mission, start_pose
from agents.robot.alone import AloneSetup
from agents.robot.belief import Belief
from agents.robot.departure import PLANNING, departure
from agents.wire.messages import MeasurementSetMessage, PoseMessage
from agents.wire.topics import POSE
from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.sensor import SensorModel
from planner.allocation.desk import Desk
from planner.plan import UNLIMITED, Budget, Commitment, Ground, PlanProblem, Trajectory, VehicleModel
from planner.vehicles.power import WH, Power, Powered

NO_POWER = Power(rest_w=0.0, metre_j=0.0, climb_j_m=0.0)
RESERVE = 0.05  # share of a budget that no plan may touch


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
    plan_lead_s: float = 0.25  # how long before its start a plan is asked for, in team time
    speed: float | None = None  # of team time against the wall's; None: virtual time, without a wall
    stagger_s: float = 0.1  # at the start, robot i of the mission waits i times this before it plans
    area: Area | None = None  # with its map; None: the mission's box
    vehicles: Mapping[str, VehicleModel] = field(default_factory=dict)  # the whole team's, to keep apart
    ground: Ground | None = None  # where it may be, when it is turned aside; None: anywhere
    patience: float = 1.0  # scales the re-offer time, for teams that run faster than the wall
    desk: Desk | None = None  # where robots share tasks: this one's part in it
    left: Sequence[MeasurementSetMessage] = ()  # by its earlier boots, and acknowledged by no fusion
    alone: AloneSetup | None = None  # what it needs to go on without a fusion; None: with what it heard last


def plan_problem(
    setup: RobotSetup,
    belief: Belief,
    number: int,
    now: float,
    body: VehicleState,
    trajectory: Trajectory | None,
    lead: float | None = None,
    held: FloatArray | None = None,
    following: Trajectory | None = None,
) -> PlanProblem:
    """The problem of the robot's plan `number`, asked for at `now`.

    Args:
        setup, belief: of the robot.
        number: of the plan.
        now: team time.
        body: of the vehicle, now.
        trajectory: that the robot is on; None: it holds.
        lead: seconds from now at which the plan is to begin; None: the setup's.
        held: (3,) the waypoint that it steers for where it holds; None: where it is.
        following: that it has committed to and not begun yet, if any.
    """
    mission, robot = setup.mission, setup.robot
    ahead = setup.plan_lead_s if lead is None else lead
    start, state = departure(setup.vehicle, now, body, trajectory, ahead, held, following)
    others = tuple(commitment for other, commitment in sorted(belief.commitments.items()) if other != robot)
    standing = tuple(
        _standing(pose, start, setup.periods)
        for other, pose in sorted(belief.poses.items())
        if other != robot
        and other not in belief.commitments
        and other in setup.periods
        and now - pose.time <= POSE.stale_after_s  # nobody measures for a silent robot; separation keeps it
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
        intensity=belief.intensity(following=not mission.found.remove),
        budget=_budget(setup, start, body, trajectory),
        deadline_s=planning_time(setup),
        seed=zlib.crc32(f"{mission.seed} {robot} {number}".encode()),
    )


def planning_time(setup: RobotSetup) -> float:
    """Seconds of the wall's clock that a planner may take, so that its plan comes before it begins.

    Virtual time gives none: what is decided there must not depend on the machine.
    """
    return np.inf if setup.speed is None else PLANNING * setup.plan_lead_s / setup.speed


def _budget(setup: RobotSetup, start: float, body: VehicleState, trajectory: Trajectory | None) -> Budget:
    """What the robot may spend from `start` on: its mission's budget less what is spent by then.

    A part is kept back, for what a way takes beyond its samples, and for turning aside for others.
    """
    table = setup.mission.robot(setup.robot).budget
    if table is None:
        return UNLIMITED
    # What there is of energy bounds time and distance too, for planners that look no further.
    power = setup.vehicle.power if isinstance(setup.vehicle, Powered) else NO_POWER
    seconds, climbed, spent = max(start - body.time, 0.0), 0.0, body.travelled
    if trajectory is not None and start > body.time:
        times = np.append(
            body.time, trajectory.times[(trajectory.times > body.time) & (trajectory.times < start)]
        )
        times = np.append(times, min(start, max(trajectory.end_time, body.time)))
        way = [np.interp(times, trajectory.times, trajectory.poses[:, axis]) for axis in range(3)]
        spent += float(np.linalg.norm(np.diff(way, axis=1), axis=0).sum())
        climbed = float(np.maximum(np.diff(way[2]), 0.0).sum())
    distance = np.inf if table.distance_m is None else table.distance_m * (1 - RESERVE) - spent
    time = np.inf if table.time_s is None else table.time_s * (1 - RESERVE) - start
    home = start_pose(setup.mission.robot(setup.robot))[:3] if table.return_home else None
    energy = np.inf
    if table.energy_wh is not None:
        used = power.joules(body.time, body.travelled, 0.0) if body.energy is None else body.energy
        used += power.joules(seconds, spent - body.travelled, climbed)
        energy = max(table.energy_wh * WH * (1 - RESERVE) - used, 0.0)
        time = min(time, energy / power.rest_w if power.rest_w > 0 else np.inf)
        distance = min(distance, energy / power.metre_j if power.metre_j > 0 else np.inf)
    return Budget(max(distance, 0.0), max(time, 0.0), home, energy)


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
