"""Thompson sampling of the posterior: each robot draws where targets may be and goes to look there.

Source: Banerjee, Ghods, Schneider, "Decentralized multi-agent active search and tracking when targets
outnumber agents" (DecSTER), 2023: every robot draws a sample of the targets' positions from its own posterior
and takes the action with the best outcome as if the sample were true. That robots draw differently keeps them
from all doing the same, without a centre and without knowing each other's plans. There the posterior is that
of a PHD filter too and actions are places; here the draw is of the whole intensity, undetected targets among
it, as a Poisson process, and the action is the way to a waypoint with all its looks. Others' plans matter
only for separation.
"""

from collections.abc import Callable
from typing import ClassVar

import msgspec
import numpy as np

from estimator.arrays import Count, FloatArray
from estimator.sensor import SensorModel
from planner.baselines.choice import Pace, best_of
from planner.deadline import Deadline
from planner.maasi.candidates import CandidateGrid
from planner.maasi.maasi import DEFAULT_POINTS, unplannable
from planner.maasi.ways import ways
from planner.plan import Over, Plan, PlannerSetup, PlanProblem

CERTAIN = 1e-12  # no look misses with less than this


class ThompsonConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is drawn, and where to go."""

    most_targets: Count = 64  # that a draw has, at most
    places: Count = 8  # of drawn targets that are candidates too
    candidates: CandidateGrid | None = None  # none: a grid over the area


class Thompson:
    """Planner: the way on which most of the drawn targets would be detected, per time."""

    Config: ClassVar[type[ThompsonConfig]] = ThompsonConfig
    deadline: Callable[[float], Deadline] = Deadline  # tests give it another clock

    def __init__(self, config: ThompsonConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        points = DEFAULT_POINTS[setup.area.dimension]
        self.candidates = config.candidates or CandidateGrid.over(setup.area, points)
        self._pace = Pace()

    def __repr__(self) -> str:
        return f"Thompson({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The best way for one draw of the targets; a hold where nothing is believed to be left."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = self.deadline(problem.deadline_s)
        targets = self.drawn(problem, np.random.default_rng(problem.seed))
        if not targets.shape[1]:
            return Plan(None, "holds: no target is believed to be left")
        altitude = float(self.setup.vehicles[problem.robot].pose(problem.state)[2])
        own = np.full((min(self.config.places, targets.shape[1]), 3), altitude)
        own[:, : len(targets)] = np.clip(targets[:, : len(own)].T, problem.area.low, problem.area.high)
        waypoints = np.vstack([own, self.candidates.waypoints(altitude)])
        return best_of(
            problem,
            self.setup,
            deadline,
            self._pace,
            waypoints,
            lambda some, over: self._value(problem, targets, some, over),
            "it is at its only candidate already",
        )

    def drawn(self, problem: PlanProblem, rng: np.random.Generator) -> FloatArray:
        """Targets (d, t) drawn from the intensity as a Poisson process, at least one if there may be any.

        Without an intensity, one target from what is unexplored.
        """
        known = problem.intensity
        if known is not None:
            points, weights = known.points, known.weights
        else:
            points, weights = problem.exploration.nodes(), problem.exploration.values.ravel()
        good = np.isfinite(points).all(axis=0) & np.isfinite(weights) & (weights > 0)
        points, weights = points[:, good], weights[good]
        total = float(weights.sum())
        if not total > 0:
            return np.zeros((problem.area.dimension, 0))
        most = self.config.most_targets
        count = 1 if known is None else int(rng.poisson(min(total, 10.0 * most)))
        rows = rng.choice(weights.size, size=min(max(count, 1), most), p=weights / total)
        return np.ascontiguousarray(points[:, rows])

    def _value(
        self, problem: PlanProblem, targets: FloatArray, waypoints: FloatArray, over: Over
    ) -> FloatArray:
        """Expected number (w,) of drawn targets detected on the way to each waypoint (w, 3), per second.

        The look at the start, which all ways share, does not count; that on arrival does.
        """
        vehicle, sensor = self.setup.vehicles[problem.robot], self.setup.sensors[problem.robot]
        way = ways(problem, self.setup, waypoints, problem.measure_period, over)
        seconds = way.steps * vehicle.control_period
        detected = np.zeros(len(waypoints))
        if len(way.measure_poses):
            ends = np.array([vehicle.pose(state) for state in way.end_states])
            missed = _log_missed(sensor, targets, way.measure_poses)
            upto = np.vstack([np.zeros((1, missed.shape[1])), np.cumsum(missed, axis=0)])
            first = np.minimum(way.offsets[:-1] + 1, way.offsets[1:])
            all_missed = upto[way.offsets[1:]] - upto[first] + _log_missed(sensor, targets, ends)
            detected = (1.0 - np.exp(all_missed)).sum(axis=1)
        return np.where(way.steps > 0, detected / np.maximum(seconds, problem.measure_period), -np.inf)


def _log_missed(sensor: SensorModel, targets: FloatArray, poses: FloatArray) -> FloatArray:
    """log(1 - p_D) (k, t) of targets (d, t) from poses (k, 4)."""
    return np.asarray(np.log(np.maximum(1.0 - sensor.detection(targets, poses), CERTAIN)))
