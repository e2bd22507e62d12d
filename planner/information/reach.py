"""What one robot could do and what it would measure: its actions, in parts as long as there is time."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from planner.deadline import Deadline, Reserve
from planner.information.actions import ActionSet, Lattice, Scales, action_set, looks_along
from planner.information.belief import clutter_rate
from planner.information.config import InformationConfig
from planner.information.gains import Options, options
from planner.maasi.anytime import batches
from planner.plan import PlannerSetup, PlanProblem

LATTICE = 40  # places along the longest side
SEARCH = 0.5  # of the time there is may go into finding ways
ONE_S = 3e-4  # that one action may take, before it was measured


@dataclass(frozen=True, slots=True)
class Reach:
    """Some of one robot's actions, or all."""

    actions: ActionSet
    rows: IntArray  # (r,) numbers of the actions that the options are of
    options: Options


class Reaches:
    """Finds and evaluates the actions of one team's robots."""

    def __init__(self, config: InformationConfig, setup: PlannerSetup) -> None:
        longest = float((setup.area.high - setup.area.low).max())
        first = config.first_scale_m or longest / 8
        self._config, self._setup = config, setup
        self._scales = Scales(first, config.growth, config.scales, config.steps, config.spread)
        spacing = config.lattice_m or longest / LATTICE
        self._lattice = None if setup.ground is None else Lattice(setup.area, setup.ground, spacing)
        self._turns: dict[int, bool] = {}
        self._one = Reserve(ONE_S)

    def __repr__(self) -> str:
        return f"Reaches({self._scales!r})"

    def parts(
        self, problem: PlanProblem, points: FloatArray, weights: FloatArray, deadline: Deadline
    ) -> Iterator[Reach]:
        """A robot's actions: all at once without a deadline, else a few at a time, spread over all, until it.

        No part: time was up before the first. A part of no action: there is none.

        Args:
            points, weights: where targets may be (d, n), (n,).
        """
        robot, config = problem.robot, self._config
        vehicle, sensor = self._setup.vehicles[robot], self._setup.sensors[robot]
        if id(vehicle) not in self._turns:
            self._turns[id(vehicle)] = looks_along(vehicle)
        if deadline.over():
            return
        left = deadline.left()
        searching = deadline if math.isinf(left) else deadline.less((1.0 - SEARCH) * left)
        actions = action_set(
            vehicle.pose(problem.state),
            problem.area,
            self._scales,
            turns=self._turns[id(vehicle)],
            ground=self._setup.ground,
            lattice=self._lattice,
            over=searching.over,
        )
        clutter = np.full(config.steps, clutter_rate(sensor))
        if not actions.corners and not searching.over():
            none = np.zeros((0, config.steps, weights.size))
            yield Reach(actions, np.zeros(0, np.int64), options(none, weights, clutter, config.taylor_terms))
        for rows in batches(len(actions.corners), deadline, self._one):
            poses = np.ascontiguousarray(actions.poses[rows].reshape(-1, 4))
            detection = sensor.detection(points, poses).reshape(-1, config.steps, weights.size)
            yield Reach(actions, rows, options(detection, weights, clutter, config.taylor_terms))
