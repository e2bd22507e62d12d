"""What a way costs, the way home from its end included, and the part of it that can be afforded.

Both ways are predicted by the vehicle's own model, so that turns, climbs and stops count. Metres are those
between a trajectory's samples.
"""

import math
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from planner.ground.routes import followed, lifted, trajectory_to
from planner.plan import Budget, Over, Plan, PlannerSetup, PlanProblem, Trajectory, VehicleModel, never
from planner.separation import keeps_apart
from planner.vehicles.power import Powered
from planner.vehicles.route import routed

NEAR_M = 1.0  # corners of a way around obstacles are passed within this
SHORTER = 0.8  # how much of a part that is still too long is tried next
TRIES = 12


def limited(problem: PlanProblem) -> bool:
    """Whether anything of the budget can run out."""
    budget = problem.budget
    return not budget.distance == budget.time == budget.energy == math.inf


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


@dataclass(frozen=True, slots=True)
class Cost:
    """What a way takes out of a budget."""

    metres: float = 0.0
    seconds: float = 0.0
    joules: float = 0.0  # 0 of a vehicle model that does not know what it consumes

    def __add__(self, other: "Cost") -> "Cost":
        return Cost(self.metres + other.metres, self.seconds + other.seconds, self.joules + other.joules)

    def within(self, budget: Budget) -> bool:
        """Whether the budget has as much of all three."""
        enough = self.metres <= budget.distance and self.seconds <= budget.time
        return enough and self.joules <= budget.energy


NO_WAY = Cost(math.inf, math.inf, math.inf)


def cost(vehicle: VehicleModel, way: Trajectory) -> Cost:
    """What a trajectory takes."""
    joules = vehicle.power.along(way.times, way.poses) if isinstance(vehicle, Powered) else 0.0
    return Cost(metres(way), way.end_time - way.start_time, joules)


def homeward(problem: PlanProblem, setup: PlannerSetup, state: FloatArray, time: float) -> Cost:
    """Of the way from a state to the budget's home: nothing without one, NO_WAY where there is no way."""
    home, vehicle = problem.budget.home, setup.vehicles[problem.robot]
    if home is None or vehicle.reached(state, home):
        return Cost()
    back = way_to(problem, setup, state, time, home)
    return NO_WAY if back is None else cost(vehicle, back)


def affordable(problem: PlanProblem, setup: PlannerSetup, way: Trajectory) -> bool:
    """Whether a trajectory and the way home from its end are within the budget."""
    if not limited(problem):
        return True
    out = cost(setup.vehicles[problem.robot], way)
    if not out.within(problem.budget):
        return False
    return (out + homeward(problem, setup, way.end_state, way.end_time)).within(problem.budget)


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
