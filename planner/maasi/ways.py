"""The ways to all candidates at once: straight, or around what the ground has in between."""

from dataclasses import replace

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from planner.budget import way_to
from planner.plan import PlannerSetup, PlanProblem, Predictions, Trajectory


def sight(problem: PlanProblem, setup: PlannerSetup, waypoints: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Whether each waypoint (w, 3) may be entered, and whether the straight way there may be taken."""
    ground, d = setup.ground, problem.area.dimension
    free = np.ones(len(waypoints), dtype=np.bool_)
    if ground is None or not len(waypoints):
        return free, free.copy()
    goals = np.ascontiguousarray(waypoints[:, :d].T)
    here = setup.vehicles[problem.robot].pose(problem.state)[:d]
    free = ground.clear(goals)
    return free, free & ground.segments_clear(np.repeat(here[:, None], len(waypoints), axis=1), goals)


def ways(problem: PlanProblem, setup: PlannerSetup, waypoints: FloatArray, period: float) -> Predictions:
    """`VehicleModel.predict` with the ways of waypoints (w, 3) out of sight led around obstacles.

    A waypoint to which there is no way has no steps and no measurements, as one that the robot stands on.
    A way around has no control cost: vehicle models only say that of straight ways.
    """
    vehicle = setup.vehicles[problem.robot]
    if setup.ground is None:
        return vehicle.predict(problem.state, waypoints, period)
    free, seen = sight(problem, setup, waypoints)
    straight = vehicle.predict(problem.state, np.ascontiguousarray(waypoints[seen]), period)
    around = [
        _as_predicted(problem, setup, waypoint, period) if may else None
        for waypoint, may in zip(waypoints[~seen], free[~seen], strict=True)
    ]
    return _merged(straight, around, seen, waypoints, vehicle.control_period, problem)


def _as_predicted(
    problem: PlanProblem, setup: PlannerSetup, waypoint: FloatArray, period: float
) -> Trajectory | None:
    return way_to(replace(problem, measure_period=period), setup, problem.state, problem.start_time, waypoint)


def _merged(
    straight: Predictions,
    around: list[Trajectory | None],
    seen: BoolArray,
    waypoints: FloatArray,
    control_period: float,
    problem: PlanProblem,
) -> Predictions:
    steps, costs = np.zeros(len(seen), dtype=np.int64), np.zeros(len(seen))
    ends = np.tile(np.asarray(problem.state, dtype=np.float64), (len(seen), 1))
    times: list[FloatArray] = []
    poses: list[FloatArray] = []
    row, others = 0, iter(around)
    for i, direct in enumerate(seen):
        if direct:
            rows = slice(straight.offsets[row], straight.offsets[row + 1])
            times.append(straight.measure_times[rows])
            poses.append(straight.measure_poses[rows])
            steps[i], costs[i], ends[i] = (
                straight.steps[row],
                straight.control_costs[row],
                straight.end_states[row],
            )
            row += 1
            continue
        way = next(others)
        times.append(np.zeros(0) if way is None else way.measure_times - problem.start_time)
        poses.append(np.zeros((0, 4)) if way is None else way.measure_poses)
        if way is not None:
            steps[i] = round((way.end_time - way.start_time) / control_period)
            ends[i] = way.end_state
    counts: IntArray = np.array([len(t) for t in times], dtype=np.int64)
    return Predictions(
        waypoints=waypoints,
        steps=steps,
        control_costs=costs,
        offsets=np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(counts)]),
        measure_times=np.concatenate(times) if times else np.zeros(0),
        measure_poses=np.vstack(poses) if poses else np.zeros((0, 4)),
        end_states=ends,
    )
