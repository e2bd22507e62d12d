"""What the view draws, as plain arrays: colours, ellipses, marks, thinned trails. Knows nothing of Rerun.

A two-dimensional mission is drawn as a map: everything lies flat, in layers a hair apart so that what
matters more covers what matters less.
"""

import colorsys
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.wire.messages import Array
from estimator.arrays import FloatArray

Colour = tuple[int, int, int, int]
Bytes = NDArray[np.uint8]

BACKGROUND: Colour = (13, 16, 23, 255)
GRID: Colour = (62, 72, 92, 255)
BORDER: Colour = (120, 134, 156, 190)
FOUND: Colour = (74, 222, 128, 255)
TRUTH: Colour = (226, 232, 240, 150)
CLUSTER: Colour = (250, 204, 21, 230)
UNEXPLORED: Colour = (56, 84, 132, 255)

# Kept clear of green (found), yellow (clusters) and the fire colours of the intensity.
_ROBOTS = ("4cc2ff", "ff6fb5", "b794ff", "2dd4bf", "ff8a65", "a3bffa", "f5a3ff", "7dd3c0")
_FIRE = np.array(
    [[88, 44, 120], [158, 42, 128], [226, 62, 82], [253, 146, 52], [254, 236, 150]], dtype=np.float64
)

_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 41)


def robot_colour(index: int) -> Colour:
    """The colour of the index-th robot of the mission; beyond the palette, hues that do not repeat."""
    if index < len(_ROBOTS):
        text = _ROBOTS[index]
        return int(text[0:2], 16), int(text[2:4], 16), int(text[4:6], 16), 255
    hue = 0.5 + 0.45 * ((index * 0.6180339887) % 1.0)  # cyan to pink, the golden ratio spreads them
    red, green, blue = colorsys.hls_to_rgb(hue, 0.68, 0.8)
    return int(255 * red), int(255 * green), int(255 * blue), 255


def faded(colour: Colour, alpha: int) -> Colour:
    """The same colour with another opacity, 0 to 255."""
    return (*colour[:3], alpha)


def fire(values: FloatArray) -> Bytes:
    """Colours (k, 3) of values (k,) between 0 and 1, from dark violet over red to pale yellow."""
    position = np.clip(values, 0.0, 1.0) * (len(_FIRE) - 1)
    lower = np.minimum(position.astype(np.int64), len(_FIRE) - 2)
    share = (position - lower)[:, None]
    return np.asarray(_FIRE[lower] * (1.0 - share) + _FIRE[lower + 1] * share, dtype=np.uint8)


def local_mass(points: Array, weights: Array, low: FloatArray, high: FloatArray) -> FloatArray:
    """The expected number of targets (k,) in the small cell around each point (d, k): how hot it is there."""
    cells = 64 if len(low) == 2 else 26
    share = (points.T.astype(np.float64) - low) / np.maximum(high - low, 1e-9)
    index = np.clip((share * cells).astype(np.int64), 0, cells - 1)
    flat = np.ravel_multi_index(tuple(index.T), (cells,) * len(low))
    mass = np.bincount(flat, weights=weights, minlength=cells ** len(low))
    return np.asarray(mass[flat], dtype=np.float64)


def lifted(points: Array, height: float) -> FloatArray:
    """Columns of points (d, k) as rows (k, 3); a missing z becomes `height`."""
    rows = np.full((points.shape[1], 3), height)
    rows[:, : points.shape[0]] = points.T
    return rows


def ellipse(mean: Array, covariance: Array, height: float, sigmas: float = 2.0) -> FloatArray:
    """The closed curve (41, 3) around a 2D Gaussian at so many standard deviations."""
    values, vectors = np.linalg.eigh(covariance)
    half = sigmas * np.sqrt(np.maximum(values, 0.0))
    curve = np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE)]) * half
    return np.column_stack([curve @ vectors.T + mean, np.full(len(_CIRCLE), height)])


def ellipsoid(covariance: Array, sigmas: float = 2.0) -> tuple[FloatArray, FloatArray]:
    """Half axes (3,) and orientation quaternion (4,) x, y, z, w of a 3D Gaussian."""
    values, vectors = np.linalg.eigh(covariance)
    if np.linalg.det(vectors) < 0.0:
        vectors = vectors * np.array([1.0, 1.0, -1.0])
    return sigmas * np.sqrt(np.maximum(values, 0.0)), _quaternion(vectors)


def area_lines(low: FloatArray, high: FloatArray, height: float) -> tuple[list[FloatArray], float]:
    """Lines over the ground at round distances, and that distance in metres."""
    spacing = round_step(float((high - low)[:2].max()) / 4.0)
    lines = []
    for axis in (0, 1):
        for at in np.arange(np.ceil(low[axis] / spacing) * spacing, high[axis] + 1e-9, spacing):
            ends = np.array([[low[0], low[1], height], [high[0], high[1], height]])
            ends[:, axis] = at
            lines.append(ends)
    return lines, spacing


def round_step(about: float) -> float:
    """The number 1, 2 or 5 times a power of ten that is nearest below."""
    power = 10.0 ** np.floor(np.log10(about))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= about * (1.0 + 1e-9)))


def box_edges(low: FloatArray, high: FloatArray) -> list[FloatArray]:
    """The outline of the area: a rectangle on a map, the twelve edges of a box in space."""
    bottom, top = (low[2], high[2]) if len(low) == 3 else (0.0, 0.0)
    corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    loop = np.vstack([corners, corners[:1]])
    floor = np.column_stack([loop, np.full(5, bottom)])
    if len(low) == 2:
        return [floor]
    roof = np.column_stack([loop, np.full(5, top)])
    return [floor, roof, *(np.stack([floor[i], roof[i]]) for i in range(4))]


def crosses(centres: FloatArray, size: float, dimension: int) -> list[FloatArray]:
    """A small cross at each centre (k, 3): two strokes on a map, three in space."""
    axes = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0]]) * np.sqrt(0.5) if dimension == 2 else np.eye(3)
    return [np.stack([centre - size * axis, centre + size * axis]) for centre in centres for axis in axes]


def rings(centres: FloatArray, radius: float) -> list[FloatArray]:
    """A flat circle (41, 3) around each centre (k, 3)."""
    curve = radius * np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE), np.zeros(len(_CIRCLE))])
    return [curve + centre for centre in centres]


def exploration_image(values: Array, size: FloatArray, longest: int = 96) -> Bytes:
    """The exploration grid (g1, g2), 255 = unexplored, as an RGB picture with square pixels, north up.

    Between grid points it is bilinear, as the planner reads it. `size` (2,) is the area's, in metres.
    """
    width, height = np.maximum(1, np.rint(longest * size / size.max())).astype(int)
    columns = np.linspace(0.0, values.shape[0] - 1.0, 2 * width + 1)[1::2]
    rows = np.linspace(values.shape[1] - 1.0, 0.0, 2 * height + 1)[1::2]
    share = _between(_between(values.astype(np.float64) / 255.0, columns).T, rows)
    return blended(UNEXPLORED, 0.75 * share)


def _between(values: FloatArray, positions: FloatArray) -> FloatArray:
    """Linear interpolation of the rows of `values` at fractional row numbers."""
    lower = np.clip(positions.astype(np.int64), 0, max(len(values) - 2, 0))
    upper = np.minimum(lower + 1, len(values) - 1)
    share = (positions - lower)[:, None]
    return values[lower] * (1.0 - share) + values[upper] * share


def blended(colour: Colour, share: FloatArray) -> Bytes:
    """So much of a colour on the background: shares (...) between 0 and 1 to RGB (..., 3)."""
    ground = np.array(BACKGROUND[:3], dtype=np.float64)
    return np.asarray(ground + share[..., None] * (np.array(colour[:3]) - ground), dtype=np.uint8)


def unexplored_points(values: Array, low: FloatArray, high: FloatArray, most: int) -> FloatArray:
    """Positions (k, 3) of the grid points (g1, g2, g3) more than half unexplored, at most about `most`."""
    step = max(1, int(np.ceil((values.size / most) ** (1.0 / 3.0))))
    coarse = values[step // 2 :: step, step // 2 :: step, step // 2 :: step]
    index = np.argwhere(coarse > 127) * step + step // 2
    return np.asarray(
        low + index * (high - low) / np.maximum(np.array(values.shape) - 1, 1), dtype=np.float64
    )


@dataclass(slots=True)
class Trail:
    """Where a robot has been, thinned so that a long run stays small: points lie at least `spacing` apart."""

    spacing: float  # metres
    longest: int = 400  # points; beyond it every other one goes and the spacing doubles
    points: list[FloatArray] = field(default_factory=list)

    def add(self, point: FloatArray) -> None:
        """Remember a position (3,) if it is far enough from the last."""
        if self.points and float(np.linalg.norm(point - self.points[-1])) < self.spacing:
            return
        self.points.append(point)
        if len(self.points) > self.longest:
            self.points = self.points[::2]
            self.spacing *= 2.0

    def strip(self, head: FloatArray) -> FloatArray:
        """The trail and where the robot is now, (k, 3)."""
        return np.array([*self.points, head])


def _quaternion(rotation: NDArray[Any]) -> FloatArray:
    """x, y, z, w of a rotation matrix (3, 3): the main eigenvector of K (Bar-Itzhack 2000)."""
    r = rotation
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0.0, 0.0, 0.0],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0.0, 0.0],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0.0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    _, vectors = np.linalg.eigh(k / 3.0, UPLO="L")
    return np.asarray(vectors[:, -1], dtype=np.float64)
