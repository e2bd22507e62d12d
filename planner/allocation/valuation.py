"""What tasks are worth to one robot: the scores that its bids are made from.

Clusters by the task information heuristic of Ponda et al. (2012) (see `information`), regions by their share
of the unexplored mass, requests by what the operator gives for them; all in expected targets, discounted by
the time until then (see `score`).
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FloatArray
from estimator.filter import Area
from estimator.sensor import SensorModel
from planner.allocation.information import InformationRules, learnt
from planner.allocation.score import RobotScore, TeamScores
from planner.allocation.slots import slots
from planner.allocation.tasks import Task
from planner.plan import Over, never


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
    home: FloatArray | None = None  # (d,) where it must be by then


@dataclass(frozen=True, slots=True)
class Worth:
    """How tasks are valued against each other, in expected targets."""

    refine: float = 1.0  # of what is learnt of a target
    explore: float = 5.0  # targets expected in an area of which nothing is explored
    discount_s: float = 60.0  # a reward that much later is worth 1/e
    fuel: float = 0.0  # per second
    enough: float = 0.25  # metres of standard deviation at which a target is known well enough
    loyalty: float = 0.2  # added to a task's value for the robot that is at it


def slot_names(tasks: tuple[Task, ...]) -> list[str]:
    """What is bid for: every task, and every slot of those that need several robots."""
    return [slot for task in tasks for slot in slots(task.name, task.robots)]


def valued(
    member: Member,
    tasks: tuple[Task, ...],
    worth: Worth,
    area: Area,
    *,
    held: str = "",
    able: BoolArray | None = None,
    over: Over = never,
) -> RobotScore:
    """What the slots of all tasks are worth to a robot.

    Args:
        member: the robot.
        tasks: with different names.
        worth: of tasks.
        area: whose volume the unexplored mass is a share of.
        held: the task that the robot is at.
        able: (t,) tasks that the robot can do; it bids for no other. Default: all.
        over: whether time is up: then what is learnt of clusters is worked out for shorter paths.
    """
    t, d = len(tasks), member.place.size
    places = np.array([task.place for task in tasks]).reshape(t, d)
    entrances = places.copy()
    values, durations = np.zeros(t), np.zeros(t)
    rate = member.speed * member.width ** (area.dimension - 1)
    for j, task in enumerate(tasks):
        values[j] = task.mass * (worth.explore if task.kind == "explore" else 1.0)
        if task.kind == "explore":
            durations[j] = task.mass * area.volume / rate
    clusters = [j for j, task in enumerate(tasks) if task.kind == "refine"]
    rules = InformationRules(
        step=member.speed * member.period, period=member.period, enough=worth.enough, fuel=worth.fuel
    )
    known = learnt(member.sensor, [tasks[j] for j in clusters], rules, member.altitude, over)
    for row, j in enumerate(clusters):
        entrance = int(np.argmin(np.linalg.norm(known.entrances[row] - member.place, axis=1)))
        values[j] = worth.refine * known.score[row, entrance]
        durations[j] = known.seconds[row, entrance]
        entrances[j] = known.entrances[row, entrance]
    values *= np.where([task.name == held for task in tasks], 1.0 + worth.loyalty, 1.0)
    if able is not None:
        values = np.where(able, values, -np.inf)
    values = np.where(np.isnan(values), -np.inf, values)
    columns = np.repeat(np.arange(t), [task.robots for task in tasks])
    first = member.wait + np.linalg.norm(entrances - member.place, axis=1) / member.speed
    legs = np.linalg.norm(places[:, None] - places, axis=2) / member.speed
    home = None
    if member.home is not None:
        home = np.linalg.norm(places - member.home, axis=1)[None, columns] / member.speed
    scores = TeamScores.of(
        values[None, columns],
        first[None, columns],
        legs[columns[:, None], columns],
        durations=durations[columns],
        rate=1.0 / worth.discount_s,
        fuel=worth.fuel,
        limits=np.array([member.seconds]),
        home=home,
    )
    return RobotScore(scores, 0, slot_names(tasks))
