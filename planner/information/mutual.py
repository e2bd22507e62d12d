"""Mutual information of the targets and a team's no-detection events, I[X; Y] = H[Y] - H[Y | X], (10), (13).

Dames & Kumar 2015 (see `entropy`). Events that see no point in common, directly or through others, are
independent, so the information of each such component adds up; 2^m then counts a component's events only.

A component of more than `limit` events is bounded instead, by facts of any joint distribution in which events
are independent given the targets. By the chain rule its information is the sum of what each event adds to
those before it. Let an event y add g given the at most limit - 1 nearest of those before it (by shared
expected detections), D being the rest of them. To all before it, it adds at most g, since conditioning on
more leaves less to learn; and at least g - I[X; D], since y can say of D no more than the targets do, and at
least 0. I[X; D] is at most the sum of the single events' information. Besides, information never falls with
more measurements, so any `limit` events give a bound too. The better of both is taken.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from planner.information.conditional import TERMS, conditional_entropies
from planner.information.entropy import MOST_EVENTS, checked, entropy

LIMIT = 20  # events of a component that are exact


@dataclass(frozen=True, slots=True)
class Information:
    """I[X; Y] in nats, known to lie within `error` of `value`."""

    value: float
    error: float  # 0 but for the Taylor terms where every component was exact
    exact: bool  # whether every component was small enough


def mutual_information(
    detection: FloatArray,
    weights: FloatArray,
    clutter: FloatArray,
    terms: int = TERMS,
    limit: int = LIMIT,
) -> Information:
    """What m binary events say of the targets.

    Args:
        detection: (m, n) p_D of each point in each event, any m.
        weights: (n,) expected targets at each point.
        clutter: (m,) mu, expected false measurements of each event.
        terms: of the Taylor series (24).
        limit: events of a component that are enumerated, 2 to MOST_EVENTS.

    Raises:
        ValueError: if a shape does not fit or a number is out of its range.
    """
    if not 2 <= limit <= MOST_EVENTS:
        raise ValueError(f"limit: expected 2 to {MOST_EVENTS}, got {limit}")
    detection, weights, clutter = checked(detection, weights, clutter, most=2**31)
    given = conditional_entropies(detection, weights, clutter, terms)
    low = high = 0.0
    exact = True
    for rows in components(detection * weights):
        h = float(given.value[rows].sum())
        if rows.size <= limit:
            value = _entropy(detection, weights, clutter, rows) - h
            low, high = low + value, high + value
        else:
            exact = False
            least, most = _bounded(detection, weights, clutter, given.value, rows, limit)
            low, high = low + least, high + most
    slack = float(given.error.sum())
    return Information(0.5 * (low + high), 0.5 * (high - low) + slack, exact)


def components(shares: FloatArray) -> list[IntArray]:
    """Rows of shares (m, n) in groups: positive in a column together, directly or through others."""
    seen = shares > 0.0
    todo = np.ones(len(seen), dtype=np.bool_)
    groups = []
    for first in range(len(seen)):
        if not todo[first]:
            continue
        member = np.zeros(len(seen), dtype=np.bool_)
        member[first] = True
        columns = seen[first]
        while True:
            reached = todo & ~member & (seen[:, columns].any(axis=1))
            if not reached.any():
                break
            member |= reached
            columns = columns | seen[reached].any(axis=0)
        todo &= ~member
        groups.append(np.flatnonzero(member))
    return groups


def _entropy(detection: FloatArray, weights: FloatArray, clutter: FloatArray, rows: IntArray) -> float:
    """H[Y] of some events, on the points that they see."""
    columns = (detection[rows] > 0.0).any(axis=0) & (weights > 0.0)
    return entropy(np.ascontiguousarray(detection[rows][:, columns]), weights[columns], clutter[rows])


def _bounded(
    detection: FloatArray,
    weights: FloatArray,
    clutter: FloatArray,
    given: FloatArray,
    rows: IntArray,
    limit: int,
) -> tuple[float, float]:
    """Least and most information of one large component; `given` (m,) is H[y | X] of all events."""
    shared = (detection[rows] * weights) @ detection[rows].T
    alone = (
        np.array([_entropy(detection, weights, clutter, rows[[i]]) for i in range(rows.size)]) - given[rows]
    )
    low = high = 0.0
    for i, row in enumerate(rows):
        before = np.argsort(-shared[i, :i], kind="stable")
        near, rest = before[: limit - 1], before[limit - 1 :]
        window = rows[np.sort(near)]
        gain = _entropy(detection, weights, clutter, np.append(window, row)) - float(given[row])
        if window.size:
            gain -= _entropy(detection, weights, clutter, window)
        high += gain
        low += max(0.0, gain - float(alone[rest].sum()))
    some = rows[np.sort(_telling(shared, alone, limit))]
    few = _entropy(detection, weights, clutter, some) - float(given[some].sum())
    return min(max(low, few), high), high


def _telling(shared: FloatArray, alone: FloatArray, limit: int) -> IntArray:
    """`limit` events that say much on their own and share little, chosen one after the other."""
    chosen: list[int] = []
    own = np.maximum(np.diag(shared), 1e-300)
    for _ in range(limit):
        overlap = (shared[:, chosen] / own[:, None]).max(axis=1) if chosen else np.zeros(len(alone))
        score = alone * (1.0 - np.minimum(overlap, 1.0))
        score[chosen] = -np.inf
        chosen.append(int(np.argmax(score)))
    return np.array(chosen)
