"""The (MA)ASI planner of one robot, conditioned on what the others have committed to.

Source: Yousuf, Herzal, Lendek, Buşoniu, "Multi-agent active multi-target search with intermittent
measurements", Control Engineering Practice, 2024, sections 4 and 6. The paper plans in a centre, jointly for
all robots that need a plan at the same instant (see `maasi_joint`); here each plans for itself, and all
others are "continuing agents" whose trajectories it knows.
"""

from typing import ClassVar

import msgspec
import numpy as np

from estimator.arrays import FloatArray, NonNegative
from planner.maasi.candidates import CandidateGrid
from planner.maasi.outlook import Outlook, outlook
from planner.plan import Plan, PlannerSetup, PlanProblem

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

    def __init__(self, config: MaasiConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        self.candidates = config.candidates or CandidateGrid.over(
            setup.area, DEFAULT_POINTS[setup.area.dimension]
        )

    def __repr__(self) -> str:
        return f"Maasi({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The best candidate's trajectory; a hold with the reason where there is none."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        vehicle = self.setup.vehicles[problem.robot]
        waypoints = self.candidates.waypoints(float(vehicle.pose(problem.state)[2]))
        view = outlook(problem, self.setup, waypoints, problem.others)
        objective = scored(view, view.exploration, self.config)
        possible = np.isfinite(objective)
        if not possible.any():
            return Plan(None, nowhere(view))
        if not (possible & view.clear).any():
            return Plan(None, crowded(problem.separation))
        best = int(np.argmax(np.where(possible & view.clear, objective, -np.inf)))
        return chosen(problem, self.setup, view, best, view.exploration[best], float(objective[best]))


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
    return ""


def nowhere(view: Outlook) -> str:
    """The reason to hold when no candidate has a value."""
    if (view.steps > 0).any():
        return "holds: the value of every candidate is not a number; clusters or exploration are damaged"
    return "holds: it is at its only candidate waypoint already"


def crowded(separation: float) -> str:
    """The reason to hold when no way keeps the separation."""
    return f"holds: every way comes nearer than {separation:g} m to another robot"


def chosen(
    problem: PlanProblem, setup: PlannerSetup, view: Outlook, best: int, exploration: float, objective: float
) -> Plan:
    """The plan that goes to candidate `best`."""
    trajectory = setup.vehicles[problem.robot].trajectory(
        problem.state, view.predictions.waypoints[best], problem.start_time, problem.measure_period
    )
    terms = {
        "control": float(view.control[best]),
        "refinement": float(view.refinement[best]),
        "exploration": float(exploration),
        "steps": float(view.steps[best]),
    }
    place = ", ".join(f"{x:.1f}" for x in trajectory.waypoint)
    return Plan(trajectory, f"candidate {best} at ({place})", objective, terms)
