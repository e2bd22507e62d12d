"""A team's tasks and who does them, as one robot works it out from what it knows of the others.

Until bids go over the network every robot runs the whole team's CBBA by itself, each robot starting from the
end of its committed way. Robots of the same belief come to the same allocation.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.sensor import SensorModel
from planner.allocation.engine import allocate, named
from planner.allocation.information import InformationRules, Learnt, learnt
from planner.allocation.score import TeamScores
from planner.allocation.slots import slots, task_of
from planner.allocation.tasks import Task
from planner.plan import VehicleModel

_SAMPLES = 41  # of the line over which a sensor's width is taken


@dataclass(frozen=True, slots=True)
class Member:
    """One robot as the allocation sees it."""

    robot: str
    place: FloatArray  # (d,) where it will be free
    wait: float  # seconds until then
    speed: float  # m/s
    width: float  # metres that its sensor sweeps
    sensor: SensorModel
    period: float  # seconds between measurements
    altitude: float
    seconds: float = np.inf  # that it may still spend


@dataclass(frozen=True, slots=True)
class Worth:
    """How tasks are valued against each other, in expected targets."""

    refine: float = 1.0  # of what is learnt of a target
    explore: float = 5.0  # targets expected in an area of which nothing is explored
    discount_s: float = 60.0  # a reward that much later is worth 1/e
    fuel: float = 0.0  # per second
    enough: float = 0.25  # metres of standard deviation at which a target is known well enough
    loyalty: float = 0.2  # added to a task's value for the robot that is at it


def assign(
    members: list[Member],
    tasks: tuple[Task, ...],
    capacity: int,
    worth: Worth,
    at: Mapping[str, str],
    area: Area,
) -> dict[str, tuple[str, ...]]:
    """The tasks of each robot in the order of execution, by CBBA among all.

    Args:
        members: in the order that tells equal bids apart.
        tasks: with different names.
        capacity: tasks of a robot, at most.
        worth: of tasks.
        at: the task that each robot was at.
        area: whose volume the unexplored mass is a share of.
    """
    if not members or not tasks:
        return {member.robot: () for member in members}
    values, durations, first = _values(members, tasks, worth, at, area)
    places = np.array([task.place for task in tasks])
    gaps = np.linalg.norm(places[:, None] - places, axis=2)
    speeds, kinds = np.unique([member.speed for member in members], return_inverse=True)
    columns = np.repeat(np.arange(len(tasks)), [task.robots for task in tasks])
    scores = TeamScores.of(
        values[:, columns],
        first[:, columns],
        np.stack([gaps / speed for speed in speeds])[:, columns[:, None], columns],
        kinds=kinds.ravel(),
        durations=durations[columns],
        rate=1.0 / worth.discount_s,
        fuel=worth.fuel,
        limits=np.array([member.seconds for member in members]),
    )
    needed = np.array([task.robots for task in tasks])[columns]
    made = allocate(scores, capacity, groups=columns, needed=needed)
    names = [slot for task in tasks for slot in slots(task.name, task.robots)]
    paths = named(made.paths, [member.robot for member in members], names)
    return {robot: tuple(task_of(slot) for slot in path) for robot, path in paths.items()}


def cruise(vehicle: VehicleModel, area: Area) -> float:
    """The mean speed in m/s of a vehicle on its way across a quarter of the area."""
    start, goal = np.zeros(4), np.zeros(3)
    d = area.dimension
    start[:d] = area.low + 0.375 * (area.high - area.low)
    goal[:3] = start[:3]
    goal[:d] = area.low + 0.625 * (area.high - area.low)
    way = vehicle.predict(vehicle.initial_state(start), goal[None], 10.0)
    seconds = float(way.steps[0]) * vehicle.control_period
    gap = float(np.linalg.norm(goal - start[:3]))
    return gap / seconds if seconds > 0 and gap > 0 else 1.0


def sweep_width(sensor: SensorModel, area: Area, altitude: float) -> float:
    """The metres that a passing robot sees: p_D along a line through it, summed up."""
    d = area.dimension
    half = 0.5 * float((area.high - area.low)[:2].max())
    line = np.linspace(-half, half, _SAMPLES)
    points = np.tile((0.5 * (area.low + area.high))[:, None], (1, _SAMPLES))
    points[1] += line
    pose = np.zeros(4)
    pose[:2] = points[:2, _SAMPLES // 2]
    pose[2] = points[2, 0] if d == 3 else altitude
    seen = sensor.detection(np.ascontiguousarray(points), pose[None])[0]
    return max(float(np.nan_to_num(seen).sum()) * float(line[1] - line[0]), 1e-3 * half)


def _values(
    members: list[Member], tasks: tuple[Task, ...], worth: Worth, at: Mapping[str, str], area: Area
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rewards (n, t), mean durations (t,), and seconds (n, t) to where each robot enters each task."""
    n, t = len(members), len(tasks)
    values, seconds, first = np.zeros((n, t)), np.zeros((n, t)), np.zeros((n, t))
    clusters = [j for j, task in enumerate(tasks) if task.kind == "refine"]
    heuristics: dict[tuple[int, float, float], Learnt] = {}
    for i, member in enumerate(members):
        middles = np.array([task.place for task in tasks])
        gaps = np.linalg.norm(middles - member.place, axis=1)
        for j, task in enumerate(tasks):
            values[i, j] = task.mass * (worth.explore if task.kind == "explore" else 1.0)
            if task.kind == "explore":
                rate = member.speed * member.width ** (area.dimension - 1)
                seconds[i, j] = task.mass * area.volume / rate
        key = (id(member.sensor), member.speed, member.period)
        if key not in heuristics:
            rules = InformationRules(
                step=member.speed * member.period,
                period=member.period,
                enough=worth.enough,
                fuel=worth.fuel,
            )
            some = [tasks[j] for j in clusters]
            heuristics[key] = learnt(member.sensor, some, rules, member.altitude)
        known = heuristics[key]
        for row, j in enumerate(clusters):
            entrance = int(np.argmin(np.linalg.norm(known.entrances[row] - member.place, axis=1)))
            values[i, j] = worth.refine * known.score[row, entrance]
            seconds[i, j] = known.seconds[row, entrance]
            gaps[j] = np.linalg.norm(known.entrances[row, entrance] - member.place)
        first[i] = member.wait + gaps / member.speed
        held = at.get(member.robot)
        for j, task in enumerate(tasks):
            if task.name == held:
                values[i, j] *= 1.0 + worth.loyalty
    return values, seconds.mean(axis=0), first
