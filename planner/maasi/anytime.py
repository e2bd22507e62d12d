"""Candidates in batches, so that a planner can stop between them when its deadline comes."""

from collections.abc import Iterator

import numpy as np

from estimator.arrays import IntArray
from planner.deadline import Deadline, Reserve

BATCH_S = 5e-4  # what a batch should take
GOLDEN = 0.6180339887498949


def batches(count: int, deadline: Deadline, one: Reserve) -> Iterator[IntArray]:
    """Indices 0..count-1 in batches until the deadline would be passed; all at once where there is none.

    The order spreads over the whole: candidates that are neighbours in a grid lie far apart in it. The first
    batch is of one, and the following as large as takes BATCH_S; none is begun that is expected to end late.

    Args:
        count: of candidates.
        deadline: of the plan.
        one: what a batch of one candidate takes.
    """
    if np.isinf(deadline.seconds):
        yield np.arange(count)
        return
    order = np.argsort(np.arange(count) * GOLDEN % 1.0, kind="stable")
    done, size, took = 0, 1, 0.0
    while done < count:
        if deadline.left() <= took:
            size = 1
        if not one.fits(deadline):
            return
        some = order[done : done + size]
        before = deadline.passed()
        if size == 1:
            with one.measured(deadline):
                yield some
        else:
            yield np.sort(some)
        took = deadline.passed() - before
        done += size
        more = BATCH_S / max(took, 1e-7)
        size = max(1, int(size * min(more, 8.0)))
