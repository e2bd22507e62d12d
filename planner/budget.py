"""What a way costs, the way home from its end included, and the part of it that can be afforded.

Both ways are predicted by the vehicle's own model, so that turns, climbs and stops count. Metres are those
between a trajectory's samples.
"""

import math

import numpy as np

from estimator.arrays import FloatArray
from planner.ground.routes import followed, lifted, trajectory_to
from planner.plan import Over, Plan, PlannerSetup, PlanProblem, Trajectory, never
from planner.separation import keeps_apart
from planner.vehicles.route import routed

NEAR_M = 1.0  # corners of a way around obstacles are passed within this
SHORTER = 0.8  # how much of a part that is still too long is tried next
TRIES = 12


def limited(problem: PlanProblem) -> bool:
    """Whether anything of the budget can run out."""
    return problem.budget.distance != math.inf or problem.budget.time != math.inf


def metres(way: Trajectory) -> float:
    """The length of a trajectory."""
    return float(np.linalg.norm(np.diff(way.poses[:, :3], axis=0), axis=1).sum())


def way_to(
    problem: PlanProblem,
    setup: PlannerSetup,
    state: FloatArray,
    time: float,
    place: FloatArray,
    over: Over = never,
) -> Trajectory | None:
    """The way from a state at team time `time` to a place (3,): straight, or around what stands between.

    None where the ground has no way, or none was found before time was `over`.
    """
    vehicle, period = setup.vehicles[problem.robot], problem.measure_period
    if setup.ground is None:
        return vehicle.trajectory(state, place, time, period)
    ground = lifted(setup.ground, problem.area.dimension)
    return trajectory_to(ground, vehicle, state, place, time, period, over)


def way_along(
    problem: PlanProblem, setup: PlannerSetup, route: FloatArray, near: float, over: Over = never
) -> Trajectory | None:
    """The way from the problem's state through waypoints (r, 3), as near to corners as obstacles allow.

    None where the vehicle would come too near to something, or time was `over` before that was known.

    Args:
        problem, setup: of the robot.
        route: straight ways between its waypoints are clear.
        near: metres within which corners are passed in the open.
        over: whether time is up.
    """
    vehicle, start, period = setup.vehicles[problem.robot], problem.start_time, problem.measure_period
    if setup.ground is None:
        return routed(vehicle, problem.state, route, start, period, near=near)
    ground = lifted(setup.ground, problem.area.dimension)
    return followed(ground, vehicle, problem.state, route, start, period, over)


def homeward(
    problem: PlanProblem, setup: PlannerSetup, state: FloatArray, time: float
) -> tuple[float, float]:
    """Metres and seconds from a state to the budget's home; 0 without one, infinite where there is no way."""
    home = problem.budget.home
    if home is None or setup.vehicles[problem.robot].reached(state, home):
        return 0.0, 0.0
    back = way_to(problem, setup, state, time, home)
    return (math.inf, math.inf) if back is None else (metres(back), back.end_time - back.start_time)


def affordable(problem: PlanProblem, setup: PlannerSetup, way: Trajectory) -> bool:
    """Whether a trajectory and the way home from its end are within the budget."""
    if not limited(problem):
        return True
    budget = problem.budget
    length, seconds = metres(way), way.end_time - way.start_time
    if not (length <= budget.distance and seconds <= budget.time):
        return False
    back_metres, back_seconds = homeward(problem, setup, way.end_state, way.end_time)
    return length + back_metres <= budget.distance and seconds + back_seconds <= budget.time


def truncated(problem: PlanProblem, setup: PlannerSetup, way: Trajectory) -> Trajectory | None:
    """A trajectory from the problem's state, or as much of its beginning as the budget allows.

    None if that is nothing.

    What is cut off is estimated from straight ways home, then predicted, and cut further until it fits.
    """
    if affordable(problem, setup, way):
        return way
    budget = problem.budget
    spent = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(way.poses[:, :3], axis=0), axis=1)))
    seconds = way.times - way.start_time
    back = 0.0 if budget.home is None else np.linalg.norm(way.poses[:, :3] - budget.home, axis=1)
    speed = spent[-1] / seconds[-1] if seconds[-1] > 0 and spent[-1] > 0 else math.inf
    fits = (spent + back <= budget.distance) & (seconds + back / speed <= budget.time)
    last = int(np.flatnonzero(fits)[-1]) if fits.any() else 0
    for _ in range(TRIES):
        if last < 1:
            return None
        passed = way.route[np.append(way.route_times[1:], math.inf) <= way.times[last]]
        route = np.vstack([passed, way.poses[last, :3]])
        part = way_along(problem, setup, route, NEAR_M)
        if part is not None and part.end_time > part.start_time and affordable(problem, setup, part):
            return part
        last = min(last - 1, int(SHORTER * last))
    return None


def returning(problem: PlanProblem, setup: PlannerSetup, why: str) -> Plan:
    """The way home if it is affordable and free, otherwise a hold; `why` says why there is nothing better."""
    home = problem.budget.home
    vehicle = setup.vehicles[problem.robot]
    if home is None:
        return Plan(None, f"holds: {why}")
    if vehicle.reached(problem.state, home):
        return Plan(None, f"holds at home: {why}")
    back = way_to(problem, setup, problem.state, problem.start_time, home)
    if back is None or not affordable(problem, setup, back):
        return Plan(None, f"holds: {why}, and the way home is beyond its budget")
    if not keeps_apart(problem, vehicle, back):
        return Plan(None, f"holds: {why}, and another robot is in the way home")
    return Plan(back, f"returns home: {why}")
