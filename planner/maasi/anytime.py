"""Candidates in batches, so that a planner can stop between them when its deadline comes."""

from collections.abc import Iterator

import numpy as np

from estimator.arrays import IntArray
from planner.deadline import Deadline

BATCH_S = 5e-4  # what a batch should take
GOLDEN = 0.6180339887498949


def batches(count: int, deadline: Deadline, guess_s: float = 0.0) -> Iterator[IntArray]:
    """Indices 0..count-1 in batches until the deadline would be passed; all at once where there is none.

    The order spreads over the whole: candidates that are neighbours in a grid lie far apart in it. The first
    batch is of one, and the following as large as takes BATCH_S; none is begun that is expected to end late.

    Args:
        count: of candidates.
        deadline: of the plan.
        guess_s: what one candidate may take, before any was seen.
    """
    if np.isinf(deadline.seconds):
        yield np.arange(count)
        return
    order = np.argsort(np.arange(count) * GOLDEN % 1.0, kind="stable")
    done, size, each = 0, 1, guess_s
    while done < count:
        began = deadline.left()
        if began <= size * each:
            size = 1
        if began <= each or began <= 0.0:
            return
        yield np.sort(order[done : done + size])
        done += size
        each = max((began - deadline.left()) / size, 1e-7)
        size = max(1, int(BATCH_S / each))
