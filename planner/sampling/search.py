"""The best of many sampled paths: in batches, by threads, until enough are sampled or the time is over.

Source: Olofsson et al. (2020), Algorithm 1 and section 5.2. The paper found breeding not worth its time next
to sampling more; it is here for comparison.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from estimator.arrays import IntArray
from planner.sampling.batch import greedy_path, sample_paths
from planner.sampling.board import Board

_BATCH_NS = 4e5  # so long a batch takes, about: the time is looked at in between
_FREE_NS, _BOUND_NS, _SEEN_NS = 10.0, 400.0, 5.0  # of a step, where moves are forbidden, of a cell observed
PARENTS = 16


@dataclass(frozen=True, slots=True)
class Path:
    """A path of k steps on a board."""

    reward: float  # targets that it is expected to detect
    cells: IntArray  # (k + 1,), the start first
    genes: IntArray  # what makes it, see `paths`


@dataclass(frozen=True, slots=True)
class Breeding:
    """Evolution of the best paths."""

    generations: int = 0
    children: int = 500  # in each generation
    mutation: float = 0.5  # chance that a point of a child is drawn anew


NO_BREEDING = Breeding()


def greedy(board: Board, start: int, steps: int) -> Path:
    """The paper's baseline: always towards the cell with most unobserved."""
    cells, genes = _room(steps)
    reward, legs, looks = greedy_path(board, start, cells, genes)
    return Path(float(reward), cells[:looks], genes[:legs])


def search(
    board: Board,
    start: int,
    steps: int,
    paths: int,
    seed: int,
    *,
    threads: int = 1,
    breeding: Breeding = NO_BREEDING,
    over: Callable[[], bool] = lambda: False,
) -> tuple[list[Path], int]:
    """The best path of every batch, best first, and how many paths were sampled.

    Neither depends on the number of threads, unless the time is over before all are sampled.

    Raises:
        ValueError: if `steps` or `threads` is less than one, or `start` is no cell of the board.
    """
    if steps < 1 or threads < 1:
        raise ValueError(f"steps, threads: expected at least 1, got {steps} and {threads}")
    if not 0 <= start < board.values.size:
        raise ValueError(f"start: expected a cell 0..{board.values.size - 1}, got {start}")
    found: list[Path] = []
    sampled = 0
    nobody = np.empty((0, 1), dtype=np.int64), np.empty(0, dtype=np.int64)
    size = _batch(board, steps)
    pool = ThreadPoolExecutor(threads) if threads > 1 else None
    try:
        for generation in range(breeding.generations + 1):
            count = breeding.children if generation else paths
            parents = _parents(found) if generation and found else nobody
            stream = seed + generation * 1_000_003

            def one(
                batch: tuple[int, int], parents: tuple[IntArray, IntArray] = parents, s: int = stream
            ) -> Path:
                return _sampled(board, start, steps, s, batch, parents, breeding.mutation)

            for batches in _rounds(count, size, threads):
                if over():
                    return _best_first(found), sampled
                found += pool.map(one, batches) if pool else map(one, batches)
                sampled += sum(number for _, number in batches)
            found = _best_first(found)
    finally:
        if pool:
            pool.shutdown()
    return found, sampled


def _sampled(
    board: Board,
    start: int,
    steps: int,
    seed: int,
    batch: tuple[int, int],
    parents: tuple[IntArray, IntArray],
    mutation: float,
) -> Path:
    cells, genes = _room(steps)
    reward, legs, looks = sample_paths(board, start, seed, *batch, *parents, mutation, cells, genes)
    return Path(float(reward), cells[:looks], genes[:legs])


def _room(steps: int) -> tuple[IntArray, IntArray]:
    return np.empty(steps + 1, dtype=np.int64), np.empty(2 * steps + 8, dtype=np.int64)


def _batch(board: Board, steps: int) -> int:
    """Paths in a batch."""
    cost = _BOUND_NS if board.open.size else _FREE_NS
    if board.offsets.size > 1:
        cost += _SEEN_NS * board.seen.size / (board.offsets.size - 1)
    return int(np.clip(_BATCH_NS / (cost * steps), 1, 1000))


def _rounds(count: int, size: int, threads: int) -> Iterator[list[tuple[int, int]]]:
    """(first, number) of the batches of each round, one for each thread."""
    for begin in range(0, count, size * threads):
        end = min(begin + size * threads, count)
        yield [(first, min(size, end - first)) for first in range(begin, end, size)]


def _best_first(found: list[Path]) -> list[Path]:
    return sorted(found, key=lambda path: -path.reward)


def _parents(found: list[Path]) -> tuple[IntArray, IntArray]:
    best = found[:PARENTS]
    lengths = np.array([path.genes.size for path in best], dtype=np.int64)
    genes = np.zeros((len(best), max(int(lengths.max()), 1)), dtype=np.int64)
    for row, path in zip(genes, best, strict=True):
        row[: path.genes.size] = path.genes
    return genes, lengths
