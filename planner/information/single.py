"""Planner `mutual_information`: one robot maximises what the team's next measurements say of the targets.

Dames & Kumar 2015 (see `entropy`). Each robot optimises its own action given the poses at which the others
have committed to measure, which is one step of the paper's coordinate descent over robots; the next robot's
plan is the next step. It goes on to its first poses only (1/T of the way) and plans again, (III-B).

For one robot, modes 0 to 3 are the same: the best of all scales is the best of the scales' best.
"""

import math
from typing import ClassVar

import numpy as np

from estimator.arrays import FloatArray
from estimator.metrics.information import is_settled
from planner.budget import limited, returning
from planner.deadline import Deadline
from planner.information.belief import believed
from planner.information.config import InformationConfig
from planner.information.events import committed, nearest
from planner.information.following import Chosen, Following, in_order
from planner.information.gains import information
from planner.information.reach import Reach, Reaches
from planner.maasi.maasi import unplannable
from planner.plan import Intensity, Plan, PlannerSetup, PlanProblem

MODES_BY_SCALE = (1, 3, 5)  # one length scale for all robots
RANDOM = (4, 5)
TIMELY = 12  # robot-steps whose outcomes, of one action, take less than a millisecond
LATE = "holds: its deadline passed before it had any action"


class MutualInformation:
    """Planner: the action whose measurements, with those of the others, say most of the targets."""

    Config: ClassVar[type[InformationConfig]] = InformationConfig

    def __init__(self, config: InformationConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        self.deadline = Deadline
        self.reaches = Reaches(config, setup)
        self.following = Following(setup, min(1.0, config.replan_after / config.steps))
        self._thinned: tuple[Intensity, FloatArray, FloatArray] | None = None  # for robots that plan together

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The way to the first of the best action's poses; a hold with the reason where there is none."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = self.deadline(problem.deadline_s)
        if deadline.left() <= self.following.reserve.seconds:
            return self.late()
        found, points, weights = self.prepared(problem)
        if found is not None:
            return found
        config, choosing = self.config, deadline.less(self.following.reserve.seconds)
        events = committed(problem, self.setup, points, config.steps, over=choosing.over)
        if choosing.over():
            return self.late()
        here = self.setup.vehicles[problem.robot].pose(problem.state)[: len(points)]
        room = max(0, self.exact_steps(deadline) - config.steps)
        fixed, neglected = nearest(events, points, weights, here, room, config.taylor_terms)
        reach: Reach | None = None
        values, error = np.zeros(0), 0.0
        for reach in self.reaches.parts(problem, points, weights, choosing):
            if not values.size:
                values = np.full(len(reach.actions.corners), -np.inf)
            values[reach.rows] = information(fixed, reach.options)
            error = max(error, float(reach.options.error.max(initial=0.0)))
        if reach is None or not values.size:
            return self.nowhere(problem, late=reach is None)
        error += neglected + fixed.error
        order = self._drawn(problem, reach, values) if config.mode in RANDOM else in_order(values)
        told = [float(values[i]) for i in order]
        note = "" if len(order) == values.size else ", the best when its time was up"
        chosen = Chosen(reach.actions, order, told, fixed.information, error, note)
        return self.following.plan(problem, chosen, deadline, pointless=config.mode in RANDOM)

    def exact_steps(self, deadline: Deadline) -> int:
        """Robot-steps whose information is exact, no more with a deadline than can be worked out in a go."""
        most = self.config.exact_steps
        return most if math.isinf(deadline.seconds) else min(most, TIMELY)

    def prepared(self, problem: PlanProblem) -> tuple[Plan | None, FloatArray, FloatArray]:
        """A plan if nothing is to be looked for; else the points and weights of what is."""
        config, d = self.config, problem.area.dimension
        none = np.zeros((d, 0)), np.zeros(0)
        intensity = problem.intensity
        if config.settled is not None and intensity is not None:
            points, weights = intensity.points, intensity.weights
            whole = np.isfinite(points).all() and np.isfinite(weights).all() and (weights >= 0.0).all()
            if whole and weights.size and is_settled(points, weights, config.settled_cell_m, config.settled):
                return returning(problem, self.setup, "the search is over, targets are known"), *none
        if intensity is not None and self._thinned is not None and self._thinned[0] is intensity:
            return None, *self._thinned[1:]
        points, weights = believed(problem, config.points, config.cell_m, config.expected_targets)
        if weights.size == 0:
            return returning(problem, self.setup, "no target is believed to be anywhere"), *none
        if intensity is not None:
            self._thinned = intensity, points, weights
        return None, points, weights

    def late(self) -> Plan:
        """A hold before there was any action; less time is kept for ways then, or it might stay so."""
        self.following.reserve.refused()
        return Plan(None, LATE)

    def nowhere(self, problem: PlanProblem, *, late: bool) -> Plan:
        """A robot without an action, or without one in time."""
        if late:
            return self.late()
        why = "no place at the distance of a length scale is in the area and can be reached"
        return returning(problem, self.setup, why) if limited(problem) else Plan(None, f"holds: {why}")

    def _drawn(self, problem: PlanProblem, reach: Reach, values: FloatArray) -> list[int]:
        """Modes 4 and 5: actions at random; of those drawn one per scale, the most informative first."""
        rng = np.random.default_rng(problem.seed)
        drawn = [int(i) for i in rng.permutation(values.size) if np.isfinite(values[i])]
        if self.config.mode in MODES_BY_SCALE:
            lengths = reach.actions.lengths
            one = {float(lengths[i]): i for i in reversed(drawn)}
            best = sorted(one.values(), key=lambda i: -values[i])
            drawn = best + [i for i in drawn if i not in best]
        return drawn
