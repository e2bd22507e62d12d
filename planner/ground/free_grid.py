"""Ways between the free cells of one grid, and the waves of distances from places that were asked about."""

from collections import OrderedDict

import numpy as np

from estimator.arrays import BoolArray, FlagArray, FloatArray, IntArray, ShortArray
from planner.ground.any_angle import (
    ARRIVED,
    BUCKETS,
    CURRENT,
    UNREACHED,
    WAITING,
    allowed_steps,
    moves_of,
    spread,
)
from planner.ground.any_angle_ways import NEIGHBOURS, lengths_at, ways_back
from planner.ground.walk import chebyshev3, open_ways
from planner.plan import Over

WAVES = 8  # that are remembered
CELLS_AT_ONCE = 2000  # about a fifth of a millisecond: between questions for the time


class Wave:
    """The shortest ways from one place to everywhere near, as far as they have been asked for."""

    def __init__(self, grid: "FreeGrid", source: FloatArray, goal: FloatArray | None = None) -> None:
        n = grid.clearance.size
        self.grid = grid
        self.source = source  # (3,) cell coordinates
        self.goal = goal  # (3,) to which the wave is directed, or None
        self.lengths = np.full(n, np.inf)  # (cells,) metres
        self.corners = np.full(n, UNREACHED, np.int32)  # (cells,) the corner before each cell
        self.closed = np.zeros(n, np.bool_)  # (cells,) whether these are final
        self._after, self._before = np.empty(n, np.int32), np.empty(n, np.int32)
        self._heads, self._marks = np.full(BUCKETS, -1, np.int32), np.zeros(3, np.int64)
        self._begun = False

    def __repr__(self) -> str:
        return f"Wave(from {self.source}, {np.count_nonzero(self.closed)} of {self.closed.size} cells)"

    @property
    def ended(self) -> bool:
        """Whether it is everywhere that it can be, or at its goal."""
        return self._begun and bool(self._marks[WAITING] == 0 or self._marks[ARRIVED])

    def grow(self, until: float = np.inf, most: int = CELLS_AT_ONCE) -> bool:
        """Go on to cells `until` metres away, by at most so many; whether it is that far, or ended."""
        grid, goal = self.grid, self.goal
        spread(
            grid.clearance,
            grid.sides,
            grid.moves,
            grid.steps,
            self.source,
            self.source if goal is None else goal,
            goal is not None,
            until,
            most,
            self.lengths,
            self.corners,
            self.closed,
            self._after,
            self._before,
            self._heads,
            self._marks,
        )
        self._begun = True
        return self.ended or bool(self._marks[CURRENT] * grid.bucket > until)

    def reach(self, cells: IntArray, over: Over, within: float = np.inf) -> None:
        """Go on until all of `cells` are closed and their neighbours too, or cannot be, or time is over.

        Cells that are farther than `within` metres need not be.
        """
        until = within + 2.0 * float(self.grid.sides.max())  # a place may be nearer than its cell's middle
        while not self.ended and not self.closed[cells].all():
            if over():
                return
            if self.grow(until):
                break
        known = self.lengths[cells[self.closed[cells]]]
        if known.size:
            farthest = float(known.max()) + (NEIGHBOURS + 1.0) * float(self.grid.sides[0])
            while not over() and not self.grow(farthest):
                pass


class FreeGrid:
    """Cells that may be entered or not, and the ways between them. All places are in cell coordinates.

    Args:
        clearance: (layers, rows, columns) king's moves to the nearest cell that is not free, 0 on one.
        sides: (2,) metres of a cell along rows and columns, and of a layer.
    """

    def __init__(self, clearance: FlagArray, sides: FloatArray) -> None:
        self.clearance = clearance
        self.sides = sides
        self.bucket = 0.5 * float(sides[0] if len(clearance) == 1 else sides.min())
        self.moves = moves_of(len(clearance))
        self._steps: ShortArray | None = None
        self._waves: OrderedDict[bytes, Wave] = OrderedDict()

    def __repr__(self) -> str:
        layers, rows, columns = self.clearance.shape
        return f"FreeGrid({columns} x {rows} x {layers} cells)"

    @staticmethod
    def of(blocked: BoolArray, sides: FloatArray) -> "FreeGrid":
        """The grid of the cells (l, r, c) that are not blocked."""
        return FreeGrid(chebyshev3(blocked.astype(np.uint8)), sides)

    @property
    def steps(self) -> ShortArray:
        """(cells,) bits of `moves` that are allowed; made when first asked for."""
        if self._steps is None:
            self._steps = np.empty(self.clearance.size, np.int32)
            allowed_steps(self.clearance, self.moves, self._steps)
        return self._steps

    def straight(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """(n,) whether the straight ways from starts (3, n) to ends (3, n) are open."""
        out = np.empty(starts.shape[1], dtype=np.bool_)
        open_ways(self.clearance, starts, ends, out)
        return out

    def ways(
        self, source: FloatArray, goals: FloatArray, over: Over, *, sweep: bool
    ) -> tuple[FloatArray, IntArray]:
        """The corners (3, m) of the shortest ways from a free place (3,) to others (3, n), one after another.

        The ends (n + 1,) say where each begins and the next one: nowhere if there is no way, or no time.

        Args:
            sweep: whether to find all by one wave, which is remembered, or each by a search of its own.
        """
        straight = self.straight(np.repeat(source[:, None], goals.shape[1], axis=1), goals)
        if straight.all():
            lines = np.repeat(goals, 2, axis=1)
            lines[:, ::2] = source[:, None]
            return lines, 2 * np.arange(goals.shape[1] + 1)
        if sweep:
            wave = self._wave(source, np.ascontiguousarray(goals[:, ~straight]), over)
            return self._back(wave, goals, straight)
        found, counts = [], [0]
        for goal in np.ascontiguousarray(goals.T):
            found.append(self._search(source, goal, over))
            counts.append(found[-1].shape[1])
        return np.hstack(found), np.cumsum(np.array(counts, dtype=np.int64))

    def _search(self, source: FloatArray, goal: FloatArray, over: Over) -> FloatArray:
        wave = Wave(self, source, goal)
        while not wave.ended:
            if over():
                return np.zeros((3, 0))
            wave.grow()
        return self._back(wave, goal[:, None], np.zeros(1, dtype=np.bool_))[0]

    def lengths(
        self, source: FloatArray, places: FloatArray, good: BoolArray, over: Over, within: float = np.inf
    ) -> FloatArray:
        """(n,) metres from a free place (3,) to those of places (3, n) that are good, that is free.

        Infinite to others, where there is no way, and where time was over first: near places are known first.
        Those beyond `within` metres are infinite too.
        """
        wave = self._wave(source, np.ascontiguousarray(places[:, good]), over, within)
        out = np.empty(places.shape[1])
        lengths_at(
            self.clearance, self.sides, source, wave.lengths, wave.corners, wave.closed, places, good, out
        )
        out[out > within] = np.inf  # how far the wave is beyond is a matter of what was asked before
        return out

    def _wave(self, source: FloatArray, goals: FloatArray, over: Over, within: float = np.inf) -> Wave:
        """The wave from a source, grown until it is at all goals (3, n) to which there is a way, in time."""
        key = source.tobytes()
        wave = self._waves.pop(key, None) or Wave(self, source)  # taken out: nobody else goes on with it
        wave.reach(self._cells(goals), over, within)
        self._waves[key] = wave
        while len(self._waves) > WAVES:
            self._waves.popitem(last=False)
        return wave

    def _cells(self, places: FloatArray) -> IntArray:
        _, rows, columns = self.clearance.shape
        i, j, k = places.astype(np.int64)
        return np.asarray((k * rows + j) * columns + i)

    def _back(self, wave: Wave, goals: FloatArray, straight: BoolArray) -> tuple[FloatArray, IntArray]:
        ends = np.empty(goals.shape[1] + 1, np.int64)
        goals = np.ascontiguousarray(goals)
        return ways_back(self.clearance, wave.source, goals, straight, wave.corners, wave.closed, ends), ends
