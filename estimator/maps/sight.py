"""Which points a sensor can see on an occupancy map: exact rays that leap over open ground.

A ray is walked from cell to cell (Amanatides & Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing",
Eurographics 1987). Beside the cells lies how far, in cells, the nearest wall is: within that square around a
cell nothing can stop a ray, so the walk goes on from the square's edge. The answer is that of the plain walk,
in a fraction of the steps. docs/maps.md has the figures, and the designs that were measured and rejected.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FlagArray, FloatArray
from estimator.kernels import exact_kernel
from estimator.maps.occupancy import OCCUPIED, UNKNOWN, OccupancyMap
from estimator.sensor import checked_poses


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """A map made ready for rays; shared by all sensors on it.

    A ray is stopped where it enters a wall's cell. Neither the sensor's own cell nor the point's stops it: a
    robot whose pose is off by a little is not blind, and what hangs on a wall is seen from the wall's front.
    Outside the map nothing is in the way. A ray that only touches the corner of a cell may go either way.
    """

    map: OccupancyMap
    clearance: (
        FlagArray  # (rows, columns) Chebyshev distance to the nearest wall in cells, 0 on one, at most 255
    )

    @staticmethod
    def of(map: OccupancyMap, *, unknown_blocks: bool = False) -> "Sight":
        """Occupied cells are walls, and unknown ones too if `unknown_blocks`."""
        walls = map.cells == OCCUPIED
        if unknown_blocks:
            walls |= map.cells == UNKNOWN
        return Sight(map, chebyshev(np.ascontiguousarray(walls)))

    def visible(self, points: FloatArray, poses: FloatArray) -> BoolArray:
        """Whether each point (d, n) can be seen from each pose (k, 4), shape (k, n).

        Raises:
            ValueError: if a number is not finite.
        """
        poses = checked_poses(poses)
        marks = np.ones((len(poses), points.shape[1]))
        self.hide(points, poses, marks)
        return marks > 0.0

    def hide(self, points: FloatArray, poses: FloatArray, values: FloatArray) -> None:
        """Set values (k, n) to 0 in place where a wall is between pose (k, 4) and point (d, n).

        Only where a value is above 0 a ray is walked, which is what makes a small field of view cheap.

        Raises:
            ValueError: if the coordinates of such a point are not finite.
        """
        eyes = np.ascontiguousarray(self.map.to_cells(poses.T))
        points = np.ascontiguousarray(points, dtype=np.float64)
        if not _hide(self.clearance, self._frame(), points, eyes, values):
            raise ValueError("points: every number must be finite")

    def clear_shares(self, points: FloatArray, pose: FloatArray) -> FloatArray:
        """How much of the way from pose (4,) to each point (d, n) is clear, 0..1; 1 if it can be seen.

        Raises:
            ValueError: if a number is not finite.
        """
        pose = checked_poses(pose)[0]
        if not np.isfinite(points).all():
            raise ValueError("points: every number must be finite")
        out = np.empty(points.shape[1])
        eye, ends = self.map.to_cells(pose[:, None]), self.map.to_cells(points)
        _shares(self.clearance, float(eye[0, 0]), float(eye[1, 0]), ends, out)
        return out

    def _frame(self) -> FloatArray:
        """x, y, cos(yaw), sin(yaw), resolution of the map."""
        x, y, yaw = self.map.origin
        return np.array([x, y, np.cos(yaw), np.sin(yaw), self.map.resolution])


@exact_kernel
def chebyshev(walls: BoolArray) -> FlagArray:
    """Distance of each cell to the nearest wall in king's moves, 0 on a wall, at most 255; (rows, columns).

    Two sweeps over the eight neighbours are exact for this distance (Rosenfeld & Pfaltz 1968).
    """
    rows, columns = walls.shape
    out = np.empty((rows, columns), np.uint8)
    for j in range(rows):
        for i in range(columns):
            best = 0 if walls[j, i] else 254
            if best and i > 0:
                best = min(best, out[j, i - 1])
            if best and j > 0:
                for n in range(max(i - 1, 0), min(i + 2, columns)):
                    best = min(best, out[j - 1, n])
            out[j, i] = 0 if walls[j, i] else best + 1
    for j in range(rows - 1, -1, -1):
        for i in range(columns - 1, -1, -1):
            best = out[j, i]
            if i < columns - 1:
                best = min(best, out[j, i + 1] + 1)
            if j < rows - 1:
                for n in range(max(i - 1, 0), min(i + 2, columns)):
                    best = min(best, out[j + 1, n] + 1)
            out[j, i] = best
    return out


@exact_kernel
def _hide(
    clearance: FlagArray, frame: FloatArray, points: FloatArray, eyes: FloatArray, values: FloatArray
) -> bool:
    """False if a point to be looked at is not finite."""
    x, y, c, s, resolution = frame[0], frame[1], frame[2], frame[3], frame[4]
    for k in range(values.shape[0]):
        for i in range(values.shape[1]):
            if not values[k, i] > 0.0:
                continue
            dx, dy = points[0, i] - x, points[1, i] - y
            u, v = (c * dx + s * dy) / resolution, (c * dy - s * dx) / resolution
            if not (np.isfinite(u) and np.isfinite(v)):
                return False
            if clear_share(clearance, eyes[0, k], eyes[1, k], u, v) < 1.0:
                values[k, i] = 0.0
    return True


@exact_kernel
def _shares(clearance: FlagArray, u: float, v: float, ends: FloatArray, out: FloatArray) -> None:
    for i in range(out.size):
        out[i] = clear_share(clearance, u, v, ends[0, i], ends[1, i])


@exact_kernel
def clear_share(clearance: FlagArray, u0: float, v0: float, u1: float, v1: float) -> float:
    """How much of the way from cell coordinates (u0, v0) to (u1, v1) lies before the first wall; 1: all."""
    rows, columns = clearance.shape
    du, dv = u1 - u0, v1 - v0
    t = _entry(rows, columns, u0, v0, du, dv)
    if t > 1.0:
        return 1.0
    own = 0.0 <= u0 < columns and 0.0 <= v0 < rows
    i = min(max(int(np.floor(u0 + t * du)), 0), columns - 1)
    j = min(max(int(np.floor(v0 + t * dv)), 0), rows - 1)
    goal_i = int(np.floor(u1)) if 0.0 <= u1 < columns else -1
    goal_j = int(np.floor(v1)) if 0.0 <= v1 < rows else -1
    while not (i == goal_i and j == goal_j):
        leap = int(clearance[j, i])
        if leap == 0:
            if not own:
                return t
            leap = 1
        own = False
        tu = ((i + leap if du > 0.0 else i + 1 - leap) - u0) / du if du != 0.0 else np.inf
        tv = ((j + leap if dv > 0.0 else j + 1 - leap) - v0) / dv if dv != 0.0 else np.inf
        t = min(tu, tv)
        if not t < 1.0:
            return 1.0
        # The coordinate that leaves the square is known exactly; rounding must not carry the other one out.
        if tu <= tv:
            i += leap if du > 0.0 else -leap
            j = min(max(int(np.floor(v0 + t * dv)), j + 1 - leap), j - 1 + leap)
        else:
            j += leap if dv > 0.0 else -leap
            i = min(max(int(np.floor(u0 + t * du)), i + 1 - leap), i - 1 + leap)
        if not (0 <= i < columns and 0 <= j < rows):
            return 1.0
    return 1.0


@exact_kernel
def _entry(rows: int, columns: int, u: float, v: float, du: float, dv: float) -> float:
    """Where on its way 0..1 a ray enters the grid: 0 if it begins in it, 2 if it never does."""
    first, last = 0.0, 1.0
    for axis in range(2):
        start, step, size = (u, du, columns) if axis == 0 else (v, dv, rows)
        if step == 0.0:
            if not 0.0 <= start < size:
                return 2.0
        else:
            a, b = -start / step, (size - start) / step
            first, last = max(first, min(a, b)), min(last, max(a, b))
    return first if first < last else 2.0
