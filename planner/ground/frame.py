"""Metres and cells: where a grid lies in the team's frame, and what the cells at some places are."""

from dataclasses import dataclass, field

import numpy as np

from estimator.arrays import FlagArray, FloatArray
from estimator.kernels import exact_kernel

# Of a cell. TIGHT: clear, but ways that can keep more room do. MARGIN: too near to something for a robot.
OPEN, TIGHT, MARGIN, SOLID = 0, 1, 2, 3


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Of a grid with this many layers, turned and moved; cell coordinates are (column, row, layer)."""

    resolution: float  # metres per cell, along rows and columns
    origin: FloatArray  # (3,) x, y in metres and yaw in radians of the corner of the first cell
    low: float  # metres of altitude, of the lowest layer's floor
    high: float  # and the highest one's ceiling; infinite with one layer
    layers: int
    numbers: FloatArray = field(init=False, repr=False)  # for kernels

    def __post_init__(self) -> None:
        # x, y, cos and sin of the yaw, metres per cell, low, high, metres per layer or 0
        x, y, yaw = self.origin
        turn = np.cos(yaw), np.sin(yaw)
        height = self.layer_height if self.layers > 1 else 0.0
        numbers = np.array([x, y, *turn, self.resolution, self.low, self.high, height])
        object.__setattr__(self, "numbers", numbers)

    @property
    def layer_height(self) -> float:
        """Metres of one layer; with one layer, 1: it does not matter."""
        return (self.high - self.low) / self.layers if self.layers > 1 else 1.0

    @property
    def sides(self) -> FloatArray:
        """(2,) metres of a cell along rows and columns, and of a layer."""
        return np.array([self.resolution, self.layer_height])

    def places(self, points: FloatArray) -> FloatArray:
        """Cell coordinates (3, n) of points (d, n); in the middle of a layer if d = 2 or there is one."""
        return _places(self.numbers, np.ascontiguousarray(points, dtype=np.float64))

    def points(self, places: FloatArray, dimension: int) -> FloatArray:
        """Points (d, n) of cell coordinates (3, n); with one layer their altitude is left 0."""
        x0, y0, c, s = self.numbers[:4]
        x, y = self.resolution * places[0], self.resolution * places[1]
        out = np.zeros((dimension, places.shape[1]))
        out[0], out[1] = x0 + c * x - s * y, y0 + s * x + c * y
        if dimension == 3 and self.layers > 1:
            out[2] = self.low + places[2] * self.layer_height
        return out

    def states(self, cells: FlagArray, points: FloatArray) -> FlagArray:
        """What `cells` (l, r, c) say at points (d, n); SOLID beyond them, or where not finite."""
        return _states(self.numbers, cells, np.ascontiguousarray(points, dtype=np.float64))


@exact_kernel
def _places(numbers: FloatArray, points: FloatArray) -> FloatArray:
    d, n = points.shape
    out = np.empty((3, n))
    for i in range(n):
        dx, dy = points[0, i] - numbers[0], points[1, i] - numbers[1]
        out[0, i] = (numbers[2] * dx + numbers[3] * dy) / numbers[4]
        out[1, i] = (numbers[2] * dy - numbers[3] * dx) / numbers[4]
        out[2, i] = (points[2, i] - numbers[5]) / numbers[7] if d == 3 and numbers[7] > 0.0 else 0.5
    return out


@exact_kernel
def _states(numbers: FloatArray, cells: FlagArray, points: FloatArray) -> FlagArray:
    layers, rows, columns = cells.shape
    d, n = points.shape
    places = _places(numbers, points)
    out = np.full(n, SOLID, np.uint8)
    for i in range(n):
        u, v, w = places[0, i], places[1, i], places[2, i]
        if not (0.0 <= u < columns and 0.0 <= v < rows and 0.0 <= w < layers):
            continue
        if d == 3 and not (numbers[5] <= points[2, i] <= numbers[6] and np.isfinite(points[2, i])):
            continue
        out[i] = cells[int(w), int(v), int(u)]
    return out


@exact_kernel
def nearest_free(
    clearance: FlagArray, cells: FlagArray, place: FloatArray, sides: FloatArray, reach: float, worst: int
) -> FloatArray:
    """The middle (3,) in cell coordinates of the nearest cell that is free in `clearance` (l, r, c).

    Nothing on the straight way there is above `worst` in `cells` (l, r, c). Of the 20 nearest within `reach`
    metres; not numbers if there is none.
    """
    layers, rows, columns = clearance.shape
    u, v, w = place[0], place[1], place[2]
    n, m = int(reach / sides[0]) + 1, (int(reach / sides[1]) + 1 if layers > 1 else 0)
    least = -1.0  # metres; ties go by number
    number = -1
    for _ in range(20):
        best, which = np.inf, -1
        for k in range(max(int(w) - m, 0), min(int(w) + m + 1, layers)):
            for j in range(max(int(v) - n, 0), min(int(v) + n + 1, rows)):
                for i in range(max(int(u) - n, 0), min(int(u) + n + 1, columns)):
                    if clearance[k, j, i] == 0:
                        continue
                    a, b = (i + 0.5 - u) * sides[0], (j + 0.5 - v) * sides[0]
                    c = (k + 0.5 - w) * sides[1] if layers > 1 else 0.0
                    gap, cell = np.sqrt(a * a + b * b + c * c), (k * rows + j) * columns + i
                    later = gap > least or (gap == least and cell > number)
                    if later and gap < best:
                        best, which = gap, cell
        if which < 0 or best > reach:
            break
        least, number = best, which
        x, y, z = which % columns + 0.5, (which // columns) % rows + 0.5, which // (columns * rows) + 0.5
        looks = max(2, int(4.0 * best / sides[0]) + 2)
        good = True
        for s in range(looks):
            share = s / (looks - 1.0)
            i, j = int(u + share * (x - u)), int(v + share * (y - v))
            k = int(w + share * (z - w)) if layers > 1 else 0
            good = good and cells[k, j, i] <= worst
        if good:
            return np.array([x, y, z])
    return np.full(3, np.nan)
