"""Averaging over a network: Metropolis weights, and rounds in which neighbours average.

Xiao, Boyd & Lall, "A scheme for robust distributed sensor fusion based on average consensus", 2005, eq. 11.
"""

from collections.abc import Sequence

import numpy as np

from estimator.arrays import BoolArray, FloatArray
from estimator.averaging.belief import Belief, Size, average


def metropolis(links: BoolArray) -> FloatArray:
    """Averaging weights (r, r), doubly stochastic and symmetric, for links (r, r) between robots.

    m_ij = 1 / (1 + max(degree_i, degree_j)) where i and j are linked, the rest on the diagonal: a robot needs
    to know its neighbours' degrees only. On a connected network repeated averaging comes to the mean.

    Raises:
        ValueError: if links are not a symmetric square matrix.
    """
    linked = np.array(links, dtype=np.bool_)
    if linked.ndim != 2 or linked.shape[0] != linked.shape[1] or not np.array_equal(linked, linked.T):
        raise ValueError(f"links: expected a symmetric matrix, got shape {linked.shape}")
    np.fill_diagonal(linked, False)
    degrees = linked.sum(axis=1)
    weights = np.where(linked, 1.0 / (1.0 + np.maximum(degrees[:, None], degrees)), 0.0)
    np.fill_diagonal(weights, 1.0 - weights.sum(axis=1))
    return weights


def own_shares(degree: int, neighbour_degrees: Sequence[int]) -> FloatArray:
    """One robot's row of `metropolis`: its own share first, then its neighbours'."""
    shares = [1.0 / (1.0 + max(degree, other)) for other in neighbour_degrees]
    return np.array([1.0 - sum(shares), *shares])


def consensus(
    beliefs: Sequence[Belief], weights: FloatArray, rounds: int, size: Size | None = None
) -> list[Belief]:
    """All robots' beliefs after rounds in which each averages its neighbours' and its own, all at once.

    Raises:
        ValueError: if weights are not (r, r) for r beliefs with rows that add up to 1, or rounds < 0.
    """
    if rounds < 0:
        raise ValueError(f"rounds: expected 0 or more, got {rounds}")
    if weights.shape != (len(beliefs), len(beliefs)):
        raise ValueError(f"weights: expected shape ({len(beliefs)}, {len(beliefs)}), got {weights.shape}")
    now = list(beliefs)
    for _ in range(rounds):
        now = [_heard(now, row, size) for row in weights]
    return now


def _heard(beliefs: Sequence[Belief], row: FloatArray, size: Size | None) -> Belief:
    heard = np.flatnonzero(row > 0.0).tolist()
    return average([beliefs[i] for i in heard], row[heard], size)
