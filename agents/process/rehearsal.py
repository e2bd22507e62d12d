"""Do once, before the team starts, what will be done in it: so that no kernel is loaded while time runs.

Compiled kernels wait on the disk, but taking one from there holds a process up for tens of milliseconds,
and its first measurement would be late by the sum of them.
"""

from typing import Any

import numpy as np

from agents.mission.mission import start_pose
from agents.team import Team
from estimator.arrays import FloatArray
from estimator.exploration import Exploration
from estimator.filter import Listening
from estimator.maps.line_of_sight import LineOfSight
from estimator.search import Search
from estimator.soft.models import ranges
from estimator.soft.statement import SoftObservation
from planner.allocation.warm import warm_allocation
from planner.avoidance.meeting import meet
from planner.ground.warm import run as warm_ground
from planner.maasi.trigger import worth_measuring
from planner.plan import Commitment, PlanProblem

FROM = ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, -1.0))  # cameras look ahead, down, or ahead and down

SPREAD = 0.2 * np.arange(3)  # between targets: so near that their measurements could be confused


def rehearse_robot(team: Team, robot: str) -> None:
    """A robot's plan around another's, a look at the sensor's field, a step of the vehicle."""
    mission = team.mission
    vehicle, sensor = team.vehicle_models[robot], team.sensor_models[robot]
    pose = start_pose(mission.robot(robot))
    state = vehicle.initial_state(pose)
    exploration = Exploration.unexplored(team.area, tuple(mission.exploration.points))
    clusters = np.ascontiguousarray((0.5 * (team.area.low + team.area.high))[:, None])
    others = [
        Commitment(
            robot=other,
            version=0,
            measure_times=np.array([0.0]),
            measure_poses=start_pose(mission.robot(other))[None],
            times=np.array([0.0]),
            poses=start_pose(mission.robot(other))[None],
            measure_period=team.measure_periods[other],
        )
        for other in team.sensor_models
        if other != robot
    ]
    problem = PlanProblem(
        robot=robot,
        state=state,
        start_time=0.0,
        measure_period=team.measure_periods[robot],
        clusters=clusters,
        exploration=exploration.after(sensor, pose[None]),
        others=tuple(others[:1]),
        area=team.area,
        separation=mission.settings.separation_m,
        deadline_s=3600.0,  # as in flight there is one, and steps are measured
        context={"rehearsal": True},  # planners with a memory must not remember it
    )
    team.planner.plan(problem)  # loads kernels; the next one shows planners how long their steps take
    trajectory = team.planner.plan(problem).trajectory
    waypoint = pose[:3] if trajectory is None else trajectory.waypoint
    state = vehicle.advance(vehicle.begin(state, waypoint), waypoint, 1)
    vehicle.reached(state, waypoint)
    meet(vehicle, pose, team.ground)
    worth_measuring(sensor, clusters, exploration, pose, 1.0, 1.0)
    sensor.sample(clusters, pose, np.random.default_rng(0))
    if team.desk(robot) is not None:
        warm_allocation()
    if team.ground is not None:
        warm_ground()


def rehearse_fusion(team: Team) -> None:
    """A few sets of every robot's sensor, on an estimate that is then thrown away."""
    search = team.search()
    rng = np.random.default_rng(0)
    state = search.init(rng)
    targets = 0.5 * (team.area.low + team.area.high)[:, None] + SPREAD
    for sensor in team.sensor_models.values():
        measurements = np.zeros((0, sensor.measurement_size))
        seeing = sensor.sensor if isinstance(sensor, LineOfSight) else sensor  # here a wall may be in between
        for attempt in range(20):
            pose = np.zeros(4)
            pose[: team.area.dimension] = targets[:, 0] - FROM[attempt % len(FROM)][: team.area.dimension]
            drawn = seeing.sample(targets, pose, rng)
            measurements = drawn if len(drawn) else measurements
            state = search.apply(state, sensor, pose, measurements, 0.1 * attempt, rng)
        # Once more without the search, which takes found targets out before their particles are resampled.
        inner = search.filter.init(team.area, rng)
        for _ in range(10):
            inner = search.filter.update(inner, sensor, pose, measurements, rng)
            inner, _ = search.filter.clusters(inner, rng)
        if len(team.sensor_models) > 4:
            break  # the kernels are the same; more sets only take more time
    if isinstance(search.filter, Listening):
        _rehearse_statements(search, targets[:2, 0])
    search.thinned(state, 10)


def _rehearse_statements(search: Search[Any], place: FloatArray) -> None:
    """An operator may speak at any time; the first words must not wait for a compiler."""
    model = ranges(place, 2.0, 4.0, 1.0, dimension=search.area.dimension)
    for positive in (True, False):
        rng = np.random.default_rng(0)
        search.observe(search.init(rng), SoftObservation.of(model, "near", positive=positive), 0.0, rng)
