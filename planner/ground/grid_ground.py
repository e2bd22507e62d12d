"""The ground as a grid of cells that a robot's middle may or may not enter: `planner.plan.Ground`.

A cell is clear if the whole of it is: wherever in it the middle of a robot is, no point of a wall, of an
obstacle or of the wrong side of a fence is nearer than the robot's radius. What the grid calls clear is
therefore clear; what it calls blocked may have up to 1.5 cells' diagonals of room left.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from estimator.arrays import BoolArray, FlagArray, FloatArray, IntArray
from planner.ground.frame import MARGIN, OPEN, SOLID, TIGHT, Frame, nearest_free
from planner.ground.free_grid import FreeGrid
from planner.plan import Over, never

WHOLE, FLAT = -1, -2  # in place of a layer's number: all layers, and what is free in all of them


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
    frame: Frame = field(init=False, repr=False)
    _tight: bool = field(init=False, repr=False)  # whether any cell is
    _flat_cells: FlagArray = field(init=False, repr=False)  # (1, rows, columns) the worst of all layers
    _grids: dict[tuple[bool, int], FreeGrid] = field(init=False, repr=False, default_factory=dict)

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
        frame = Frame(self.resolution, self.origin, self.low, self.high, len(cells))
        object.__setattr__(self, "frame", frame)
        object.__setattr__(self, "_tight", bool((cells == TIGHT).any()))
        flat = np.ascontiguousarray(cells.max(axis=0, keepdims=True)) if len(cells) > 1 else cells
        object.__setattr__(self, "_flat_cells", flat)

    def __repr__(self) -> str:
        layers, rows, columns = self.cells.shape
        share = np.count_nonzero(self.cells <= TIGHT) / self.cells.size
        return f"GridGround({columns} x {rows} x {layers} cells of {self.resolution:g} m, {share:.0%} clear)"

    # What planner.plan.Ground asks

    def clear(self, points: FloatArray) -> BoolArray:
        """(n,) whether points (d, n) may be entered; without an altitude, in every layer."""
        return np.asarray(self.states(points) <= TIGHT)

    def segments_clear(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """(n,) whether the straight ways from starts (d, n) to ends (d, n) may be taken."""
        grid = self._grid(starts.shape[0])
        out = grid.straight(self.frame.places(starts), self.frame.places(ends))
        if starts.shape[0] < 3 or len(self.cells) > 1:  # layers end where the altitudes do
            return out
        right = [(z[2] >= self.low) & (z[2] <= self.high) & np.isfinite(z[2]) for z in (starts, ends)]
        return np.asarray(out & right[0] & right[1])

    def path(self, start: FloatArray, goal: FloatArray, over: Over = never) -> FloatArray | None:
        """The corners (d, k) of a shortest way from start (d,) to goal (d,), with both; None: no way.

        Shortest among those that keep out of TIGHT, if there are any. A start in MARGIN goes to the nearest
        clear place first. With one layer the altitude changes evenly along the way.
        """
        return self._paths(start, goal[:, None], over, sweep=False)[0]

    def paths(self, start: FloatArray, goals: FloatArray, over: Over = never) -> list[FloatArray | None]:
        """`path` from one start to goals (d, n), by one wave over the grid for all of them."""
        return self._paths(start, goals, over, sweep=True)

    def distances(
        self, goal: FloatArray, points: FloatArray, over: Over = never, within: float = np.inf
    ) -> FloatArray:
        """(n,) metres of the shortest ways from points (d, n) to goal (d,); infinite where there is none.

        The wave goes no farther than `within` metres, and what lies beyond is infinite.
        """
        n = points.shape[1]
        if not self.clear(goal[:, None])[0]:
            return np.full(n, np.inf)
        state = self.states(points)
        aside, entered = np.zeros(n), points
        for i in np.flatnonzero(state == MARGIN):
            left = self.way_out(np.ascontiguousarray(points[:, i]))
            if left is not None:
                entered = entered if entered is not points else points.copy()
                aside[i] = np.linalg.norm(left - points[:, i])
                entered[:, i], state[i] = left, OPEN
        grid = self._grid(points.shape[0])
        source = np.ascontiguousarray(self.frame.places(goal[:, None])[:, 0])
        return aside + grid.lengths(source, self.frame.places(entered), state <= TIGHT, over, within)

    # What only a ground of cells knows

    def states(self, points: FloatArray) -> FlagArray:
        """OPEN, TIGHT, MARGIN or SOLID (n,) at points (d, n); SOLID beyond the grid or where not finite."""
        return self.frame.states(self._cells_for(points.shape[0]), points)

    def solid(self, points: FloatArray) -> BoolArray:
        """(n,) whether points (d, n) lie in something, or beyond a fence, so that no way begins there."""
        return np.asarray(self.states(points) == SOLID)

    def way_out(self, start: FloatArray) -> FloatArray | None:
        """The start (d,) if it is clear, from MARGIN the nearest clear place within reach, else None."""
        state = self.states(start[:, None])[0]
        if state == MARGIN:
            return self._nearest(start, False, MARGIN)
        return start if state <= TIGHT else None

    # Grids

    def _cells_for(self, dimension: int) -> FlagArray:
        return self.cells if dimension == 3 else self._flat_cells

    def _grid(self, dimension: int, roomy: bool = False) -> FreeGrid:
        """The cells that points of this dimension may be in; with `roomy` those with room."""
        return self._made(roomy, WHOLE if dimension == 3 or len(self.cells) == 1 else FLAT)

    def _made(self, roomy: bool, layer: int) -> FreeGrid:
        grid = self._grids.get((roomy, layer))
        if grid is None:
            cells = self.cells[layer : layer + 1] if layer >= 0 else self.cells
            cells = self._flat_cells if layer == FLAT else cells
            grid = FreeGrid.of(cells > (OPEN if roomy else TIGHT), self.frame.sides)
            self._grids[roomy, layer] = grid
        return grid

    def _nearest(self, start: FloatArray, roomy: bool, worst: int) -> FloatArray | None:
        """The nearest free cell's middle, straight to which nothing is above `worst`; None out of reach."""
        grid = self._grid(start.size, roomy)
        place = self.frame.places(start[:, None])[:, 0]
        cells = self._cells_for(start.size)
        found = nearest_free(grid.clearance, cells, place, grid.sides, self.reach, worst)
        if not np.isfinite(found).all():
            return None
        point = self.frame.points(found[:, None], start.size)[:, 0]
        if start.size == 3 and len(self.cells) == 1:
            point[2] = start[2]
        return point

    # Ways

    def _paths(
        self, start: FloatArray, goals: FloatArray, over: Over, *, sweep: bool
    ) -> list[FloatArray | None]:
        ways: list[FloatArray | None] = [None] * goals.shape[1]
        entered = self.way_out(start)
        if entered is None:
            return ways
        todo: IntArray = np.flatnonzero(self.clear(goals))
        if self._tight:
            for n, way in zip(todo, self._roomy(entered, goals[:, todo], over, sweep), strict=True):
                ways[n] = way
            todo = np.array([n for n in todo if ways[n] is None], dtype=np.int64)
        for n, way in zip(todo, self._through(False, entered, goals[:, todo], over, sweep), strict=True):
            ways[n] = way
        if entered is start:
            return ways
        return [None if way is None else np.column_stack([start, way]) for way in ways]

    def _roomy(
        self, start: FloatArray, goals: FloatArray, over: Over, sweep: bool
    ) -> list[FloatArray | None]:
        """Ways that keep out of TIGHT but at their ends, or that are straight."""
        ways: list[FloatArray | None] = [None] * goals.shape[1]
        straight = self.segments_clear(np.repeat(start[:, None], goals.shape[1], axis=1), goals)
        for n in np.flatnonzero(straight):
            ways[n] = np.stack([start, goals[:, n]], axis=1)
        near = start
        if self.states(start[:, None])[0] == TIGHT:
            left = self._nearest(start, True, TIGHT)
            if left is None:
                return ways
            near = left
        ends, names = [], []
        tight = self.states(goals) == TIGHT
        for n in np.flatnonzero(~straight):
            goal = np.ascontiguousarray(goals[:, n])
            end = self._nearest(goal, True, TIGHT) if tight[n] else goal
            if end is not None:
                ends.append(end)
                names.append(n)
        if not ends:
            return ways
        found = self._through(True, near, np.stack(ends, axis=1), over, sweep)
        for n, way in zip(names, found, strict=True):
            if way is not None:
                before = [] if near is start else [start]
                after = [goals[:, n]] if tight[n] else []
                ways[n] = np.column_stack([*before, way, *after]) if before or after else way
        return ways

    def _through(
        self, roomy: bool, start: FloatArray, goals: FloatArray, over: Over, sweep: bool
    ) -> list[FloatArray | None]:
        """Ways from a free place to others: first in the layer that they share, then in all of them."""
        whole = self._grid(start.size, roomy)
        ways: list[FloatArray | None] = [None] * goals.shape[1]
        if len(whole.clearance) > 1 and not self.climb:
            level = np.flatnonzero(np.abs(goals[2] - start[2]) < 1e-6)
            if level.size:
                layer = int(self.frame.places(start[:, None])[2, 0])
                found = self._ways(self._made(roomy, layer), start, goals[:, level], over, sweep)
                for n, way in zip(level.tolist(), found, strict=True):
                    ways[n] = way
        rest = [n for n, way in enumerate(ways) if way is None]
        for n, way in zip(rest, self._ways(whole, start, goals[:, rest], over, sweep), strict=True):
            ways[n] = way
        return ways

    def _ways(
        self, grid: FreeGrid, start: FloatArray, goals: FloatArray, over: Over, sweep: bool
    ) -> list[FloatArray | None]:
        """The corners (d, k) of ways on one grid, from one free place to others."""
        ways: list[FloatArray | None] = [None] * goals.shape[1]
        places = self.frame.places(np.column_stack([start, goals]))
        if len(grid.clearance) == 1:
            places[2] = 0.5
        source, places = np.ascontiguousarray(places[:, 0]), np.ascontiguousarray(places[:, 1:])
        corners, ends = grid.ways(source, places, over, sweep=sweep)
        points = self.frame.points(corners, start.size)
        for n, (first, last) in enumerate(pairwise(ends.tolist())):
            if first < last:
                way = points[:, first:last]
                if start.size == 3 and len(grid.clearance) == 1:
                    steps = np.linalg.norm(np.diff(way[:2]), axis=0)
                    share = np.append(0.0, np.cumsum(steps)) / max(float(steps.sum()), 1e-12)
                    way[2] = start[2] + share * (goals[2, n] - start[2])
                way[:, 0], way[:, -1] = start, goals[:, n]
                ways[n] = way
        return ways
