"""Entropy of binary no-detection events, exact over all subsets of events, Dames & Kumar (15)-(20).

Dames & Kumar, "Autonomous localization of an unknown number of targets without data association using teams
of mobile sensors", IEEE Transactions on Automation Science and Engineering 12(3), 2015, section III-C.

Event i is one robot's measurement at one pose; y_i = 0 says that its measurement set is empty. Over a Poisson
intensity of weights w on points x, the probability Z(S) that all events of S are empty is
exp(-mu(S) - lambda alpha(S)), (16)-(19). Two transforms over the 2^m subsets replace the paper's sums:

* prod_{i in S} (1 - d_i) = sum_{U in S} prod_{i in U} (-d_i), so -lambda alpha(S) is the sum over the
  non-empty subsets U of S of B(U) = sum_x w(x) prod_{i in U} (-d_i(x)). A point adds to B(U) only where all
  events of U see it. From B to alpha it is one zeta transform, m 2^m additions.
* the probability that exactly the events of S are empty is (18), sum_{U >= S} (-1)^|U - S| Z(U): the Moebius
  transform over supersets, again m 2^m additions, in place of 4^m terms.

Subsets are numbers: bit i stands for event i. Natural logarithms throughout.
"""

import math

import numpy as np

from estimator.arrays import FloatArray
from estimator.kernels import kernel

MOST_EVENTS = 24  # 2^24 subsets are 128 MB


def no_detection(detection: FloatArray, weights: FloatArray, clutter: FloatArray) -> FloatArray:
    """Z(S) (2^m,): the probability that all events of S have an empty measurement set, (16), (19).

    Args:
        detection: (m, n) p_D of each point in each event.
        weights: (n,) expected targets at each point.
        clutter: (m,) mu, expected false measurements of each event.

    Raises:
        ValueError: if a shape does not fit, a number is out of its range, or there are too many events.
    """
    detection, weights, clutter = checked(detection, weights, clutter)
    table = subset_sums(np.ascontiguousarray(detection.T), weights)
    empty_sets(table, clutter)
    return table


def outcome_probabilities(detection: FloatArray, weights: FloatArray, clutter: FloatArray) -> FloatArray:
    """(2^m,) the probability that exactly the events of S are empty, all others not, (18).

    Arguments and errors as of `no_detection`. Rounding leaves up to 1e-15 times 2^m, also below 0.
    """
    table = no_detection(detection, weights, clutter)
    moebius(table)
    return table


def entropy(detection: FloatArray, weights: FloatArray, clutter: FloatArray) -> float:
    """H[Y] (20) in nats. Arguments and errors as of `no_detection`."""
    return float(surprise(outcome_probabilities(detection, weights, clutter)))


def checked(
    detection: FloatArray, weights: FloatArray, clutter: FloatArray, most: int = MOST_EVENTS
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The three as contiguous arrays (m, n), (n,), (m,).

    Raises:
        ValueError: if a shape does not fit, a number is out of its range, or events are more than `most`.
    """
    detection = np.ascontiguousarray(detection, dtype=np.float64)
    weights = np.ascontiguousarray(weights, dtype=np.float64)
    clutter = np.ascontiguousarray(clutter, dtype=np.float64)
    if detection.ndim != 2 or detection.shape[0] > most:
        raise ValueError(f"detection: expected (m, n) with m at most {most}, got shape {detection.shape}")
    if weights.shape != detection.shape[1:]:
        raise ValueError(f"weights: expected one per point of {detection.shape}, got {weights.shape}")
    if clutter.shape != detection.shape[:1]:
        raise ValueError(f"clutter: expected one per event of {detection.shape}, got {clutter.shape}")
    if not ((detection >= 0.0) & (detection <= 1.0)).all():
        raise ValueError("detection: expected probabilities")
    for name, values in (("weights", weights), ("clutter", clutter)):
        if not (np.isfinite(values) & (values >= 0.0)).all():
            raise ValueError(f"{name}: expected finite numbers from 0 up")
    return detection, weights, clutter


@kernel
def subset_sums(detection: FloatArray, weights: FloatArray) -> FloatArray:
    """B(U) (2^m,) of events with p_D (n, m), 0 for the empty set.

    A point is multiplied out over the subsets of those events only that see it.
    """
    n, m = detection.shape
    table = np.zeros(1 << m)
    values, subsets = np.empty(1 << m), np.empty(1 << m, dtype=np.int64)
    for x in range(n):
        values[0], subsets[0] = weights[x], 0
        filled = 1
        for i in range(m):
            d = detection[x, i]
            if d != 0.0:
                for u in range(filled):
                    values[filled + u] = -values[u] * d
                    subsets[filled + u] = subsets[u] | (1 << i)
                filled *= 2
        for u in range(1, filled):
            table[subsets[u]] += values[u]
    return table


@kernel
def entropy_of_table(table: FloatArray, clutter: FloatArray) -> float:
    """H[Y] from B(U) in `table` (2^m,), which is used up."""
    empty_sets(table, clutter)
    moebius(table)
    return surprise(table)


@kernel
def empty_sets(table: FloatArray, clutter: FloatArray) -> None:
    """B(U) (2^m,) becomes Z(S), in place."""
    zeta(table)
    subtract_clutter(table, clutter)
    for s in range(table.size):
        table[s] = np.exp(table[s])


@kernel
def subtract_clutter(table: FloatArray, clutter: FloatArray) -> None:
    """From table[S] the sum of `clutter` (m,) over S, in place."""
    for i in range(clutter.size):
        bit = 1 << i
        for block in range(0, table.size, 2 * bit):
            for s in range(block + bit, block + 2 * bit):
                table[s] -= clutter[i]


@kernel
def zeta(table: FloatArray) -> None:
    """table[S] becomes the sum over the subsets of S, in place."""
    bit = 1
    while bit < table.size:
        for block in range(0, table.size, 2 * bit):
            for s in range(block, block + bit):
                table[s + bit] += table[s]
        bit *= 2


@kernel
def moebius(table: FloatArray) -> None:
    """table[S] becomes sum_{U >= S} (-1)^|U - S| table[U], in place: of "all of S", "S and no other"."""
    bit = 1
    while bit < table.size:
        for block in range(0, table.size, 2 * bit):
            for s in range(block, block + bit):
                table[s] -= table[s + bit]
        bit *= 2


@kernel
def surprise(probabilities: FloatArray) -> float:
    """-sum p ln p; what rounding left below 0 counts as 0."""
    total = 0.0
    for s in range(probabilities.size):
        p = probabilities[s]
        if p > 0.0:
            total -= p * math.log(p)
    return total
