"""MI-only: candidates and ways as (MA)ASI, valued only by mutual information on the targets already seen.

Source: the baseline of (MA)ASI section 5.1 after Dames and Kumar, "Autonomous localization of an unknown
number of targets without data association using teams of mobile sensors", IEEE T-ASE, 2015, whose binary
events it uses, one a look: e = 1 where the sensor detects nothing. With targets a Poisson process of masses
m_c at the cluster centres, p_D = π_c there and p(X) = prod (1 - π) of a target set X, derived here:

    P(e = 1)  = exp(-Σ m_c π_c),
    I(X; e)   = h(P) - E[h(p(X))],  h(p) = -p log p - (1 - p) log(1 - p),
    E[p log p] = P Σ m_c (1 - π_c) log(1 - π_c),
    E[(1 - p) log(1 - p)] = -P + Σ_{k >= 2} E[p^k] / (k (k - 1)),  E[p^k] = exp(Σ m_c ((1 - π_c)^k - 1)).

The first terms of the series are summed; then blocks of terms, each half as long again as the one before,
with E[p^k] at the block's geometric middle: the 1 / (k (k - 1)) of all k in (a, b] add up to 1 / a - 1 / b.
Looks are summed as if they were independent.
"""

from typing import ClassVar

import msgspec
import numpy as np

from estimator.arrays import FloatArray
from planner.baselines.choice import Option, Pace, taken
from planner.deadline import Reserve
from planner.maasi.candidates import CandidateGrid
from planner.maasi.maasi import DEFAULT_POINTS, ONE_S, Maasi, MaasiConfig, unplannable
from planner.maasi.outlook import Outlook, totals
from planner.plan import Plan, PlannerSetup, PlanProblem

FIRST, GROWTH, LAST = 12, 1.5, 1e7  # terms summed one by one; blocks that grow by this factor; the end


class MiConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where to go."""

    candidates: CandidateGrid | None = None  # none: a grid over the area


class Mi(Maasi):
    """Planner: the candidate with the most mutual information per time; without a cluster any, at random."""

    Config: ClassVar[type[MiConfig]] = MiConfig  # type: ignore[assignment]

    def __init__(self, config: MiConfig, setup: PlannerSetup) -> None:
        points = DEFAULT_POINTS[setup.area.dimension]
        grid = config.candidates or CandidateGrid.over(setup.area, points)
        super().__init__(MaasiConfig(alpha=1.0, beta=0.0, control_cost=0.0, candidates=grid), setup)
        self._pace = Pace()
        self._one = Reserve(ONE_S)  # the sums over many terms do not look at the clock

    def __repr__(self) -> str:
        return f"Mi({self.candidates!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        if _believed(problem)[1].size:
            return super().plan(problem)
        deadline = self.deadline(problem.deadline_s)
        altitude = float(self.setup.vehicles[problem.robot].pose(problem.state)[2])
        places = self.candidates.waypoints(altitude)
        np.random.default_rng(problem.seed).shuffle(places)
        options = (Option(place, "no cluster to look at: a candidate at random") for place in places)
        return taken(problem, self.setup, options, deadline, self._pace, "there is no candidate")

    def value(self, problem: PlanProblem, view: Outlook) -> FloatArray:
        """Mutual information (w,) in nat, summed over the way's looks, per control step."""
        centres, masses = _believed(problem)
        looks = view.predictions
        each = np.zeros(len(looks.measure_poses))
        if each.size:
            detection = self.setup.sensors[problem.robot].detection(centres, looks.measure_poses)
            each = information(detection, masses)
        gain = totals(view.candidate, each, view.steps.size) / np.maximum(view.steps, 1)
        return np.where((view.steps > 0) & np.isfinite(gain), gain, -np.inf)


def information(detection: FloatArray, masses: FloatArray) -> FloatArray:
    """I(X; e) (r,) in nat of one binary look each, for p_D (r, c) of cluster centres of masses (c,)."""
    missed = np.log(np.maximum(1.0 - detection, 1e-300))
    nothing = np.exp(-detection @ masses)
    spread = np.where(detection < 1, (1.0 - detection) * missed, 0.0) @ masses
    inner = -nothing
    for k in range(2, FIRST + 1):
        inner += np.exp((np.exp(k * missed) - 1.0) @ masses) / (k * (k - 1))
    last = float(FIRST)
    while last < LAST:
        middle, end = last * GROWTH**0.5, last * GROWTH
        inner += np.exp((np.exp(middle * missed) - 1.0) @ masses) * (1.0 / last - 1.0 / end)
        last = end
    given = -nothing * spread - inner
    return np.asarray(np.maximum(_entropy(nothing) - given, 0.0))


def _entropy(p: FloatArray) -> FloatArray:
    inside = (p > 0) & (p < 1)
    q = np.where(inside, p, 0.5)
    return np.where(inside, -q * np.log(q) - (1 - q) * np.log(1 - q), 0.0)


def _believed(problem: PlanProblem) -> tuple[FloatArray, FloatArray]:
    """Finite cluster centres (d, c) and their masses (c,), 1 where they are not known."""
    known = problem.intensity
    if known is not None and known.means.shape == problem.clusters.shape:
        centres, masses = known.means, known.masses
    else:
        centres, masses = problem.clusters, np.ones(problem.clusters.shape[1])
    good = np.isfinite(centres).all(axis=0) & np.isfinite(masses) & (masses > 0)
    return np.ascontiguousarray(centres[:, good]), masses[good]
