"""To the nearest cluster, then to the widest, then to the nearest, and so on.

Source: Sung and Tokekar, "GM-PHD filter for searching and tracking an unknown number of targets with a mobile
sensor with limited FOV", IEEE T-ASE, 2022, as (MA)ASI section 5.1 adapts it: clusters instead of Gaussian
components, and the two strategies in turn. There targets that nobody has seen are particles like all others
and K-means makes wide clusters of them; here the filter keeps them apart, and what is unexplored is cut into
regions of equal mass that count as clusters as wide as they are. Robots of a team choose independently.
"""

from collections.abc import Callable
from typing import ClassVar

import msgspec
import numpy as np

from estimator.arrays import BoolArray, Count, FloatArray
from planner.allocation.partition import equal_shares
from planner.baselines.choice import Option, Pace, taken
from planner.deadline import Deadline, Reserve
from planner.maasi.maasi import LATE, unplannable
from planner.plan import Plan, PlannerSetup, PlanProblem

CUT_S = 1e-3  # that cutting the unexplored may take, before it was measured
NOTHING = 1e-3  # a grid point that is less unexplored than this is explored


class NearestWidestConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the unexplored is cut."""

    regions: Count = 8  # of equal unexplored mass


class NearestWidest:
    """Planner: clusters in turn by distance and by width. Remembers each robot's turn."""

    Config: ClassVar[type[NearestWidestConfig]] = NearestWidestConfig
    deadline: Callable[[float], Deadline] = Deadline  # tests give it another clock

    def __init__(self, config: NearestWidestConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        self._widest: dict[str, bool] = {}  # whose turn is the widest
        self._pace, self._cutting = Pace(), Reserve(CUT_S)

    def __repr__(self) -> str:
        return f"NearestWidest({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The way to the cluster whose turn it is; a hold with the reason where there is none."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = self.deadline(problem.deadline_s)
        widest = self._widest.get(problem.robot, False)
        if not self._cutting.fits(deadline):
            return Plan(None, LATE)
        with self._cutting.measured(deadline):
            centres, widths, seen = self._clusters(problem)
        here = self.setup.vehicles[problem.robot].pose(problem.state)[:3]
        far = np.linalg.norm(centres - here, axis=1)
        order = np.argsort(-widths if widest else np.where(seen, far, far + far.sum() + 1.0), kind="stable")
        word = "widest" if widest else "nearest"
        options = (
            Option(
                centres[i],
                f"{word} {'cluster' if seen[i] else 'unexplored region'}, {far[i]:.1f} m off, "
                f"{widths[i]:.1f} m wide",
                terms={"distance": float(far[i]), "width": float(widths[i])},
            )
            for i in order
        )
        nothing = "there is no cluster and nothing is unexplored"
        plan = taken(problem, self.setup, options, deadline, self._pace, nothing)
        if plan.trajectory is not None:
            self._widest[problem.robot] = not widest
        return plan

    def _clusters(self, problem: PlanProblem) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Centres (c, 3), widths (c,) in metres per axis, and whether somebody has seen something there."""
        d, known = problem.area.dimension, problem.intensity
        widths = np.zeros(problem.clusters.shape[1])
        if known is not None and len(known.covariances) == len(widths):
            widths = np.sqrt(np.maximum(np.trace(known.covariances, axis1=1, axis2=2), 0.0) / d)
        e = problem.exploration
        mass = np.where(np.isfinite(e.values), e.values, 0.0).ravel()
        mass[mass < NOTHING] = 0.0
        nodes = e.nodes()
        labels, _ = equal_shares(nodes, mass, self.config.regions)
        places, spreads = [problem.clusters], [np.nan_to_num(widths)]
        for label in range(int(labels.max(initial=-1)) + 1):
            rows = labels == label
            middle = np.average(nodes[:, rows], axis=1, weights=mass[rows])
            square = ((nodes[:, rows] - middle[:, None]) ** 2).sum(axis=0)
            places.append(middle[:, None])
            spreads.append(np.sqrt(np.average(square, weights=mass[rows], keepdims=True) / d))
        found, spread = np.hstack(places), np.concatenate(spreads)
        good = np.isfinite(found).all(axis=0)
        centres = np.full((int(good.sum()), 3), self.setup.vehicles[problem.robot].pose(problem.state)[2])
        centres[:, :d] = np.clip(found[:, good].T, problem.area.low, problem.area.high)
        seen = np.arange(found.shape[1]) < problem.clusters.shape[1]
        return centres, spread[good], seen[good]
