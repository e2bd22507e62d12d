"""The ground as a grid of cells that a robot's middle may or may not enter: `planner.plan.Ground`.

A cell is clear if the whole of it is: wherever in it the middle of a robot is, no point of a wall, of an
obstacle or of the wrong side of a fence is nearer than the robot's radius. What the grid calls clear is
therefore clear; what it calls blocked may have up to 1.5 cells' diagonals of room left.
"""

from collections import OrderedDict
from dataclasses import dataclass, field

import numpy as np

from estimator.arrays import BoolArray, FlagArray, FloatArray, ShortArray
from planner.ground.any_angle import UNREACHED, lengths_at, search, tightened, way_back
from planner.ground.walk import chebyshev3, open_ways

# Of a cell. TIGHT: clear, but ways that can keep more room do. MARGIN: too near to something for a robot.
OPEN, TIGHT, MARGIN, SOLID = 0, 1, 2, 3
FIELDS = 8  # fields of distances that are remembered


@dataclass(frozen=True, slots=True, eq=False)
class DistanceField:
    """The lengths of the shortest ways from one place to everywhere."""

    source: FloatArray  # (3,) cell coordinates
    lengths: FloatArray  # (cells,) metres
    corners: ShortArray  # (cells,) the corner before each cell


@dataclass(frozen=True, slots=True, eq=False)
class GridGround:
    """Ground of cells. One layer reaches through all altitudes between `low` and `high`.

    Args:
        cells: (layers, rows, columns) OPEN, TIGHT, MARGIN or SOLID. What lies beyond the grid is SOLID.
        resolution: metres per cell, along rows and columns.
        origin: (3,) x, y in metres and yaw in radians of the corner of cells[:, 0, 0].
        low, high: altitudes in metres, of the lowest layer's floor and the highest one's ceiling;
            infinite with one layer.
        reach: metres that a robot standing in MARGIN may go to get out of it.
        climb: whether ways between places at one altitude may leave it to be shorter. Otherwise they leave it
            only if there is no other way.

    Raises:
        ValueError: naming the field that is wrong.
    """

    cells: FlagArray
    resolution: float
    origin: FloatArray
    low: float = -np.inf
    high: float = np.inf
    reach: float = 0.0
    climb: bool = False
    clearance: FlagArray = field(init=False)  # king's moves to the nearest cell that is not clear
    roomy: FlagArray = field(init=False)  # the same to the nearest that is not OPEN
    _fields: "OrderedDict[bytes, DistanceField]" = field(init=False, repr=False, default_factory=OrderedDict)

    def __post_init__(self) -> None:
        cells = self.cells
        if cells.ndim != 3 or cells.size == 0 or cells.dtype != np.uint8:
            raise ValueError(
                f"cells: expected uint8 (layers, rows, columns), got {cells.dtype} {cells.shape}"
            )
        if cells.size >= 2**31:
            raise ValueError(f"cells: expected fewer than 2^31, got {cells.size}")
        if not 0.0 < self.resolution < np.inf:
            raise ValueError(f"resolution: expected a finite number > 0, got {self.resolution}")
        if self.origin.shape != (3,) or not np.isfinite(self.origin).all():
            raise ValueError(f"origin: expected 3 finite numbers, got {self.origin}")
        if not self.low < self.high:
            raise ValueError(f"low: expected less than high, got {self.low} and {self.high}")
        if len(cells) > 1 and not np.isfinite([self.low, self.high]).all():
            raise ValueError(f"low, high: expected finite altitudes with {len(cells)} layers")
        object.__setattr__(self, "clearance", chebyshev3((cells > TIGHT).astype(np.uint8)))
        tight = (cells == TIGHT).any()
        roomy = chebyshev3((cells > OPEN).astype(np.uint8)) if tight else self.clearance
        object.__setattr__(self, "roomy", roomy)

    def __repr__(self) -> str:
        layers, rows, columns = self.cells.shape
        share = np.count_nonzero(self.cells <= TIGHT) / self.cells.size
        return f"GridGround({columns} x {rows} x {layers} cells of {self.resolution:g} m, {share:.0%} clear)"

    # What planner.plan.Ground asks

    def clear(self, points: FloatArray) -> BoolArray:
        """(n,) whether points (d, n) may be entered; without an altitude, in every layer."""
        return np.asarray(self._state(points) <= TIGHT)

    def solid(self, points: FloatArray) -> BoolArray:
        """(n,) whether points (d, n) lie in something, or beyond a fence, so that no way begins there."""
        return np.asarray(self._state(points) == SOLID)

    def segments_clear(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """(n,) whether the straight ways from starts (d, n) to ends (d, n) may be taken."""
        out = np.empty(starts.shape[1], dtype=np.bool_)
        flat, a, b = self._grid_for(starts), self._places(starts), self._places(ends)
        open_ways(flat, a, b, out)
        return np.asarray(out & self._altitudes_right(starts) & self._altitudes_right(ends))

    def path(self, start: FloatArray, goal: FloatArray) -> FloatArray | None:
        """The corners (d, k) of a shortest way from start (d,) to goal (d,), with both; None: no way.

        Shortest among those that keep out of TIGHT, if there are any. A start in MARGIN goes to the nearest
        clear place first. With one layer the altitude changes evenly along the way.
        """
        return self._paths(start, goal[:, None], sweep=False)[0]

    def paths(self, start: FloatArray, goals: FloatArray) -> list[FloatArray | None]:
        """`path` from one start to goals (d, n), by one sweep over the grid for all of them."""
        return self._paths(start, goals, sweep=True)

    def distances(self, goal: FloatArray, points: FloatArray) -> FloatArray:
        """(n,) metres of the shortest ways from points (d, n) to goal (d,); infinite where there is none."""
        out = np.full(points.shape[1], np.inf)
        if not self.clear(goal[:, None])[0]:
            return out
        clearance = self._grid_for(points)
        found = self._field(clearance, -1, goal)
        good = self.clear(points)
        lengths_at(
            clearance,
            self._sides(),
            found.source,
            found.lengths,
            found.corners,
            self._places(points),
            good,
            out,
        )
        state = self._state(points)
        for n in np.flatnonzero(state == MARGIN):
            left = self.way_out(np.ascontiguousarray(points[:, n]))
            if left is not None:
                out[n] = float(np.linalg.norm(left - points[:, n]))
                out[n] += float(self.distances(goal, left[:, None])[0])
        return out

    # Places and cells

    @property
    def layer_height(self) -> float:
        """Metres of one layer; with one layer, 1: it does not matter."""
        return (self.high - self.low) / len(self.cells) if len(self.cells) > 1 else 1.0

    def _sides(self) -> FloatArray:
        return np.array([self.resolution, self.layer_height])

    def _layered(self, points: FloatArray) -> bool:
        return len(self.cells) > 1 and points.shape[0] == 3

    def _flat(self, grid: FlagArray, dimension: int) -> FlagArray:
        """A grid (l, r, c) as points of this dimension live on it."""
        if len(grid) == 1 or dimension == 3:
            return grid
        return chebyshev3((grid.min(axis=0, keepdims=True) == 0).astype(np.uint8))

    def _grid_for(self, points: FloatArray) -> FlagArray:
        return self._flat(self.clearance, points.shape[0])

    def _places(self, points: FloatArray) -> FloatArray:
        """Cell coordinates (3, n): column, row, layer."""
        c, s = np.cos(self.origin[2]), np.sin(self.origin[2])
        dx, dy = points[0] - self.origin[0], points[1] - self.origin[1]
        out = np.full((3, points.shape[1]), 0.5)
        with np.errstate(invalid="ignore"):
            out[0], out[1] = (c * dx + s * dy) / self.resolution, (c * dy - s * dx) / self.resolution
        if self._layered(points):
            out[2] = (points[2] - self.low) / self.layer_height
        return out

    def _points(self, places: FloatArray, dimension: int) -> FloatArray:
        """Points (d, n) of cell coordinates (3, n); with one layer their altitude is left 0."""
        c, s = np.cos(self.origin[2]), np.sin(self.origin[2])
        x, y = self.resolution * places[0], self.resolution * places[1]
        out = np.zeros((dimension, places.shape[1]))
        out[0], out[1] = self.origin[0] + c * x - s * y, self.origin[1] + s * x + c * y
        if dimension == 3 and len(self.cells) > 1:
            out[2] = self.low + places[2] * self.layer_height
        return out

    def _altitudes_right(self, points: FloatArray) -> BoolArray:
        if points.shape[0] < 3:
            return np.ones(points.shape[1], dtype=np.bool_)
        right: BoolArray = (points[2] >= self.low) & (points[2] <= self.high) & np.isfinite(points[2])
        return right

    def _state(self, points: FloatArray) -> FlagArray:
        """OPEN, MARGIN or SOLID (n,) at points (d, n); SOLID beyond the grid or where not finite."""
        places = self._places(points)
        cells = self.cells
        if len(cells) > 1 and not self._layered(points):
            cells = cells.max(axis=0, keepdims=True)
        layers, rows, columns = cells.shape
        with np.errstate(invalid="ignore"):
            inside = (places[0] >= 0) & (places[0] < columns) & (places[1] >= 0) & (places[1] < rows)
            inside &= (places[2] >= 0) & (places[2] < layers) & self._altitudes_right(points)
        out = np.full(points.shape[1], SOLID, dtype=np.uint8)
        i, j, k = np.floor(places[:, inside]).astype(np.int64)
        out[inside] = cells[k, j, i]
        return out

    def way_out(self, start: FloatArray) -> FloatArray | None:
        """The start (d,) if it is clear, from MARGIN the nearest clear place within reach, else None."""
        state = self._state(start[:, None])[0]
        if state == MARGIN:
            return self._nearest(start, self._grid_for(start[:, None]), MARGIN)
        return start if state <= TIGHT else None

    def _nearest(self, start: FloatArray, clearance: FlagArray, worst: int) -> FloatArray | None:
        """The nearest free cell's middle in `clearance`, straight to which nothing is above `worst`."""
        layers, rows, columns = clearance.shape
        u, v, w = self._places(start[:, None])[:, 0]
        n, m = int(self.reach / self.resolution) + 1, int(self.reach / self.layer_height) + 1
        j, i = np.arange(int(v) - n, int(v) + n + 1), np.arange(int(u) - n, int(u) + n + 1)
        k = np.arange(int(w) - m, int(w) + m + 1) if layers > 1 else np.zeros(1, dtype=np.int64)
        i, j, k = i[(i >= 0) & (i < columns)], j[(j >= 0) & (j < rows)], k[(k >= 0) & (k < layers)]
        near = np.stack([axis.ravel() for axis in np.meshgrid(i, j, k, indexing="ij")])
        near = near[:, clearance[near[2], near[1], near[0]] > 0]
        points = self._points(near + 0.5, start.size)
        if start.size == 3 and layers == 1:
            points[2] = start[2]
        gaps = np.linalg.norm(points - start[:, None], axis=0)
        for best in np.argsort(gaps, kind="stable")[:20]:
            if gaps[best] > self.reach:
                break
            share = np.linspace(0.0, 1.0, max(2, int(4 * gaps[best] / self.resolution) + 2))
            between = start[:, None] + (points[:, best] - start)[:, None] * share
            if (self._state(between) <= worst).all():
                return np.array(points[:, best])
        return None

    # Ways

    def _paths(self, start: FloatArray, goals: FloatArray, *, sweep: bool) -> list[FloatArray | None]:
        entered = self.way_out(start)
        if entered is None:
            return [None] * goals.shape[1]
        clear = self.clear(goals)
        first = [] if entered is start else [start]
        ways: list[FloatArray | None] = []
        for goal, good in zip(np.ascontiguousarray(goals.T), clear, strict=True):
            way = self._roomy_path(entered, goal, sweep) if good else None
            if way is None and good:
                way = self._any_path(self.clearance, entered, goal, sweep)
            ways.append(way if way is None or not first else np.column_stack([*first, way]))
        return ways

    def _roomy_path(self, start: FloatArray, goal: FloatArray, sweep: bool) -> FloatArray | None:
        """A way that keeps out of TIGHT but at its ends."""
        if self.roomy is self.clearance:
            return None
        if self.segments_clear(start[:, None], goal[:, None])[0]:
            return np.stack([start, goal], axis=1)
        ends = []
        for end in (start, goal):
            tight = self._state(end[:, None])[0] == TIGHT
            near = self._nearest(end, self._flat(self.roomy, end.size), TIGHT) if tight else end
            if near is None:
                return None
            ends.append(near)
        way = self._any_path(self.roomy, ends[0], ends[1], sweep)
        if way is None:
            return None
        before = [] if ends[0] is start else [start]
        after = [] if ends[1] is goal else [goal]
        return np.column_stack([*before, way, *after])

    def _any_path(
        self, grid: FlagArray, start: FloatArray, goal: FloatArray, sweep: bool
    ) -> FloatArray | None:
        """A way where `grid` is free: first in the layer that start and goal share, then in all of them."""
        whole = self._flat(grid, start.size)
        if len(whole) > 1 and not self.climb and abs(float(start[2] - goal[2])) < 1e-6:
            layer = int(self._places(start[:, None])[2, 0])
            flat = chebyshev3((grid[layer : layer + 1] == 0).astype(np.uint8))
            way = self._way(flat, layer, start, goal, sweep)
            if way is not None:
                return way
        return self._way(whole, -1, start, goal, sweep)

    def _field(self, clearance: FlagArray, layer: int, source: FloatArray) -> DistanceField:
        """The distances from a source on a grid: on one layer of it, or with `layer` -1 on all."""
        place = self._place(source, clearance)
        key = place.tobytes() + f"{layer} {clearance.shape} {int(np.count_nonzero(clearance))}".encode()
        found = self._fields.get(key)
        if found is None:
            lengths, corners = np.empty(clearance.size), np.empty(clearance.size, dtype=np.int32)
            search(clearance, self._sides(), place, place, False, lengths, corners)
            found = DistanceField(place, lengths, corners)
            self._fields[key] = found
            while len(self._fields) > FIELDS:
                self._fields.popitem(last=False)
        return found

    def _place(self, point: FloatArray, clearance: FlagArray) -> FloatArray:
        """Cell coordinates (3,) of a point on a grid that may be one layer of the whole."""
        place = self._places(point[:, None])[:, 0]
        if len(clearance) == 1:
            place[2] = 0.5
        return np.ascontiguousarray(place)

    def _way(
        self, clearance: FlagArray, layer: int, start: FloatArray, goal: FloatArray, sweep: bool
    ) -> FloatArray | None:
        """The corners (d, k) from one clear point to another; with `sweep` by a field that is kept."""
        a, b = self._place(start, clearance), self._place(goal, clearance)
        straight = np.empty(1, dtype=np.bool_)
        open_ways(clearance, a[:, None], b[:, None], straight)
        if straight[0]:
            return np.stack([start, goal], axis=1)
        if sweep:
            corners = self._field(clearance, layer, start).corners
            _, rows, columns = clearance.shape
            cell = (int(b[2]) * rows + int(b[1])) * columns + int(b[0])
            cell = cell if corners[cell] != UNREACHED else -1
        else:
            lengths, corners = np.empty(clearance.size), np.empty(clearance.size, dtype=np.int32)
            cell = search(clearance, self._sides(), a, b, True, lengths, corners)
        if cell < 0:
            return None
        way = np.hstack([way_back(corners, cell, a, clearance.shape, clearance.size + 1), b[:, None]])
        way = tightened(clearance, way)
        out = self._points(way, start.size)
        if start.size == 3 and len(clearance) == 1:
            steps = np.linalg.norm(np.diff(out[:2]), axis=0)
            share = np.concatenate([[0.0], np.cumsum(steps)]) / max(float(steps.sum()), 1e-12)
            out[2] = start[2] + share * (goal[2] - start[2])
        out[:, 0], out[:, -1] = start, goal
        return out
