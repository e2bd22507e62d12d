"""Regions of equal mass: a set of weighted points cut in two, again and again.

Each cut goes through the weighted quantile that gives both sides the mass of the regions that they will be
cut into, across the longer side of what is cut; so all regions have the same mass but for a point or two at
each cut, and none is a sliver. A cut keeps its direction of the last time until the other is half as long
again: where the mass changes slowly, the regions do.
"""

from collections.abc import Mapping

import numpy as np

from estimator.arrays import FloatArray, IntArray

KEEP = 1.5  # the other axis must be longer by this factor for a cut to turn

Axes = Mapping[str, int]  # the axis of each cut; "" is the first, "01" is on its upper side's lower side


def equal_shares(
    points: FloatArray, weights: FloatArray, count: int, axes: Axes | None = None
) -> tuple[IntArray, Axes]:
    """Cut points into `count` regions of equal mass.

    Args:
        points: (d, n).
        weights: (n,) of their mass, finite and >= 0.
        count: of regions; fewer are made where there are fewer points with mass.
        axes: of the cuts of the last time.

    Returns:
        labels: (n,) the region of each point, from 0; -1 for points without mass.
        axes: of the cuts, for the next time.

    Raises:
        ValueError: if a weight is negative or not finite, a shape does not fit, or the count is negative.
    """
    if points.ndim != 2 or weights.shape != points.shape[1:]:
        raise ValueError(f"weights: expected shape ({points.shape[-1]},), got {weights.shape}")
    if not np.isfinite(weights).all() or (weights < 0).any():
        raise ValueError("weights: every number must be finite and >= 0")
    if count < 0:
        raise ValueError(f"count: expected a number >= 0, got {count}")
    labels = np.full(weights.size, -1, dtype=np.int64)
    rows = np.flatnonzero(weights > 0)
    made: dict[str, int] = {}
    if rows.size and count:
        _cut(points, weights, rows, min(count, rows.size), "", axes or {}, labels, made, 0)
    return labels, made


def _cut(
    points: FloatArray,
    weights: FloatArray,
    rows: IntArray,
    count: int,
    name: str,
    before: Axes,
    labels: IntArray,
    made: dict[str, int],
    label: int,
) -> None:
    if count == 1:
        labels[rows] = label
        return
    own = points[:, rows]
    sides = own.max(axis=1) - own.min(axis=1)
    axis = int(np.argmax(sides))
    kept = before.get(name, axis)
    if kept < sides.size and sides[axis] <= KEEP * sides[kept]:
        axis = kept
    made[name] = axis
    order = rows[np.lexsort((rows, own[axis]))]
    low = count // 2
    mass = np.cumsum(weights[order])
    at = int(np.searchsorted(mass, mass[-1] * low / count))
    if (
        at < order.size
        and at > 0
        and mass[at] - mass[-1] * low / count > mass[-1] * low / count - mass[at - 1]
    ):
        at -= 1  # the nearer of the two points at which the mass passes the share
    at = min(max(at + 1, low), order.size - (count - low))
    _cut(points, weights, order[:at], low, name + "0", before, labels, made, label)
    _cut(points, weights, order[at:], count - low, name + "1", before, labels, made, label + low)
