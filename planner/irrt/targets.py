"""What there is to be known better: estimated targets, and undiscovered ones where little is explored."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from planner.plan import PlanProblem

CELLS = {2: (5, 5), 3: (4, 4, 2)}  # of the area, for what is not explored
LEAST_SPREAD = 1e-3  # metres
UNKNOWN_SPREAD = 3.0  # metres, of clusters of which only the middle is known
LEAST_WEIGHT = 1e-3  # of a cell, as a fraction unexplored


@dataclass(frozen=True, slots=True)
class Targets:
    """Modes of the targets' densities, (1): each estimated target has one."""

    means: FloatArray  # (d, n) m
    covariances: FloatArray  # (n, d, d) m^2, positive definite
    weights: FloatArray  # (n,) q_i w_i,m of (12), (13); they sum to 1
    known: int  # the first so many are estimated targets, the others cells
    velocities: FloatArray  # (d, known) m/s; 0 where nothing is known of them

    @property
    def count(self) -> int:
        return int(self.weights.size)


def targets_of(problem: PlanProblem, explore: float) -> Targets:
    """The targets of a problem: its clusters, and cells of the area as far as they are unexplored.

    A cell is a target that may be anywhere in it; its weight is `explore` times the unexplored fraction.
    Of a cluster whose covariance is unknown or damaged only the middle is taken; one without a finite middle
    or with no mass is left out.
    """
    d = problem.area.dimension
    means, covariances, masses, velocities = _clusters(problem, d)
    cells, spreads, unexplored = _cells(problem, explore)
    weights = np.concatenate([masses, unexplored])
    total = weights.sum()
    return Targets(
        np.ascontiguousarray(np.hstack([means, cells])),
        np.concatenate([covariances, spreads]),
        weights / total if total > 0 else weights,
        masses.size,
        velocities,
    )


def _clusters(problem: PlanProblem, d: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    believed, velocities = problem.intensity, None
    if believed is None:
        means = problem.clusters
        masses = np.ones(means.shape[1])
        covariances = np.tile(UNKNOWN_SPREAD**2 * np.eye(d), (masses.size, 1, 1))
    else:
        means, covariances, masses = believed.means, believed.covariances, believed.masses
        velocities = believed.velocities
    keep = np.isfinite(means).all(axis=0) & np.isfinite(masses) & (masses > 0)
    velocities = (
        np.zeros_like(means) if velocities is None else np.where(np.isfinite(velocities), velocities, 0)
    )
    means, velocities = means[:, keep], velocities[:, keep]
    covariances, masses = np.array(covariances[keep]), masses[keep]
    broken = ~np.isfinite(covariances).all(axis=(1, 2))
    covariances[broken] = UNKNOWN_SPREAD**2 * np.eye(d)
    if masses.size:
        values, vectors = np.linalg.eigh(0.5 * (covariances + covariances.transpose(0, 2, 1)))
        values = np.maximum(values, LEAST_SPREAD**2)
        covariances = np.einsum("nij,nj,nkj->nik", vectors, values, vectors)
    return means, covariances, masses, velocities


def _cells(problem: PlanProblem, explore: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Middles (d, c), covariances (c, d, d) and weights (c,) of cells in which something is unexplored."""
    area, e = problem.area, problem.exploration
    d = area.dimension
    none = np.zeros((d, 0)), np.zeros((0, d, d)), np.zeros(0)
    if explore <= 0 or e.values.ndim != d:
        return none
    counts = [min(n, size) for n, size in zip(CELLS[d], e.values.shape, strict=True)]
    values = np.where(np.isfinite(e.values), np.clip(e.values, 0.0, 1.0), 0.0)
    axes = [np.linspace(e.low[i], e.high[i], n) for i, n in enumerate(values.shape)]
    points = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(d, -1)
    owner = np.zeros(points.shape[1], dtype=np.int64)
    for i, n in enumerate(counts):
        side = max(float(e.high[i] - e.low[i]), 1e-9)
        owner = owner * n + np.minimum((points[i] - e.low[i]) / side * n, n - 1).astype(np.int64)
    total = int(np.prod(counts))
    flat = values.ravel()
    mass = np.bincount(owner, flat, total)
    share = mass / np.maximum(np.bincount(owner, minlength=total), 1)
    keep = share > LEAST_WEIGHT
    if not keep.any():
        return none
    middles = np.stack([np.bincount(owner, flat * p, total)[keep] / mass[keep] for p in points])
    sides = (area.high - area.low) / counts
    spread = np.diag(np.maximum(sides**2 / 12.0, LEAST_SPREAD**2))
    return middles, np.tile(spread, (int(keep.sum()), 1, 1)), explore * share[keep]
