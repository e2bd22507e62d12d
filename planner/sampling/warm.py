"""Every kernel of this room once, so that no robot compiles in flight."""

import numpy as np

from planner.sampling.board import board, fill_hops, inside_moves, move_strides
from planner.sampling.search import Breeding, greedy, search


def warm_sampling() -> None:
    """Paths on three cells by three: free, bound by turns, through footprints, and bred."""
    b = board((3, 3), np.ones(9), 0.9)
    moves = inside_moves(b.shape)
    fill_hops(moves, move_strides(b.shape), 0, 1, np.zeros((9, 9), dtype=np.uint32))
    greedy(b, 0, 3)
    search(b, 0, 3, 2, 0, breeding=Breeding(generations=1, children=2))
