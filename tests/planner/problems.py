"""A small sensor in plain numpy, problems to plan for, and a slow, literal reading of the objective."""

import math

import numpy as np

from estimator.exploration import Exploration
from estimator.filter import Area
from planner.plan import Commitment, PlannerSetup, PlanProblem, Trajectory
from planner.vehicles.quadrotor import Quadrotor


class NumpySensor:
    """p_D = G exp(-|x - q| / (2 F)), (MA)ASI (3)-(4)."""

    def __init__(self, dimension, gain=0.9, reach=8.0):
        self.dimension, self.gain, self.reach = dimension, gain, reach

    def detection(self, points, poses):
        gap = points.T[None] - poses[:, None, : self.dimension]
        return self.gain * np.exp(-np.linalg.norm(gap, axis=2) / (2 * self.reach))


def drone(**changes):
    return Quadrotor(Quadrotor.Config(**{"speed_m_s": 5.0, "acceleration_m_s2": 3.0, **changes}))


def team(dimension, robots="ab", side=40.0, reach=8.0):
    area = Area(np.zeros(dimension), np.full(dimension, side))
    sensor = NumpySensor(dimension, reach=reach)
    return PlannerSetup({r: drone() for r in robots}, dict.fromkeys(robots, sensor), area)


def committed(trajectory: Trajectory, robot="b", measure_period=1.0, version=1):
    return Commitment(
        robot=robot,
        version=version,
        measure_times=trajectory.measure_times,
        measure_poses=trajectory.measure_poses,
        times=trajectory.times,
        poses=trajectory.poses,
        measure_period=measure_period,
    )


def problem(setup, seed, robot="a", others=(), clusters=3, separation=0.0, period=1.0, start=None):
    """A random problem; unexplored to random degrees."""
    rng = np.random.default_rng(seed)
    area = setup.area
    d = area.dimension
    place = np.zeros(4)
    place[:3] = rng.uniform(1, area.high[0] - 1, 3) if start is None else start
    return PlanProblem(
        robot=robot,
        state=setup.vehicles[robot].initial_state(place),
        start_time=3.0,
        measure_period=period,
        clusters=rng.uniform(0, area.high[0], (d, clusters)),
        exploration=Exploration(rng.uniform(0, 1, (6, 5, 4)[:d]), area.low, area.high),
        others=tuple(others),
        area=area,
        separation=separation,
    )


def interpolated(values, low, high, point):
    """Multilinear interpolation, one axis after the other."""
    for axis in range(len(low)):
        u = (min(max(point[axis], low[axis]), high[axis]) - low[axis]) / (high[axis] - low[axis])
        u *= values.shape[0] - 1
        i = min(math.floor(u), values.shape[0] - 2)
        values = values[i] * (1 - (u - i)) + values[i + 1] * (u - i)
    return float(values)


def slow_looks(commitment, start, end):
    """(time, pose) of each measurement of another robot: its tail, then standing, as section 6 says."""
    looks = [
        (t, q) for t, q in zip(commitment.measure_times, commitment.measure_poses, strict=True) if t >= start
    ]
    t = commitment.times[-1]
    while t <= end + 1e-6:
        if t >= start - 1e-6 and (not len(commitment.measure_times) or t > commitment.measure_times[-1]):
            looks.append((t, commitment.poses[-1]))
        t += commitment.measure_period
    return looks


def slow_exploration(problem, setup, trajectory, others_looks):
    """E by (21)-(22), (31)-(32), with a copy of the whole grid; others_looks: (robot, time, pose)."""
    e = problem.exploration
    axes = [np.linspace(e.low[i], e.high[i], n) for i, n in enumerate(e.values.shape)]
    grid = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")])
    d = grid.shape[0]
    own = [
        (problem.robot, t, q) for t, q in zip(trajectory.measure_times, trajectory.measure_poses, strict=True)
    ]
    total = 0.0
    for _, t, q in own:
        values = e.values.ravel().copy()
        for robot, when, where in own + others_looks:
            if when <= t + 1e-6:
                values *= 1 - setup.sensors[robot].detection(grid, where[None])[0]
        total += interpolated(values.reshape(e.values.shape), e.low, e.high, q[:d])
    return total


def slow_objective(problem, setup, waypoint, config, others_looks=()):
    """J by (17)-(22), (27)-(32) of the way to one waypoint; -inf without a way."""
    vehicle, sensor = setup.vehicles[problem.robot], setup.sensors[problem.robot]
    trajectory = vehicle.trajectory(problem.state, waypoint, problem.start_time, problem.measure_period)
    steps = round((trajectory.end_time - problem.start_time) / vehicle.control_period)
    if steps == 0:
        return -math.inf
    refinement = sum(
        sensor.detection(problem.clusters[:, [c]], q[None])[0, 0]
        for q in trajectory.measure_poses
        for c in range(problem.clusters.shape[1])
    )
    exploration = slow_exploration(problem, setup, trajectory, list(others_looks))
    gain = config.alpha * refinement + config.beta * exploration
    return (gain - config.control_cost * trajectory.control_cost) / steps
