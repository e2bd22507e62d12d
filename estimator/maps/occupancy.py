"""An occupancy map: which cells of the ground are free, occupied or unknown, and where they lie."""

from dataclasses import dataclass, replace

import numpy as np

from estimator.arrays import BoolArray, FlagArray, FloatArray
from estimator.kernels import exact_kernel

FREE, OCCUPIED, UNKNOWN = 0, 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyMap:
    """A grid of square cells. Walls have no height: in 3D what holds on the ground holds at every altitude.

    Cell coordinates (u, v) count cells from the map's own corner: column floor(u) along the map's x axis, row
    floor(v) along its y axis; `cells[row, column]`. The corner lies at `origin` in the world, and the map's
    x axis points along the origin's yaw. What lies outside the grid is unknown.

    Raises:
        ValueError: naming the field that is wrong.
    """

    cells: FlagArray  # (rows, columns), FREE, OCCUPIED or UNKNOWN
    resolution: float  # metres per cell
    origin: FloatArray  # (3,) x, y in metres and yaw in radians of the corner of cells[0, 0]

    def __post_init__(self) -> None:
        cells, origin = self.cells, self.origin
        if cells.ndim != 2 or cells.size == 0 or cells.dtype != np.uint8:
            raise ValueError(
                f"cells: expected uint8 of shape (rows, columns), got {cells.dtype} {cells.shape}"
            )
        if cells.max() > UNKNOWN:
            raise ValueError(f"cells: expected 0 (free), 1 (occupied), 2 (unknown), got {cells.max()}")
        if not 0.0 < self.resolution < np.inf:
            raise ValueError(f"resolution: expected a finite number > 0, got {self.resolution}")
        if origin.shape != (3,) or not np.isfinite(origin).all():
            raise ValueError(f"origin: expected 3 finite numbers, got {origin}")

    def __repr__(self) -> str:
        rows, columns = self.cells.shape
        free = np.count_nonzero(self.cells == FREE) / self.cells.size
        return f"OccupancyMap({columns} x {rows} cells of {self.resolution:g} m, {free:.0%} free)"

    def to_cells(self, points: FloatArray) -> FloatArray:
        """Cell coordinates (2, n) of world points (d, n), of which only x and y count."""
        c, s = np.cos(self.origin[2]), np.sin(self.origin[2])
        dx, dy = points[0] - self.origin[0], points[1] - self.origin[1]
        return np.stack([c * dx + s * dy, c * dy - s * dx]) / self.resolution

    def to_world(self, coordinates: FloatArray) -> FloatArray:
        """World points (2, n) in metres of cell coordinates (2, n); a cell's middle is at + 0.5."""
        c, s = np.cos(self.origin[2]), np.sin(self.origin[2])
        x, y = self.resolution * coordinates[0], self.resolution * coordinates[1]
        return np.stack([self.origin[0] + c * x - s * y, self.origin[1] + s * x + c * y])

    def at(self, points: FloatArray) -> FlagArray:
        """FREE, OCCUPIED or UNKNOWN at world points (d, n), shape (n,); UNKNOWN outside the map."""
        u, v = self.to_cells(points)
        rows, columns = self.cells.shape
        inside = (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
        states = np.full(u.shape, UNKNOWN, dtype=np.uint8)
        states[inside] = self.cells[v[inside].astype(np.int64), u[inside].astype(np.int64)]
        return states

    def is_free(self, points: FloatArray) -> BoolArray:
        """Whether world points (d, n) lie in free cells, shape (n,)."""
        return np.asarray(self.at(points) == FREE)

    def free_points(self, spacing: float) -> FloatArray:
        """Points (2, n) in free cells of a regular grid along the map's axes, `spacing` metres apart.

        The first is half a spacing from the map's corner, so that each stands for spacing^2 of ground.

        Raises:
            ValueError: if spacing is not a finite number above 0.
        """
        if not 0.0 < spacing < np.inf:
            raise ValueError(f"spacing: expected a finite number > 0, got {spacing}")
        step = spacing / self.resolution
        rows, columns = self.cells.shape
        u, v = np.meshgrid(np.arange(0.5 * step, columns, step), np.arange(0.5 * step, rows, step))
        free = self.cells[v.astype(np.int64), u.astype(np.int64)] == FREE
        return self.to_world(np.stack([u[free], v[free]]))

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """The corners (2,), (2,) of the smallest box in the world that holds the map."""
        rows, columns = self.cells.shape
        corners = self.to_world(np.array([[0.0, columns, 0.0, columns], [0.0, 0.0, rows, rows]]))
        return corners.min(axis=1), corners.max(axis=1)

    def reachable_from(self, points: FloatArray) -> "OccupancyMap":
        """The map in which free cells that no way leads to from world points (d, n) are unknown.

        A way goes from a free cell to one of its four neighbours. From a point in no free cell no way leads.
        """
        starts = np.ascontiguousarray(self.to_cells(points)[:, self.is_free(points)].astype(np.int64))
        cells = self.cells.copy()
        _fill(cells, starts[0], starts[1])
        return replace(self, cells=cells)


@exact_kernel
def _fill(cells: FlagArray, columns: np.ndarray, rows: np.ndarray) -> None:
    """Make every FREE cell UNKNOWN that is not connected to the given ones."""
    height, width = cells.shape
    reached = np.zeros(cells.shape, np.uint8)
    stack = np.empty((cells.size, 2), np.int32)
    count = 0
    for k in range(rows.size):
        if not reached[rows[k], columns[k]]:
            reached[rows[k], columns[k]] = 1
            stack[count, 0], stack[count, 1] = rows[k], columns[k]
            count += 1
    while count > 0:
        count -= 1
        row, column = stack[count, 0], stack[count, 1]
        for side in range(4):
            j = row + (1 if side == 0 else -1 if side == 1 else 0)
            i = column + (1 if side == 2 else -1 if side == 3 else 0)
            if 0 <= j < height and 0 <= i < width and cells[j, i] == FREE and not reached[j, i]:
                reached[j, i] = 1
                stack[count, 0], stack[count, 1] = j, i
                count += 1
    for j in range(height):
        for i in range(width):
            if cells[j, i] == FREE and not reached[j, i]:
                cells[j, i] = UNKNOWN
