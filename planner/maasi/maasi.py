"""The (MA)ASI planner of one robot, conditioned on what the others have committed to.

Source: Yousuf, Herzal, Lendek, Buşoniu, "Multi-agent active multi-target search with intermittent
measurements", Control Engineering Practice, 2024, sections 4 and 6. The paper plans in a centre, jointly for
all robots that need a plan at the same instant (see `maasi_joint`); here each plans for itself, and all
others are "continuing agents" whose trajectories it knows.
"""

import math
from collections.abc import Callable
from typing import ClassVar

import msgspec
import numpy as np

from estimator.arrays import FloatArray, NonNegative
from planner.budget import affordable, limited, returning, way_to
from planner.deadline import Deadline, Reserve
from planner.ground.routes import lifted, stuck
from planner.maasi.anytime import batches
from planner.maasi.candidates import CandidateGrid
from planner.maasi.outlook import Outlook, outlook
from planner.others import Others
from planner.plan import Over, Plan, PlannerSetup, PlanProblem, never
from planner.separation import keeps_apart

RESERVE_S = 1e-3  # that the chosen way and its checks may take, before they were measured
CHECKS_S = 1e-3  # kept free while the way is looked for, for what is asked of it then
ONE_S = 1e-3  # that a candidate may take, before it was measured
LATE = "holds: its deadline was over before a candidate was looked at"
LATE_WAY = "holds: its deadline was over before the way to a candidate was known"
NO_BUDGET = "holds: its budget allows no candidate"
DEFAULT_POINTS = {2: 4, 3: 3}  # candidates per axis where the mission names none


class MaasiConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The weights of the objective (17), (27), and where to go."""

    alpha: NonNegative = 0.5  # of target refinement
    beta: NonNegative = 0.5  # of exploration
    control_cost: NonNegative = 1.0  # of the control cost; 1 as in the paper
    candidates: CandidateGrid | None = None  # none: a grid over the area


class Maasi:
    """Planner: the candidate waypoint with the highest (-C + alpha T + beta E) / K."""

    Config: ClassVar[type[MaasiConfig]] = MaasiConfig
    deadline: Callable[[float], Deadline] = Deadline  # tests give it another clock

    def __init__(self, config: MaasiConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        self.candidates = config.candidates or CandidateGrid.over(
            setup.area, DEFAULT_POINTS[setup.area.dimension]
        )
        self._choice = Reserve(RESERVE_S, yields=True)
        self._one = Reserve(ONE_S, yields=True)

    def __repr__(self) -> str:
        return f"Maasi({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The best candidate's trajectory; a hold with the reason where there is none.

        With a deadline the best of the candidates that there was time for.
        """
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = self.deadline(problem.deadline_s)
        choosing, searching = deadline.less(self._choice.kept(deadline)), deadline.less(CHECKS_S)
        vehicle = self.setup.vehicles[problem.robot]
        waypoints = self.candidates.waypoints(float(vehicle.pose(problem.state)[2]))
        objective = np.full(len(waypoints), -np.inf)
        seen: dict[int, tuple[Outlook, int]] = {}
        reason, others = LATE, Others(problem.others, problem)
        for batch in batches(len(waypoints), choosing, self._one):
            view = outlook(problem, self.setup, waypoints[batch], others, over=choosing.over)
            value = self.value(problem, view)
            objective[batch] = np.where(view.clear, value, -np.inf)
            seen.update((int(i), (view, row)) for row, i in enumerate(batch))
            possible = bool(np.isfinite(value).any())
            reason = crowded(problem.separation) if possible else nowhere(view, self.setup.ground is None)
        best_first = np.argsort(-objective, kind="stable")[: int(np.isfinite(objective).sum())]
        for tried, best in enumerate(best_first):
            if tried and not self._choice.fits(deadline):
                break
            view, row = seen[int(best)]
            gained = float(objective[best])
            with self._choice.measured(deadline):
                plan = chosen(
                    problem, self.setup, view, row, view.exploration[row], gained, int(best), searching.over
                )
                if plan.trajectory is None:
                    reason = LATE_WAY if searching.over() else plan.reason
                elif self.setup.ground is not None and not keeps_apart(
                    problem, vehicle, plan.trajectory, others.courses
                ):
                    reason = crowded(problem.separation)  # ways around are estimates before they are chosen
                elif affordable(problem, self.setup, plan.trajectory):
                    return plan
                else:
                    reason = NO_BUDGET
        if not limited(problem):
            return Plan(None, reason)
        return returning(problem, self.setup, reason.removeprefix("holds: "))

    def value(self, problem: PlanProblem, view: Outlook) -> FloatArray:
        """J (w,) of the candidates of a view; -inf where there is none."""
        return scored(view, view.exploration, self.config)


def scored(view: Outlook, exploration: FloatArray, config: MaasiConfig) -> FloatArray:
    """J (w,), (17), (27), with E (w,); -inf where the robot stands already or a number is not finite."""
    gain = config.alpha * view.refinement + config.beta * exploration
    value = (gain - config.control_cost * view.control) / np.maximum(view.steps, 1)
    return np.where((view.steps > 0) & np.isfinite(value), value, -np.inf)


def unplannable(problem: PlanProblem, setup: PlannerSetup) -> str:
    """Why no plan can be made for this problem, in words; empty if one can."""
    if problem.robot not in setup.vehicles or problem.robot not in setup.sensors:
        return f"holds: the planner has no vehicle and sensor model of robot {problem.robot!r}"
    if not (np.isfinite(problem.state).all() and np.isfinite(problem.start_time)):
        return "holds: its state or the start time is not finite"
    if not (np.isfinite(problem.measure_period) and problem.measure_period > 0):
        return f"holds: its measurement period is {problem.measure_period:g} s, not a positive number"
    if math.isnan(problem.deadline_s):
        return "holds: its deadline is not a number"
    budget = problem.budget
    if math.isnan(budget.distance) or math.isnan(budget.time) or math.isnan(budget.energy):
        return "holds: its budget is not a number"
    if budget.home is not None and not (budget.home.shape == (3,) and np.isfinite(budget.home).all()):
        return "holds: the home of its budget is not a place"
    if setup.ground is not None:
        place = setup.vehicles[problem.robot].pose(problem.state)[:3]
        return stuck(lifted(setup.ground, problem.area.dimension), place)
    return ""


def nowhere(view: Outlook, open_area: bool = True) -> str:
    """The reason to hold when no candidate has a value."""
    if (view.steps > 0).any():
        return "holds: the value of every candidate is not a number; clusters or exploration are damaged"
    if open_area:
        return "holds: it is at its only candidate waypoint already"
    return "holds: there is no way to any other candidate waypoint"


def crowded(separation: float) -> str:
    """The reason to hold when no way keeps the separation."""
    return f"holds: every way comes nearer than {separation:g} m to another robot"


def chosen(
    problem: PlanProblem,
    setup: PlannerSetup,
    view: Outlook,
    best: int,
    exploration: float,
    objective: float,
    name: int | None = None,
    over: Over = never,
) -> Plan:
    """The plan that goes to candidate `best` of the view; people know it by the number `name`."""
    waypoint = view.predictions.waypoints[best]
    trajectory = way_to(problem, setup, problem.state, problem.start_time, waypoint, over)
    if trajectory is None:
        return Plan(None, "holds: there is no way to its candidate")
    terms = {
        "control": float(view.control[best]),
        "refinement": float(view.refinement[best]),
        "exploration": float(exploration),
        "steps": float(view.steps[best]),
    }
    place = ", ".join(f"{x:.1f}" for x in trajectory.waypoint)
    return Plan(trajectory, f"candidate {best if name is None else name} at ({place})", objective, terms)
