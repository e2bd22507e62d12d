"""Active search by steps: to the best neighbour at a constant distance, measuring only there (AS, MAAS).

Source: Yousuf, Lendek, Buşoniu, "Exploration-based planning for multiple-target search with real-drone
results", Sensors, 2024 (one robot) and "Multi-agent exploration-based search for an unknown number of
targets", IFAC World Congress, 2023 (several), as (MA)ASI sections 5.1 and 7.1.1 describe them: candidates in
the directions of the axes, no control cost, one measurement at each waypoint. There the robots choose jointly
and step at the same time; here each chooses given what the others have committed to.

That nothing is measured between waypoints is up to the mission: a robot measures by its own clock unless
`[trigger]` has a threshold that no look reaches.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import msgspec
import numpy as np

from estimator.arrays import FloatArray, NonNegative, Positive
from planner.baselines.choice import Pace, best_of
from planner.deadline import Deadline
from planner.maasi.coverage import cell_corners
from planner.maasi.maasi import unplannable
from planner.maasi.outlook import others_looks
from planner.maasi.ways import ways
from planner.others import Others
from planner.plan import Over, Plan, PlannerSetup, PlanProblem

STEPS = 20  # of the area's longest side, where the mission names no step


class AsStepsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The weights of the objective, and how far a step goes."""

    alpha: NonNegative = 0.5  # of target refinement
    beta: NonNegative = 0.5  # of exploration
    step_m: Positive | None = None  # to the next waypoint; none: a twentieth of the area's longest side


class AsSteps:
    """Planner: the neighbour with the highest alpha T + beta E of the one measurement taken there."""

    Config: ClassVar[type[AsStepsConfig]] = AsStepsConfig
    deadline: Callable[[float], Deadline] = Deadline  # tests give it another clock

    def __init__(self, config: AsStepsConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        side = float((setup.area.high - setup.area.low).max())
        self.step = config.step_m or side / STEPS
        self._pace = Pace()

    def __repr__(self) -> str:
        return f"AsSteps({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """One step; a hold with the reason where there is none. Equal neighbours are drawn from."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = self.deadline(problem.deadline_s)
        waypoints = self._neighbours(problem)
        np.random.default_rng(problem.seed).shuffle(waypoints)
        others = Others(problem.others, problem)
        plan = best_of(
            problem,
            self.setup,
            deadline,
            self._pace,
            waypoints,
            lambda some, over: self._value(problem, others, some, over),
            "no neighbour lies in the area",
            others,
        )
        way = plan.trajectory
        if way is None:
            return plan
        once = replace(way, measure_times=way.measure_times[:1], measure_poses=way.measure_poses[:1])
        return replace(plan, trajectory=once)

    def _neighbours(self, problem: PlanProblem) -> FloatArray:
        """(w, 3) within the area; for a robot outside it, the nearest place within."""
        here = self.setup.vehicles[problem.robot].pose(problem.state)[:3]
        low, high, d = problem.area.low, problem.area.high, problem.area.dimension
        if not ((here[:d] >= low) & (here[:d] <= high)).all():
            inside = here.copy()
            inside[:d] = np.clip(here[:d], low, high)
            return np.asarray(inside[None])
        steps = np.zeros((2 * d, 3))
        steps[np.arange(2 * d), np.arange(2 * d) // 2] = np.tile([self.step, -self.step], d)
        places = here + steps
        return np.asarray(places[((places[:, :d] >= low) & (places[:, :d] <= high)).all(axis=1)])

    def _value(self, problem: PlanProblem, others: Others, waypoints: FloatArray, over: Over) -> FloatArray:
        """alpha T + beta E (w,) of one measurement at each waypoint (w, 3), (19), (32)."""
        vehicle, sensor = self.setup.vehicles[problem.robot], self.setup.sensors[problem.robot]
        way = ways(problem, self.setup, waypoints, problem.measure_period, over)
        poses = np.array([vehicle.pose(state) for state in way.end_states]).reshape(-1, 4)
        d = problem.exploration.values.ndim
        corners, shares = cell_corners(problem.exploration, poses[:, :d])
        arrivals = problem.start_time + way.steps * vehicle.control_period
        others_looks(problem, self.setup, others, np.repeat(arrivals, 1 << d), corners, shares, over)
        clusters = problem.clusters[:, np.isfinite(problem.clusters).all(axis=0)]
        refinement = np.zeros(len(poses))
        if clusters.shape[1] and len(poses):
            refinement = sensor.detection(np.ascontiguousarray(clusters), poses).sum(axis=1)
        gain = self.config.alpha * refinement + self.config.beta * shares.reshape(len(poses), -1).sum(axis=1)
        return np.where(way.steps > 0, gain, -np.inf)
