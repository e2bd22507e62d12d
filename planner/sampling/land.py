"""Which steps between cells the ground allows, and how many it takes to get anywhere."""

from collections.abc import Callable

import numpy as np

from estimator.arrays import BoolArray, FloatArray
from planner.plan import Ground
from planner.sampling.board import MOVES, fill_hops, inside_moves, move_strides
from planner.sampling.grid import Grid

_TARGETS = 32  # between questions for the time


class Land:
    """Surveyed as time allows; what is done is kept for the next plan."""

    def __init__(self, ground: Ground, grid: Grid) -> None:
        self._ground, self._grid = ground, grid
        size = np.ones(3, dtype=np.int64)
        size[: len(grid.shape)] = grid.shape
        self._size = size
        self.clear: BoolArray = np.zeros(0, dtype=np.bool_)  # (n,) whether a robot may be in a cell's centre
        self.moves = np.zeros(grid.cells, dtype=np.uint32)
        self.hops = np.zeros((grid.cells, grid.cells), dtype=np.uint32)
        self._move = 0
        self._target = 0

    def __repr__(self) -> str:
        return f"Land({self._grid.shape}, {self._move} of 26 moves, {self._target} targets)"

    def ready(self, over: Callable[[], bool]) -> bool:
        """Whether moves and hops are known; False if the time is over first."""
        if self._target == self._grid.cells:
            return True
        centres = self._grid.centres()
        if not self.clear.size:
            self.clear = np.asarray(self._ground.clear(centres))
        inside, strides = inside_moves(self._size), move_strides(self._size)
        while self._move < len(MOVES):
            if over():
                return False
            m = self._move
            cells = np.flatnonzero((inside >> np.uint32(m)) & 1)
            cells = cells[self.clear[cells] & self.clear[cells + strides[m]]] if cells.size else cells
            if cells.size:
                starts = np.ascontiguousarray(centres[:, cells])
                ends = np.ascontiguousarray(centres[:, cells + strides[m]])
                cells = cells[self._ground.segments_clear(starts, ends)]
                self.moves[cells] |= np.uint32(1) << np.uint32(m)
            self._move += 1
        while self._target < self._grid.cells:
            if over():
                return False
            last = min(self._target + _TARGETS, self._grid.cells)
            fill_hops(self.moves, strides, self._target, last, self.hops)
            self._target = last
        return True

    def nearest(self, place: FloatArray) -> int | None:
        """The cell nearest to a place (d,) that it is straight to; the nearest at all if there is none."""
        usable = np.flatnonzero(self.clear & (self.moves != 0))
        if not usable.size:
            return None
        centres = self._grid.centres(usable)
        order = np.argsort(np.linalg.norm(centres - place[:, None], axis=0), kind="stable")[:16]
        ends = np.ascontiguousarray(centres[:, order])
        starts = np.ascontiguousarray(np.repeat(place[:, None], order.size, axis=1))
        straight = np.flatnonzero(self._ground.segments_clear(starts, ends))
        return int(usable[order[straight[0] if straight.size else 0]])
