"""The way into a task: to the place in it of the highest value as by (MA)ASI (17), (27), around obstacles."""

import numpy as np

from estimator.arrays import FloatArray
from planner.allocation.partition import equal_shares
from planner.allocation.tasks import Task
from planner.baselines.choice import Pace, best_first, first_of
from planner.deadline import Deadline
from planner.maasi.maasi import MaasiConfig, crowded, scored
from planner.maasi.outlook import outlook
from planner.others import Others
from planner.plan import Over, Plan, PlannerSetup, PlanProblem

RING = 8  # places around a cluster


def approach(
    problem: PlanProblem,
    setup: PlannerSetup,
    task: Task,
    weights: MaasiConfig,
    places: FloatArray,
    deadline: Deadline,
    pace: Pace,
    others: Others,
) -> Plan:
    """The best way to one of the places (w, 3) in a task; a hold with the reason where there is none.

    Args:
        problem, setup: of the robot.
        task: that is gone to.
        weights: of the objective.
        places: to choose from, see `places_in`.
        deadline, pace, others: as of `planner.baselines.choice.taken`.
    """
    ground, d = setup.ground, problem.area.dimension
    if ground is not None and len(places):
        places = places[ground.clear(np.ascontiguousarray(places[:, :d].T))]
    reason = f"it is at {task.name} already, or there is no way to it"
    full: list[bool] = []  # whether another robot is in the way to each place

    def value(some: FloatArray, over: Over) -> FloatArray:
        view = outlook(problem, setup, some, others, over=over)
        value = scored(view, view.exploration, weights)
        full.extend((np.isfinite(value) & ~view.clear).tolist())
        return np.where(view.clear, value, -np.inf)

    options, why = best_first(deadline, pace, places, value, reason)
    if not options and any(full):
        why = crowded(problem.separation).removeprefix("holds: ")
    return first_of(problem, setup, options, deadline, pace, why, others)


def places_in(task: Task, problem: PlanProblem, altitude: float, width: float, most: int) -> FloatArray:
    """Places (w, 3) in a task, the middle first.

    Args:
        task: regions are cut into `most` shares, clusters have up to so many places and RING around them.
        problem: in whose area the places lie.
        altitude: of the robot in a 2D area, m.
        width: metres that its sensor sweeps.
        most: see above.
    """
    points = [task.place[:, None]]
    if task.kind == "explore":
        labels, _ = equal_shares(task.points, task.weights, most)
        for label in range(int(labels.max(initial=-1)) + 1):
            rows = labels == label
            points.append(np.average(task.points[:, rows], axis=1, weights=task.weights[rows])[:, None])
    elif task.kind == "refine":
        points.append(task.points[:, :most])
        around = 0.5 * (task.radius + width)
        angles = 2 * np.pi * np.arange(RING) / RING
        ring = np.repeat(task.place[:, None], RING, axis=1)
        ring[0] += around * np.cos(angles)
        ring[1] += around * np.sin(angles)
        points.append(ring)
    made = np.hstack(points)
    inside = ((made >= problem.area.low[:, None]) & (made <= problem.area.high[:, None])).all(axis=0)
    made = made[:, inside & np.isfinite(made).all(axis=0)]
    waypoints = np.full((made.shape[1], 3), altitude)
    waypoints[:, : len(made)] = made.T
    return waypoints
