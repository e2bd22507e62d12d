"""From places with a value to a plan: the best place whose way is open, free of others and affordable."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from estimator.arrays import FloatArray
from planner.budget import affordable, limited, returning, way_to
from planner.deadline import Deadline
from planner.maasi.anytime import batches
from planner.maasi.maasi import AROUND_S, LATE, crowded
from planner.plan import Plan, PlannerSetup, PlanProblem
from planner.separation import keeps_apart


@dataclass(frozen=True, slots=True)
class Option:
    """A place to go, and what to say of it."""

    place: FloatArray  # (3,)
    reason: str
    objective: float = 0.0
    terms: Mapping[str, float] = field(default_factory=dict)


def taken(
    problem: PlanProblem, setup: PlannerSetup, options: Iterable[Option], deadline: Deadline, nothing: str
) -> Plan:
    """The plan of the first option that may be taken; otherwise a hold or the way home, with the reason.

    Args:
        problem, setup: of the robot.
        options: best first.
        deadline: after which no further option is tried.
        nothing: the reason in words if there is no option at all.
    """
    d, why = problem.area.dimension, nothing
    for option in options:
        if deadline.over():
            why = LATE.removeprefix("holds: ") if why == nothing else why
            break
        if setup.ground is not None and not setup.ground.clear(option.place[:d, None])[0]:
            why = "what it would go to lies in an obstacle"
            continue
        way = way_to(problem, setup, problem.state, problem.start_time, option.place)
        if way is None:
            why = "there is no way to where it would go"
        elif way.end_time <= way.start_time:
            why = "it is where it would go already"
        elif not keeps_apart(problem, setup.vehicles[problem.robot], way):
            why = crowded(problem.separation).removeprefix("holds: ")
        elif not affordable(problem, setup, way):
            why = "its budget allows no way that is worth going"
        else:
            return Plan(way, option.reason, option.objective, option.terms)
    return returning(problem, setup, why) if limited(problem) else Plan(None, f"holds: {why}")


def best_of(
    problem: PlanProblem,
    setup: PlannerSetup,
    deadline: Deadline,
    waypoints: FloatArray,
    value: Callable[[FloatArray], FloatArray],
    nothing: str,
) -> Plan:
    """The plan to the waypoint (w, 3) of the highest value, of those that there was time to value.

    Args:
        problem, setup, deadline, nothing: as of `taken`.
        waypoints: where it may go; of equals the first counts.
        value: of some waypoints (b, 3) -> (b,); not finite means that it is no choice.
    """
    values = np.full(len(waypoints), -np.inf)
    reason = nothing
    for batch in batches(len(waypoints), deadline, 0.0 if setup.ground is None else AROUND_S):
        found = value(waypoints[batch])
        values[batch] = np.where(np.isfinite(found), found, -np.inf)
    if deadline.over() and not np.isfinite(values).any():
        reason = LATE.removeprefix("holds: ")
    best_first = np.argsort(-values, kind="stable")[: int(np.isfinite(values).sum())]
    options = (
        Option(
            waypoints[i],
            f"candidate {i} at ({', '.join(f'{x:.1f}' for x in waypoints[i])})",
            float(values[i]),
        )
        for i in best_first
    )
    return taken(problem, setup, options, deadline, reason)
