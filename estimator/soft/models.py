"""What people say of places, as multimodal softmax models: near, inside, behind, left of.

Ponda et al. 2012, section III-C and (22). The paper gives the numbers of sub-classes of its models (1 + 8 + 8
for "next to", "around" and "far from") and no weights; these are derived here from the geometry. A model's
sub-classes are affine functions of x, so what lies between two of them is a straight border, and
`steepness` is the slope of the log-odds across it in 1/m: 4.4 / steepness metres lie between 10 % and 90 %.
All models are about the ground plan: in 3D they do not depend on the height.
"""

from dataclasses import dataclass
from math import pi, sqrt, tan

import numpy as np

from estimator.arrays import FloatArray
from estimator.sensors.softmax import Softmax
from estimator.soft.arrangement import area_of, cells, is_convex

SIDES = 8
EDGES = 16  # a polygon that is not convex may have this many; the sub-classes grow with their square


@dataclass(frozen=True, slots=True, eq=False)
class SoftModel:
    """A softmax model whose categories have names: what an operator may say about one reference."""

    softmax: Softmax
    names: tuple[str, ...]  # of the categories 0..c-1

    def category(self, name: str) -> int:
        """The category of a name.

        Raises:
            ValueError: if there is none of that name.
        """
        if name not in self.names:
            raise ValueError(f"relation: expected one of {', '.join(self.names)}, got {name!r}")
        return self.names.index(name)


def ranges(
    place: FloatArray, inner: float, outer: float, steepness: float, *, dimension: int = 2
) -> SoftModel:
    """ "near" (within `inner` metres), "around" (up to `outer`) and "far from" a place (2,): 17 sub-classes.

    Circles are octagons of the same area, whose borders are at 0.97..1.05 of the radius.

    Raises:
        ValueError: if an argument is not finite or not 0 < inner < outer.
    """
    centre = _points(place, 1, "place")[0]
    steepness = _steep(steepness)
    if not 0.0 < inner < outer < np.inf:
        raise ValueError(f"inner, outer: expected 0 < inner < outer, got {inner} and {outer}")
    angles = 2.0 * pi * np.arange(SIDES) / SIDES
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    apothem = sqrt(pi / (SIDES * tan(pi / SIDES)))
    around = steepness * directions
    weights = np.concatenate([np.zeros((1, 2)), around, 2.0 * around])
    biases = np.concatenate(
        [
            [0.0],
            np.full(SIDES, -steepness * apothem * inner),
            np.full(SIDES, -steepness * apothem * (inner + outer)),
        ]
    )
    classes = np.repeat([0, 1, 2], [1, SIDES, SIDES])
    softmax = Softmax(weights, biases - weights @ centre, classes)
    return SoftModel(_raised(softmax, dimension), ("near", "around", "far from"))


def region(corners: FloatArray, steepness: float, *, dimension: int = 2) -> SoftModel:
    """ "inside" and "outside" of a simple polygon with corners (k, 2) in either sense of rotation.

    A convex one has one outside sub-class per edge. For any other, the lines through its edges cut the plane
    into convex cells, each wholly inside or outside, and f(x) = steepness / 2 * sum_j |n_j . x - b_j| is
    convex and affine on each cell: its affine pieces are the sub-classes.

    Raises:
        ValueError: if corners are fewer than three, not finite, without area, or crossing; or if a polygon
            that is not convex has more than 16 different edge lines.
    """
    corners = _points(corners, None, "corners")
    steepness = _steep(steepness)
    signed = area_of(corners)
    if len(corners) < 3 or abs(signed) < 1e-12 * max(float(np.ptp(corners, axis=0).max()) ** 2, 1e-300):
        raise ValueError("corners: expected at least three that enclose an area")
    if signed < 0.0:
        corners = corners[::-1]
    edges = np.roll(corners, -1, axis=0) - corners
    kept = np.linalg.norm(edges, axis=1) > 0.0
    corners, edges = corners[kept], edges[kept]
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
    offsets = np.sum(normals * corners, axis=1)
    names = ("outside", "inside")
    if is_convex(corners):
        softmax = Softmax.polytope(normals, offsets, steepness)
        return SoftModel(_raised(softmax, dimension), names)
    normals, offsets, signs, inside = cells(corners, normals, offsets, EDGES)
    if not inside.any() or inside.all():
        raise ValueError("corners: the polygon is too thin for its size")
    weights = 0.5 * steepness * signs @ normals
    biases = -0.5 * steepness * signs @ offsets
    return SoftModel(_raised(Softmax(weights, biases, inside.astype(np.int64)), dimension), names)


def directions(
    pose: FloatArray, steepness: float, *, reach: float | None = None, dimension: int = 2
) -> SoftModel:
    """ "in front of", "behind", "left of", "right of" a robot at pose (4,): quadrants about its yaw.

    With a `reach` (m) what is further away in every direction is "elsewhere".

    Raises:
        ValueError: if an argument is not finite, or reach not above 0.
    """
    pose = np.asarray(pose, dtype=np.float64)
    if pose.shape != (4,) or not np.isfinite(pose).all():
        raise ValueError(f"pose: expected four finite numbers, got {pose}")
    c, s = np.cos(pose[3]), np.sin(pose[3])
    ahead = np.array([c, s])
    aside = np.array([-s, c])
    # The difference of two neighbouring directions has length sqrt(2).
    axes = np.stack([ahead, -ahead, aside, -aside])
    return _sides(axes, np.zeros(4), pose[:2], _steep(steepness) / sqrt(2.0), reach, steepness, dimension)


def wall(
    start: FloatArray, end: FloatArray, steepness: float, *, reach: float | None = None, dimension: int = 2
) -> SoftModel:
    """ "in front of", "behind", "left of", "right of" a wall, the segment from start (2,) to end (2,).

    The front is to the left of somebody who walks from start to end. Left and right are beyond the ends, for
    somebody in front who looks at the wall: beyond `end` is "left of" it. Borders leave the ends at 45
    degrees. With a `reach` (m) what is further away is "elsewhere".

    Raises:
        ValueError: if an argument is not finite, the wall has no length, or reach is not above 0.
    """
    start, end = _points(start, 1, "start")[0], _points(end, 1, "end")[0]
    length = float(np.linalg.norm(end - start))
    if length == 0.0:
        raise ValueError("end: expected another point than start")
    along = (end - start) / length
    front = np.array([-along[1], along[0]])
    axes = np.stack([front, -front, along, -along])
    half = 0.5 * length
    # Front and back meet in the wall, where their difference has length 2.
    return _sides(
        axes,
        np.array([0.0, 0.0, half, half]),
        0.5 * (start + end),
        0.5 * _steep(steepness),
        reach,
        steepness,
        dimension,
    )


def _sides(
    axes: FloatArray,
    insets: FloatArray,
    centre: FloatArray,
    slope: float,
    reach: float | None,
    steepness: float,
    dimension: int,
) -> SoftModel:
    """Four sub-classes slope (axis . (x - centre) - inset), and beyond reach four more as one category."""
    weights, biases = slope * axes, -slope * insets
    classes = np.arange(4)
    names: tuple[str, ...] = ("in front of", "behind", "left of", "right of")
    if reach is not None:
        if not 0.0 < reach < np.inf:
            raise ValueError(f"reach: expected a finite number above 0, got {reach}")
        biases = np.concatenate([biases, biases - steepness * (insets + reach)])
        weights = np.concatenate([weights, weights + steepness * axes])
        classes = np.append(classes, np.full(4, 4))
        names = (*names, "elsewhere")
    return SoftModel(_raised(Softmax(weights, biases - weights @ centre, classes), dimension), names)


def _raised(softmax: Softmax, dimension: int) -> Softmax:
    """A model of the ground plan in 2 or 3 dimensions."""
    if dimension not in (2, 3):
        raise ValueError(f"dimension: expected 2 or 3, got {dimension}")
    height = np.zeros((len(softmax.weights), dimension - 2))
    return Softmax(np.concatenate([softmax.weights, height], axis=1), softmax.biases, softmax.class_of)


def _steep(steepness: float) -> float:
    if not 0.0 < steepness < np.inf:
        raise ValueError(f"steepness: expected a finite number above 0, got {steepness}")
    return float(steepness)


def _points(points: FloatArray, count: int | None, name: str) -> FloatArray:
    array = np.atleast_2d(np.asarray(points, dtype=np.float64))
    if array.ndim != 2 or array.shape[1] != 2 or (count is not None and len(array) != count):
        wanted = "(2,)" if count == 1 else "(k, 2)"
        raise ValueError(f"{name}: expected shape {wanted}, got {np.shape(points)}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: every number must be finite")
    return array
