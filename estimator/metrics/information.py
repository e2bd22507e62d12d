"""How much is still unknown of the targets: entropy of the intensity, and when a search may end.

Dames & Kumar, "Autonomous localization of an unknown number of targets without data association using teams
of mobile sensors", IEEE Transactions on Automation Science and Engineering 12(3), 2015, section III-D.
Natural logarithms throughout.

For a Poisson random finite set of intensity v and mass lambda, (25) is lambda - integral of v log v; on
weights w_i of points, which the paper uses, lambda - sum w_i log w_i. That depends on what a point stands
for: a target known to lie in one cell of a grid counts as known exactly. So points are first merged into the
super-particles of a grid, whose cells are as wide as a target's place matters; particles that were resampled
say by their weights nothing of where the mass is.
"""

import numpy as np

from estimator.arrays import FloatArray
from estimator.smc.super_particles import super_particles


def entropy(weights: FloatArray, volumes: FloatArray | float = 1.0) -> float:
    """H[X] (25), in nats, of an intensity of weights (k,) on k cells of `volumes` (m^d).

    With the volumes 1 it is the entropy of targets at places that can be told apart, as in (26)-(28).

    Raises:
        ValueError: if a weight is negative or not finite, or a volume is not positive.
    """
    weights = _checked(weights)
    volumes = np.broadcast_to(np.asarray(volumes, dtype=np.float64), weights.shape)
    if not (np.isfinite(volumes) & (volumes > 0.0)).all():
        raise ValueError("volumes: expected positive numbers")
    heavy = weights > 0.0
    densities = weights[heavy] / volumes[heavy]
    return float(weights.sum() - weights[heavy] @ np.log(densities))


def excess_entropy(weights: FloatArray) -> float:
    """H[v / lambda] - log lambda = H[X] / lambda - 1, the left side of (27) and (28), in nats per target.

    0 where lambda targets are known exactly, each in a cell of its own. Negative if targets share cells.
    Infinite without any mass: what is not there is no estimate (the limit of ever less mass).

    Raises:
        ValueError: if a weight is negative or not finite.
    """
    weights = _checked(weights)
    mass = float(weights.sum())
    return entropy(weights) / mass - 1.0 if mass > 0.0 else float("inf")


def is_settled(points: FloatArray, weights: FloatArray, cell: float, epsilon: float) -> bool:
    """Whether the search may end, (27), (28): excess entropy at most `epsilon` on cells of side `cell` (m).

    points (d, n) with weights (n,) are the whole intensity. The criterion takes the expected number of
    targets for right; where there is none, a small mass left over never satisfies it.

    Raises:
        ValueError: if epsilon is not finite, cell is not positive, or a weight is negative or not finite.
    """
    if not np.isfinite(epsilon):
        raise ValueError(f"epsilon: must be finite, got {epsilon}")
    _, merged = super_particles(points, _checked(weights), cell)
    return excess_entropy(merged) <= epsilon


def _checked(weights: FloatArray) -> FloatArray:
    weights = np.asarray(weights, dtype=np.float64)
    if weights.ndim != 1 or not (np.isfinite(weights) & (weights >= 0.0)).all():
        raise ValueError("weights: expected one row of finite numbers from 0 up")
    return weights
