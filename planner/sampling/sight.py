"""What a sensor observes from each cell of a grid, as rows of a sparse matrix (see `board`)."""

from collections.abc import Callable

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.sensor import SensorModel
from planner.sampling.grid import Grid

Footprints = tuple[IntArray, IntArray, FloatArray]
_LEAST = 0.02  # p_D below this is not looked at: tails are long, and every cell costs time
_RADIUS = {2: 40, 3: 12}  # cells that a footprint reaches, at most
_POSES = 16  # between questions for the time


def depends_on_heading(sensor: SensorModel, grid: Grid, altitude: float) -> bool:
    """Whether it matters to a sensor which way it looks."""
    middle = grid.low + 0.5 * grid.size * np.array(grid.shape)
    poses = np.vstack([_pose(middle, altitude, yaw) for yaw in (0.0, 2.0, 4.0)])
    p = sensor.detection(grid.centres(), poses)
    return bool((np.abs(p - p[0]) > _LEAST).any())


def in_the_open(sensor: SensorModel, grid: Grid, altitude: float, looks: float, headings: int) -> Footprints:
    """Footprints of a sensor that sees the same from everywhere: one stencil, cut off at the border.

    Args:
        looks: taken while a cell is crossed; p_D becomes 1 - (1 - p_D)^looks.
    """
    d = len(grid.shape)
    reach = [min(n - 1, _RADIUS[d]) for n in grid.shape]
    axes = [np.arange(-r, r + 1) for r in reach]
    offsets = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")])  # (d, o)
    quarters = np.stack([a.ravel() for a in np.meshgrid(*[[-0.25, 0.25]] * d, indexing="ij")])
    middle = grid.low + 0.5 * grid.size * np.array(grid.shape)
    inner = (offsets[:, :, None] + quarters[:, None, :]).reshape(d, -1) * grid.size[:, None]
    points = np.ascontiguousarray(middle[:, None] + inner)
    places = np.stack(np.unravel_index(np.arange(grid.cells), grid.shape))  # (d, n)
    top = np.array(grid.shape)[:, None]
    counts, cells, chances = [], [], []
    for heading in range(headings):
        p = sensor.detection(points, _pose(middle, altitude, heading * np.pi / 4))[0]
        p = np.clip(np.nan_to_num(p.reshape(offsets.shape[1], -1).mean(axis=1)), 0.0, 1.0)
        used = np.flatnonzero(p > _LEAST)
        seen = places[:, :, None] + offsets[:, None, used]  # (d, n, u)
        inside = ((seen >= 0) & (seen < top[:, :, None])).all(axis=0)
        counts.append(inside.sum(axis=1))
        cells.append(np.ravel_multi_index(tuple(s[inside] for s in seen), grid.shape))
        chances.append(np.broadcast_to(p[used], inside.shape)[inside])
    return _rows(np.concatenate(counts), np.concatenate(cells), np.concatenate(chances), looks)


class Surveyed:
    """Footprints of a sensor whose sight walls block: cell by cell, as time allows."""

    def __init__(self, sensor: SensorModel, grid: Grid, altitude: float, looks: float, headings: int) -> None:
        self._sensor, self._looks = sensor, looks
        self._points = grid.centres()
        self._poses = np.vstack([_poses(self._points, altitude, h * np.pi / 4) for h in range(headings)])
        self._counts: list[IntArray] = []
        self._cells: list[IntArray] = []
        self._chances: list[FloatArray] = []
        self._done = 0
        self._rows: Footprints | None = None

    def __repr__(self) -> str:
        return f"Surveyed({self._done} of {len(self._poses)} poses)"

    def rows(self, over: Callable[[], bool]) -> Footprints | None:
        """All rows; None if the time is over first. What is done is kept for the next call."""
        while self._done < len(self._poses):
            if over():
                return None
            p = self._sensor.detection(self._points, self._poses[self._done : self._done + _POSES])
            p = np.clip(np.nan_to_num(p), 0.0, 1.0)
            row, cell = np.nonzero(p > _LEAST)
            self._counts.append(np.bincount(row, minlength=len(p)))
            self._cells.append(cell)
            self._chances.append(p[row, cell])
            self._done += len(p)
        if self._rows is None:
            self._rows = _rows(
                np.concatenate(self._counts),
                np.concatenate(self._cells),
                np.concatenate(self._chances),
                self._looks,
            )
        return self._rows


def _rows(counts: IntArray, cells: IntArray, chances: FloatArray, looks: float) -> Footprints:
    offsets = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(counts)]).astype(np.int64)
    return offsets, cells.astype(np.int64), 1.0 - (1.0 - chances) ** looks


def _pose(place: FloatArray, altitude: float, yaw: float) -> FloatArray:
    return _poses(place[:, None], altitude, yaw)


def _poses(points: FloatArray, altitude: float, yaw: float) -> FloatArray:
    poses = np.full((points.shape[1], 4), altitude)
    poses[:, : len(points)] = points.T
    poses[:, 3] = yaw
    return poses
