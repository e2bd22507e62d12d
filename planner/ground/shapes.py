"""Polygons and circles on the ground, with the altitudes that they reach from and to."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from estimator.arrays import BoolArray, FloatArray
from estimator.kernels import exact_kernel

EVERYWHERE = (-np.inf, np.inf)
Role = Literal["inside", "outside", "area"]  # a fence to stay inside or outside of; an area to search


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A polygon with holes (`edges`), or a circle (`circle`), upright between two altitudes.

    A point is inside a polygon if a ray from it crosses the edges an odd number of times (even-odd rule).
    """

    edges: FloatArray  # (e, 4): x, y of an edge's begin, x, y of its end, metres; empty for a circle
    circle: FloatArray  # (3,): x, y, radius in metres; radius 0 for a polygon
    altitude: tuple[float, float] = EVERYWHERE  # metres, from and to

    @staticmethod
    def polygon(rings: list[FloatArray], altitude: tuple[float, float] = EVERYWHERE) -> "Shape":
        """The polygon of rings (n, 2) of corners, the outer one first; a repeated last corner is dropped.

        Raises:
            ValueError: if a ring has fewer than three corners, is flat, or edges cross or touch.
        """
        edges = []
        for ring in rings:
            corners = np.asarray(ring, dtype=np.float64)
            if corners.ndim != 2 or corners.shape[1:] != (2,) or not np.isfinite(corners).all():
                raise ValueError("polygon: expected pairs of finite numbers x, y")
            if len(corners) > 1 and (corners[0] == corners[-1]).all():
                corners = corners[:-1]
            if len(corners) < 3:
                raise ValueError(f"polygon: expected at least 3 corners, found {len(corners)}")
            edges.append(np.hstack([corners, np.roll(corners, -1, axis=0)]))
        if not edges:
            raise ValueError("polygon: expected at least one ring of corners, found none")
        crossing = _crossing(edges)
        if crossing is not None:
            x, y = crossing
            raise ValueError(f"polygon: it intersects itself near ({x:g}, {y:g})")
        made = np.ascontiguousarray(np.vstack(edges))
        if not abs(_twice_area(edges[0])) > 1e-12 * float(np.ptp(edges[0][:, :2], axis=0).max()) ** 2:
            raise ValueError("polygon: its corners lie on one line")
        return Shape(made, np.zeros(3), _checked(altitude))

    @staticmethod
    def disc(x: float, y: float, radius: float, altitude: tuple[float, float] = EVERYWHERE) -> "Shape":
        """A circle with what is in it.

        Raises:
            ValueError: if a number is not finite, or the radius is not positive.
        """
        if not (np.isfinite([x, y, radius]).all() and radius > 0):
            raise ValueError(f"circle: expected finite x, y and a radius > 0, found {x:g}, {y:g}, {radius:g}")
        return Shape(np.zeros((0, 4)), np.array([x, y, radius], dtype=np.float64), _checked(altitude))

    @property
    def endless(self) -> bool:
        """Whether it reaches through all altitudes."""
        return self.altitude == EVERYWHERE

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Corners (2,), (2,) of the box around it."""
        if self.circle[2] > 0:
            return self.circle[:2] - self.circle[2], self.circle[:2] + self.circle[2]
        return self.edges[:, :2].min(axis=0), self.edges[:, :2].max(axis=0)

    def distances(self, points: FloatArray) -> FloatArray:
        """(n,) metres from points (d, n) to its outline on the ground, negative inside, at any altitude."""
        out = np.empty(points.shape[1])
        _distances(self.edges, self.circle, np.ascontiguousarray(points[:2], dtype=np.float64), out)
        return out

    def contains(self, points: FloatArray) -> BoolArray:
        """(n,) whether points (d, n) lie in it; of points without an altitude the ground is asked alone."""
        inside: BoolArray = self.distances(points) < 0.0
        if points.shape[0] == 3:
            inside &= (points[2] >= self.altitude[0]) & (points[2] <= self.altitude[1])
        return inside


@dataclass(frozen=True, slots=True, eq=False)
class Zone:
    """A shape of a file, and what the file says it is for."""

    shape: Shape
    role: Role
    name: str = ""  # as the file calls it, or where in the file it is


def _checked(altitude: tuple[float, float]) -> tuple[float, float]:
    low, high = float(altitude[0]), float(altitude[1])
    if not low < high:
        raise ValueError(f"altitude: expected the first number below the second, found {low:g}, {high:g}")
    return low, high


def _twice_area(edges: FloatArray) -> float:
    first = edges[0, :2]
    x, y = edges[:, 0] - first[0], edges[:, 1] - first[1]
    x2, y2 = edges[:, 2] - first[0], edges[:, 3] - first[1]
    return float(np.sum(x * y2 - x2 * y))


def _crossing(rings: list[FloatArray]) -> tuple[float, float] | None:
    """Where two edges that are not neighbours in a ring meet, or None."""
    edges = np.vstack(rings)
    # Neighbours share a corner and may not fold back; all others may not even touch.
    after = np.concatenate(
        [start + np.roll(np.arange(len(ring)), -1) for start, ring in zip(_starts(rings), rings, strict=True)]
    )
    found = np.zeros(2)
    return (float(found[0]), float(found[1])) if _meet(edges, after, found) else None


def _starts(rings: list[FloatArray]) -> list[int]:
    return [sum(len(ring) for ring in rings[:i]) for i in range(len(rings))]


@exact_kernel
def _side(ax: float, ay: float, bx: float, by: float, px: float, py: float) -> float:
    """Positive if p lies left of the line from a to b."""
    return (bx - ax) * (py - ay) - (by - ay) * (px - ax)


@exact_kernel
def _within(ax: float, ay: float, bx: float, by: float, px: float, py: float) -> bool:
    """Whether p, on the line through a and b, lies between them."""
    return min(ax, bx) <= px <= max(ax, bx) and min(ay, by) <= py <= max(ay, by)


@exact_kernel
def _meet(edges: FloatArray, after: np.ndarray, found: FloatArray) -> bool:
    n = edges.shape[0]
    for i in range(n):
        ax, ay, bx, by = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
        if ax == bx and ay == by:  # the same corner twice in turn
            found[0], found[1] = ax, ay
            return True
        for j in range(i + 1, n):
            cx, cy, dx, dy = edges[j, 0], edges[j, 1], edges[j, 2], edges[j, 3]
            if max(cx, dx) < min(ax, bx) or min(cx, dx) > max(ax, bx):
                continue
            if max(cy, dy) < min(ay, by) or min(cy, dy) > max(ay, by):
                continue
            if after[i] == j or after[j] == i:
                # They share a corner: they meet elsewhere only if one folds back onto the other.
                if after[i] == j:
                    sx, sy, px, py, qx, qy = bx, by, ax, ay, dx, dy
                else:
                    sx, sy, px, py, qx, qy = ax, ay, bx, by, cx, cy
                straight = _side(px, py, sx, sy, qx, qy) == 0.0
                if straight and (px - sx) * (qx - sx) + (py - sy) * (qy - sy) > 0.0:
                    found[0], found[1] = sx, sy
                    return True
                continue
            s1, s2 = _side(ax, ay, bx, by, cx, cy), _side(ax, ay, bx, by, dx, dy)
            s3, s4 = _side(cx, cy, dx, dy, ax, ay), _side(cx, cy, dx, dy, bx, by)
            proper = ((s1 > 0) != (s2 > 0)) and ((s3 > 0) != (s4 > 0)) and s1 * s2 != 0 and s3 * s4 != 0
            touch = (
                (s1 == 0.0 and _within(ax, ay, bx, by, cx, cy))
                or (s2 == 0.0 and _within(ax, ay, bx, by, dx, dy))
                or (s3 == 0.0 and _within(cx, cy, dx, dy, ax, ay))
                or (s4 == 0.0 and _within(cx, cy, dx, dy, bx, by))
            )
            if proper or touch:
                share = s1 / (s1 - s2) if s1 != s2 else 0.5
                found[0], found[1] = cx + share * (dx - cx), cy + share * (dy - cy)
                return True
    return False


@exact_kernel
def _distances(edges: FloatArray, circle: FloatArray, points: FloatArray, out: FloatArray) -> None:
    """Signed distances of points (2, n) to an outline, negative inside."""
    for i in range(out.size):
        x, y = points[0, i], points[1, i]
        if circle[2] > 0.0:
            out[i] = np.hypot(x - circle[0], y - circle[1]) - circle[2]
            continue
        best, inside = np.inf, False
        for e in range(edges.shape[0]):
            ax, ay, bx, by = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
            dx, dy = bx - ax, by - ay
            share = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)
            share = min(max(share, 0.0), 1.0)
            gx, gy = ax + share * dx - x, ay + share * dy - y
            best = min(best, gx * gx + gy * gy)
            if (ay > y) != (by > y) and x < ax + (y - ay) / dy * dx:
                inside = not inside
        out[i] = -np.sqrt(best) if inside else np.sqrt(best)
