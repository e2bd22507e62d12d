"""The grid over the area on which paths are sampled, and the intensity of targets unobserved in its cells."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.filter import Area
from estimator.sensor import SensorModel
from planner.commitments import Looks
from planner.others import Others
from planner.plan import Over, PlanProblem, never

NO_TARGETS = 1e-9  # expected in all: as good as none
_STANDING_LOOKS = 50  # of a robot that stands: more leave nothing to see there


@dataclass(frozen=True, slots=True)
class Grid:
    """Cells of one size that fill the area's box exactly."""

    low: FloatArray  # (d,) metres
    size: FloatArray  # (d,) of a cell, metres
    shape: tuple[int, ...]

    @staticmethod
    def over(area: Area, cell: float, at_most: int) -> "Grid":
        """Cells of about `cell` metres; larger ones where there would be more than `at_most`.

        Raises:
            ValueError: if `cell` is not a positive number.
        """
        if not (cell > 0 and math.isfinite(cell)):
            raise ValueError(f"cell: expected a positive number of metres, got {cell}")
        extent = area.high - area.low
        count = np.maximum(np.round(extent / cell), 1.0)
        while count.prod() > at_most:
            cell *= 1.02
            count = np.maximum(np.floor(extent / cell), 1.0)
        return Grid(area.low, extent / count, tuple(int(k) for k in count))

    @property
    def cells(self) -> int:
        return math.prod(self.shape)

    def centres(self, cells: IntArray | None = None) -> FloatArray:
        """(d, n) of the given cells, or of all."""
        numbers = np.arange(self.cells) if cells is None else cells
        index = np.stack(np.unravel_index(numbers, self.shape)).astype(np.float64)
        return np.asarray(self.low[:, None] + (index + 0.5) * self.size[:, None])

    def cells_of(self, points: FloatArray) -> IntArray:
        """(n,) the cell that holds each point (d, n), or is the nearest to it."""
        index = np.floor((points - self.low[:, None]) / self.size[:, None])
        top = np.array(self.shape, dtype=np.float64)[:, None] - 1.0
        cells = np.clip(index, 0, top).astype(np.int64)
        return np.asarray(np.ravel_multi_index(tuple(cells), self.shape), dtype=np.int64)


def believed(problem: PlanProblem, grid: Grid, undetected: float) -> FloatArray:
    """v (n,) = the filter's intensity plus v^n for undetected targets, Olofsson (2020) (6), in each cell.

    The filter's points stand for its clusters too. Where no points are known, each cluster is a target spread
    over as much as is known of it. v^n is `undetected` targets spread over the area, times the share that is
    unexplored. Numbers that are not finite count as nothing.
    """
    values = np.zeros(grid.cells)
    heard = problem.intensity
    if heard is not None and heard.points.size:
        good = np.isfinite(heard.points).all(axis=0) & np.isfinite(heard.weights) & (heard.weights > 0)
        values += np.bincount(
            grid.cells_of(heard.points[:, good]), weights=heard.weights[good], minlength=grid.cells
        )
    elif heard is not None and heard.means.size:
        for mean, covariance, mass in zip(heard.means.T, heard.covariances, heard.masses, strict=True):
            values += _spread(grid, mean, covariance, float(mass))
    else:
        finite = np.isfinite(problem.clusters).all(axis=0)
        values += np.bincount(grid.cells_of(problem.clusters[:, finite]), minlength=grid.cells)
    unexplored = np.clip(np.nan_to_num(problem.exploration.at(grid.centres())), 0.0, 1.0)
    return values + undetected / grid.cells * unexplored


def unobserved(
    values: FloatArray,
    others: Others,
    grid: Grid,
    sensors: Mapping[str, SensorModel],
    until: float,
    over: Over = never,
) -> FloatArray:
    """What the other robots' committed looks before team time `until` leave of values (n,), (9), (15b).

    The order of looks in time decides who is the first to observe a target, not how many are observed: what
    this robot adds is what all of the others' looks leave. Those that there is no time for are not counted.
    """
    left = values.copy()
    where = np.flatnonzero(left > 0)
    points = grid.centres(where)
    for i, other in enumerate(others.commitments):
        sensor = sensors.get(other.robot)
        if sensor is None:
            continue
        if over():
            break
        poses = np.ascontiguousarray(_poses(others.tail(i), until))
        if len(poses):
            p = np.clip(np.nan_to_num(sensor.detection(points, poses)), 0.0, 1.0)
            left[where] *= np.prod(1.0 - p, axis=0)
    return left


def _poses(tail: Looks, until: float) -> FloatArray:
    standing = 0
    if tail.stand_time < until:
        standing = min(_STANDING_LOOKS, int((until - tail.stand_time) / tail.period) + 1)
    return np.vstack([tail.poses[tail.times < until], np.tile(tail.stand_pose, (standing, 1))])


def _spread(grid: Grid, mean: FloatArray, covariance: FloatArray, mass: float) -> FloatArray:
    """A Gaussian cluster in cells (n,), at least one cell wide."""
    nothing = np.zeros(grid.cells)
    if not (np.isfinite(mean).all() and np.isfinite(covariance).all() and 0 < mass < np.inf):
        return nothing
    wide = covariance + np.diag((0.5 * grid.size) ** 2)
    away = grid.centres() - mean[:, None]
    distance = np.einsum("in,in->n", away, np.linalg.solve(wide, away))
    if not np.isfinite(distance).all():
        return nothing
    density = np.exp(-0.5 * (distance - distance.min()))
    return np.asarray(mass * density / density.sum())
