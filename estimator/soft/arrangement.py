"""The convex cells into which the lines through a polygon's edges cut the plane."""

import numpy as np

from estimator.arrays import BoolArray, FloatArray

_ALIKE = 1e-9  # lines that differ less than this (of the polygon's size) are one
_SLIVER = 1e-12  # cells smaller than this share of the polygon's square are none
_AROUND = 50.0  # sizes of the polygon around it in which cells are looked for


def area_of(corners: FloatArray) -> float:
    """Signed area in m^2 of a polygon (k, 2), positive if counter-clockwise."""
    x, y = (corners - corners.mean(axis=0)).T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def is_convex(corners: FloatArray) -> bool:
    """Whether a counter-clockwise polygon (k, 2) turns left everywhere, once around."""
    edges = np.roll(corners, -1, axis=0) - corners
    after = np.roll(edges, -1, axis=0)
    cross = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
    turns = np.arctan2(cross, np.sum(edges * after, axis=1)).sum()
    tolerance = 1e-12 * float(np.abs(edges).max()) ** 2
    return bool((cross >= -tolerance).all() and turns < 2.5 * np.pi)


def cells(
    corners: FloatArray, normals: FloatArray, offsets: FloatArray, most: int
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Cells of the lines normals (k, 2) . x = offsets (k,) through the edges of a simple polygon (k, 2).

    The lines without repetitions (l, 2), (l,); on which side of each line each cell lies (c, l), -1 or 1; and
    which cells are inside the polygon (c,).

    Raises:
        ValueError: if edges cross, or there are more than `most` lines.
    """
    _check_simple(corners)
    low, high = corners.min(axis=0), corners.max(axis=0)
    size, middle = float((high - low).max()), 0.5 * (low + high)
    kept: list[int] = []
    for j in range(len(normals)):
        moved = offsets[j] - normals[j] @ middle
        if not any(
            abs(normals[j] @ normals[i]) > 1.0 - _ALIKE
            and abs(moved - np.sign(normals[j] @ normals[i]) * (offsets[i] - normals[i] @ middle))
            < _ALIKE * size
            for i in kept
        ):
            kept.append(j)
    if len(kept) > most:
        raise ValueError(
            f"corners: a polygon that is not convex may have edges on {most} lines, found "
            f"{len(kept)}; simplify it, or say it as several convex regions"
        )
    normals, offsets = normals[kept], offsets[kept]
    far = _AROUND * size
    box = middle + far * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    found: list[tuple[FloatArray, list[float]]] = [(box, [])]
    for normal, offset in zip(normals, offsets, strict=True):
        cut: list[tuple[FloatArray, list[float]]] = []
        for outline, signs in found:
            for side in (-1.0, 1.0):
                part = _clipped(outline, side * normal, side * offset)
                if len(part) >= 3 and abs(area_of(part)) > _SLIVER * size**2:
                    cut.append((part, [*signs, side]))
        found = cut
    inside = np.array([_contains(corners, outline.mean(axis=0)) for outline, _ in found])
    return normals, offsets, np.array([signs for _, signs in found]), inside


def _clipped(outline: FloatArray, normal: FloatArray, offset: float) -> FloatArray:
    """The part of a convex polygon (k, 2) with normal . x >= offset (Sutherland & Hodgman 1974)."""
    heights = outline @ normal - offset
    out = []
    for i in range(len(outline)):
        j = (i + 1) % len(outline)
        if heights[i] >= 0.0:
            out.append(outline[i])
        if (heights[i] >= 0.0) != (heights[j] >= 0.0):
            share = heights[i] / (heights[i] - heights[j])
            out.append(outline[i] + share * (outline[j] - outline[i]))
    return np.array(out).reshape(-1, 2)


def _contains(corners: FloatArray, point: FloatArray) -> bool:
    """Whether a point lies in the polygon: a ray from it crosses an odd number of edges."""
    after = np.roll(corners, -1, axis=0)
    across = (corners[:, 1] > point[1]) != (after[:, 1] > point[1])
    start, end = corners[across], after[across]
    share = (point[1] - start[:, 1]) / (end[:, 1] - start[:, 1])
    return bool(np.count_nonzero(start[:, 0] + share * (end[:, 0] - start[:, 0]) > point[0]) % 2)


def _check_simple(corners: FloatArray) -> None:
    k = len(corners)
    for i in range(k):
        for j in range(i + 2, k):
            if i == 0 and j == k - 1:
                continue
            a, b, c, d = corners[i], corners[(i + 1) % k], corners[j], corners[(j + 1) % k]
            if _left(a, b, c) * _left(a, b, d) < 0.0 and _left(c, d, a) * _left(c, d, b) < 0.0:
                raise ValueError(f"corners: edges {i} and {j} cross")


def _left(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    """Above 0 where c is to the left of the line from a to b."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
