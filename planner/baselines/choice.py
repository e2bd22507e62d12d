"""From places with a value to a plan: the best place whose way is open, free of others and affordable."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from estimator.arrays import FloatArray
from planner.budget import affordable, limited, returning, way_to
from planner.deadline import Deadline, Reserve
from planner.maasi.anytime import batches
from planner.maasi.maasi import CHECKS_S, LATE, LATE_WAY, ONE_S, RESERVE_S, crowded
from planner.others import Others
from planner.plan import Over, Plan, PlannerSetup, PlanProblem, Trajectory
from planner.separation import keeps_apart


@dataclass(frozen=True, slots=True)
class Option:
    """A place to go, and what to say of it."""

    place: FloatArray  # (3,)
    reason: str
    objective: float = 0.0
    terms: Mapping[str, float] = field(default_factory=dict)


class Pace:
    """What the steps of a planner that chooses among options take, as measured."""

    def __init__(self) -> None:
        self.valued = Reserve(ONE_S, yields=True)  # one option
        self.tried = Reserve(RESERVE_S, yields=True)  # its way and what is asked of that


def taken(
    problem: PlanProblem,
    setup: PlannerSetup,
    options: Iterable[Option],
    deadline: Deadline,
    pace: Pace,
    nothing: str,
    others: Others | None = None,
) -> Plan:
    """The plan of the first option that may be taken; otherwise a hold or the way home, with the reason.

    Args:
        problem, setup: of the robot.
        options: best first.
        deadline: by which the plan must be there.
        pace: of the planner.
        nothing: the reason in words if there is no option at all.
        others: those of the problem, where somebody has looked at them already.
    """
    plan = first_of(problem, setup, options, deadline, pace, nothing, others)
    if plan.trajectory is None and limited(problem):
        return returning(problem, setup, _plainly(plan.reason))
    return plan


def first_of(
    problem: PlanProblem,
    setup: PlannerSetup,
    options: Iterable[Option],
    deadline: Deadline,
    pace: Pace,
    nothing: str,
    others: Others | None = None,
) -> Plan:
    """As `taken`, but it never returns home."""
    why = nothing
    heard = others or Others(problem.others, problem)
    for option in options:
        if not pace.tried.fits(deadline):
            why = _plainly(LATE) if why == nothing else why
            break
        with pace.tried.measured(deadline):
            way, why = _way(problem, setup, option, heard, deadline.less(CHECKS_S).over)
        if way is not None:
            return Plan(way, option.reason, option.objective, option.terms)
    return Plan(None, f"holds: {why}")


def _way(
    problem: PlanProblem, setup: PlannerSetup, option: Option, others: Others, over: Over
) -> tuple[Trajectory | None, str]:
    """The way to an option, or why it may not be taken."""
    d = problem.area.dimension
    if setup.ground is not None and not setup.ground.clear(option.place[:d, None])[0]:
        return None, "what it would go to lies in an obstacle"
    way = way_to(problem, setup, problem.state, problem.start_time, option.place, over)
    if way is None:
        return None, _plainly(LATE_WAY) if over() else "there is no way to where it would go"
    if way.end_time <= way.start_time:
        return None, "it is where it would go already"
    if not keeps_apart(problem, setup.vehicles[problem.robot], way, others.courses):
        return None, _plainly(crowded(problem.separation))
    if not affordable(problem, setup, way):
        return None, "its budget allows no way that is worth going"
    return way, ""


def _plainly(reason: str) -> str:
    return reason.removeprefix("holds: ")


def best_of(
    problem: PlanProblem,
    setup: PlannerSetup,
    deadline: Deadline,
    pace: Pace,
    waypoints: FloatArray,
    value: Callable[[FloatArray, Over], FloatArray],
    nothing: str,
    others: Others | None = None,
) -> Plan:
    """The plan to the waypoint (w, 3) of the highest value, of those that there was time to value.

    Args:
        problem, setup, deadline, pace, nothing, others: as of `taken`.
        waypoints: where it may go; of equals the first counts.
        value: of some waypoints (b, 3) -> (b,), worked out until time is over; not finite means no choice.
    """
    options, reason = best_first(deadline, pace, waypoints, value, nothing)
    return taken(problem, setup, options, deadline, pace, reason, others)


def best_first(
    deadline: Deadline,
    pace: Pace,
    waypoints: FloatArray,
    value: Callable[[FloatArray, Over], FloatArray],
    nothing: str,
) -> tuple[list[Option], str]:
    """The waypoints that there was time to value, and what to say if there are none; see `best_of`."""
    values = np.full(len(waypoints), -np.inf)
    reason = nothing
    choosing = deadline.less(pace.tried.kept(deadline))
    for batch in batches(len(waypoints), choosing, pace.valued):
        found = value(waypoints[batch], choosing.over)
        values[batch] = np.where(np.isfinite(found), found, -np.inf)
    if choosing.left() <= pace.valued.kept(choosing) and not np.isfinite(values).any():
        reason = _plainly(LATE)
    order = np.argsort(-values, kind="stable")[: int(np.isfinite(values).sum())]
    options = [
        Option(
            waypoints[i],
            f"candidate {i} at ({', '.join(f'{x:.1f}' for x in waypoints[i])})",
            float(values[i]),
        )
        for i in order
    ]
    return options, reason
