"""Going to what is unexplored, while no target is known; and what of a way may be driven."""

import numpy as np

from estimator.arrays import FloatArray
from planner.budget import affordable, limited, returning, truncated, way_to
from planner.deadline import Deadline, Reserve
from planner.maasi.maasi import crowded
from planner.mpc.part import begun
from planner.plan import Plan, PlannerSetup, PlanProblem, Trajectory
from planner.separation import keeps_apart


def searching(
    problem: PlanProblem,
    setup: PlannerSetup,
    places: FloatArray,
    weights: FloatArray,
    seconds: float,
    deadline: Deadline,
    reserve: Reserve,
) -> Plan:
    """The first seconds of the way to where, for its distance, most is unexplored.

    Args:
        problem: in which no target is known.
        setup: of the planner.
        places: (d, c) middles of what is unexplored, with weights (c,).
        weights: of them.
        seconds: of the way that are driven.
        deadline: after which no other way is looked for.
        reserve: for finding one.
    """
    why = "all is explored and no target is known"
    pose = setup.vehicles[problem.robot].pose(problem.state)
    d, scale = problem.area.dimension, float((problem.area.high - problem.area.low).max())
    gaps = np.linalg.norm(places.T - pose[:d], axis=1)
    for cell in np.argsort(-weights / (0.1 * scale + gaps), kind="stable")[:4]:
        goal = pose[:3].copy()
        goal[:2] = places[:2, cell]
        if not reserve.fits(deadline):
            why = "there was no time to find a way"
            break
        with reserve.measured(deadline):
            way = way_to(problem, setup, problem.state, problem.start_time, goal, deadline.over)
        if way is None or not is_clear(problem, setup, way):
            why = "there is no way to what is unexplored"
            continue
        way, why = allowed(problem, setup, way, seconds)
        if way is not None:
            return Plan(way, f"searches at ({goal[0]:.1f}, {goal[1]:.1f}), no target is known")
    return held(problem, setup, why)


def held(problem: PlanProblem, setup: PlannerSetup, why: str) -> Plan:
    """Home, if the budget can run out, else nowhere."""
    return returning(problem, setup, why) if limited(problem) else Plan(None, f"holds: {why}")


def is_clear(problem: PlanProblem, setup: PlannerSetup, way: Trajectory) -> bool:
    """Whether a way, and what is left of it to its waypoint, touches no obstacle."""
    if setup.ground is None:
        return True
    places = np.vstack([way.poses[:, :3], way.waypoint])[:, : problem.area.dimension].T
    return bool(setup.ground.segments_clear(places[:, :-1].copy(), places[:, 1:].copy()).all())


def allowed(
    problem: PlanProblem, setup: PlannerSetup, way: Trajectory, seconds: float
) -> tuple[Trajectory | None, str]:
    """The first seconds of a way, if the whole keeps to the budget and apart from others; or why not."""
    if not way.end_time > way.start_time:
        return None, "it is where it should be"
    within: Trajectory | None = way
    if not affordable(problem, setup, way):
        within = truncated(problem, setup, way)
    if within is None:
        return None, "its budget allows no way"
    vehicle = setup.vehicles[problem.robot]
    if not keeps_apart(problem, vehicle, within):
        return None, crowded(problem.separation).removeprefix("holds: ")
    return begun(vehicle, problem.state, within, seconds), ""
