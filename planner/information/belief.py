"""Where targets may be, as the planner sees it: few points, each with an expected number of targets.

Dames & Kumar 2015 (see `entropy`), section IV-B: particles of a grid's cell are merged into a super-particle.
"""

import numpy as np

from estimator.arrays import FloatArray
from estimator.sensor import SensorModel
from estimator.smc.super_particles import at_most, super_particles
from planner.plan import PlanProblem


def believed(
    problem: PlanProblem, most: int, cell: float | None, expected: float
) -> tuple[FloatArray, FloatArray]:
    """Points (d, n) and weights (n,) of the problem's intensity; none where nothing is believed.

    Before a first intensity is heard of, `expected` targets are taken to be spread over the unexplored area.
    Points that are not finite, or have no weight, are left out.

    Args:
        most: points.
        cell: side of the cells in metres; None: as small as `most` points allow.
        expected: targets in an area of which nothing is explored.
    """
    if problem.intensity is None:
        points = problem.exploration.nodes()
        values = problem.exploration.values.ravel()
        weights = expected * values / max(values.size, 1)
    else:
        points, weights = problem.intensity.points, problem.intensity.weights
    good = np.isfinite(points).all(axis=0) & np.isfinite(weights) & (weights > 0.0)
    points, weights = np.ascontiguousarray(points[:, good]), np.ascontiguousarray(weights[good])
    if cell is not None and weights.size:
        points, weights = super_particles(points, weights, cell)
    points, weights = at_most(points, weights, most)
    return np.ascontiguousarray(points), np.ascontiguousarray(weights)


def clutter_rate(sensor: SensorModel) -> float:
    """mu, the expected number of false measurements in a set; 0 where a sensor does not say it."""
    inner: object = sensor
    while not hasattr(inner, "clutter") and hasattr(inner, "sensor"):
        inner = inner.sensor
    rate = float(getattr(inner, "clutter", 0.0))
    return rate if 0.0 <= rate < np.inf else 0.0
