"""Where a sensor detects targets: p_D(x; q) of several shapes of field of view.

All shapes ignore the height of pose and target when the target space is 2D.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from estimator.arrays import FloatArray
from estimator.kernels import exp_negative, kernel
from estimator.sensor import checked_points, checked_poses
from estimator.sensors.smooth_field import exponential_slopes, smooth_sector, smooth_sector_slopes

Shape = Literal["exponential", "box", "sector", "smooth_sector"]
_CODES: dict[str, int] = {"exponential": 0, "box": 1, "sector": 2, "smooth_sector": 3}


@dataclass(frozen=True, slots=True, eq=False)
class FieldOfView:
    """p_D(x; q) = G s(x; q) t(r) min(1, beam / r), with gain G, shape s and a table t over the range r.

    - exponential: s = exp(-|zeta| / 2), zeta the offset divided by `size` (F_x, F_y(, F_z)), (MA)ASI (3)-(4).
    - box: s = 1 in a box around the robot, 0 elsewhere, (MA)ASI (25), (34); `size` is
      (x_min, x_max, y_min, y_max(, z_min, z_max)); the box turns with yaw if `turns`.
    - sector: s = 1 between two ranges within an opening about the yaw direction (in the horizontal
      plane), 0 elsewhere; `size` is (range_min, range_max, full opening in radians), Liu & Hedrick fig. 2.
    - smooth_sector: s = 1 / (1 + alpha_1 r^2) / (1 + exp(-alpha_2 (cos(bearing) - cos(opening / 2)))) with
      bearings from the yaw, differentiable, Liu & Hedrick (7); `size` is (alpha_1 in 1/m^2, alpha_2, full
      opening in radians).

    The table is linear between its breaks and constant outside them; there may be none. `beam` is the range
    up to which a scanner's beams leave no gap that a target fits into, Dames & Kumar (29), or infinity.
    """

    dimension: int
    shape: Shape
    gain: float
    size: FloatArray
    turns: bool = False
    breaks: FloatArray = field(default_factory=lambda: np.zeros(0))  # (b,) metres, ascending; none: t = 1
    gains: FloatArray = field(default_factory=lambda: np.zeros(0))  # (b,)
    beam: float = np.inf  # metres

    def detection(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        """p_D of points (d, n) from poses (k, 4), shape (k, n).

        Raises:
            ValueError: if a shape is another or a pose is not finite.
        """
        points = checked_points(points, self.dimension)
        poses = checked_poses(poses)
        out = np.empty((poses.shape[0], points.shape[1]))
        code = _CODES[self.shape]
        if code == 0:
            _exponential(points, poses, self.gain, self.size, out)
        elif code == 3:
            smooth_sector(points, poses, self.gain, self.size, out)
        else:
            _edged(points, poses, self.gain, code, self.size, self.turns or code == 2, out)
        if self.breaks.size:
            _times_table(points, poses, self.breaks, self.gains, out)
        if self.beam < np.inf:
            _times_beam(points, poses, self.beam, out)
        return out

    def slopes(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        """Derivatives (k, n, 4) of p_D by the pose's x, y, z (1/m) and yaw (1/rad).

        Those by the point are the first d of them with the other sign. Where a shape has a tip or a direction
        is not defined (on the sensor, above it), the derivative is 0.

        Raises:
            ValueError: as `detection`, and if the field has edges or factors over the range.
        """
        points = checked_points(points, self.dimension)
        poses = checked_poses(poses)
        if self.shape not in ("exponential", "smooth_sector") or self.breaks.size or self.beam < np.inf:
            raise ValueError(
                "field_of_view: only an exponential one and a smooth_sector, without a table or beams, "
                f"have derivatives; this is {self.shape}"
            )
        out = np.zeros((poses.shape[0], points.shape[1], 4))
        if self.shape == "exponential":
            exponential_slopes(points, poses, self.gain, self.size, out)
        else:
            smooth_sector_slopes(points, poses, self.gain, self.size, out)
        return out

    def outline(self, pose: FloatArray) -> FloatArray:
        """A closed polyline (k, 3) around the field of view.

        Exponential: where s falls to 1/e; smooth sector: half-value range and opening.
        """
        yaw = pose[3] if self.turns or self.shape in ("sector", "smooth_sector") else 0.0
        if self.shape == "box":
            x0, x1, y0, y1 = self.size[:4]
            local = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
        elif self.shape in ("sector", "smooth_sector"):
            near, far, opening = self.size
            if self.shape == "smooth_sector":
                near, far = 0.0, self.size[0] ** -0.5
            angles = np.linspace(-opening / 2, opening / 2, 25)
            arc = np.column_stack([np.cos(angles), np.sin(angles)])
            local = np.vstack([far * arc, near * arc[::-1], far * arc[:1]])
        else:
            angles = np.linspace(-np.pi, np.pi, 49)
            local = 2.0 * np.column_stack([self.size[0] * np.cos(angles), self.size[1] * np.sin(angles)])
        c, s = np.cos(yaw), np.sin(yaw)
        outline = np.empty((len(local), 3))
        outline[:, 0] = pose[0] + c * local[:, 0] - s * local[:, 1]
        outline[:, 1] = pose[1] + s * local[:, 0] + c * local[:, 1]
        outline[:, 2] = pose[2]
        return outline


@kernel
def _exponential(
    points: FloatArray, poses: FloatArray, gain: float, reach: FloatArray, out: FloatArray
) -> None:
    """(MA)ASI (3)-(4)."""
    for k in range(poses.shape[0]):
        x, y, fx, fy = poses[k, 0], poses[k, 1], 0.5 / reach[0], 0.5 / reach[1]
        if points.shape[0] == 2:
            for i in range(points.shape[1]):
                dx, dy = (points[0, i] - x) * fx, (points[1, i] - y) * fy
                out[k, i] = gain * exp_negative(-np.sqrt(dx * dx + dy * dy))
        else:
            z, fz = poses[k, 2], 0.5 / reach[2]
            for i in range(points.shape[1]):
                dx, dy, dz = (points[0, i] - x) * fx, (points[1, i] - y) * fy, (points[2, i] - z) * fz
                out[k, i] = gain * exp_negative(-np.sqrt(dx * dx + dy * dy + dz * dz))


@kernel
def _edged(
    points: FloatArray,
    poses: FloatArray,
    gain: float,
    code: int,
    size: FloatArray,
    turns: bool,
    out: FloatArray,
) -> None:
    """Box and sector: the gain inside, 0 outside; edges belong to the inside."""
    d = points.shape[0]
    half = 0.5 * size[2]
    edge_c, edge_s = np.cos(half), np.sin(half)
    for k in range(poses.shape[0]):
        c, s = (np.cos(poses[k, 3]), np.sin(poses[k, 3])) if turns else (1.0, 0.0)
        for i in range(points.shape[1]):
            dx, dy = points[0, i] - poses[k, 0], points[1, i] - poses[k, 1]
            dz = points[2, i] - poses[k, 2] if d == 3 else 0.0
            ahead, left = c * dx + s * dy, c * dy - s * dx
            if code == 1:
                inside = size[0] <= ahead <= size[1] and size[2] <= left <= size[3]
                if d == 3:
                    inside = inside and size[4] <= dz <= size[5]
            else:
                r2 = dx * dx + dy * dy + dz * dz
                inside = size[0] * size[0] <= r2 <= size[1] * size[1]
                if inside:
                    # beyond = distance times sin(|bearing| - half); the angle itself decides only near 0
                    beyond = abs(left) * edge_c - ahead * edge_s
                    if abs(beyond) > 1e-9 * (abs(left) + abs(ahead)):
                        inside = beyond < 0.0
                    else:
                        inside = abs(np.arctan2(left, ahead)) <= half
            out[k, i] = gain if inside else 0.0


@kernel
def _times_table(
    points: FloatArray, poses: FloatArray, breaks: FloatArray, gains: FloatArray, out: FloatArray
) -> None:
    """Multiply by the piecewise linear table over the range."""
    last = breaks.size - 1
    for k in range(poses.shape[0]):
        for i in range(points.shape[1]):
            if out[k, i] == 0.0:
                continue
            r2 = (points[0, i] - poses[k, 0]) ** 2 + (points[1, i] - poses[k, 1]) ** 2
            if points.shape[0] == 3:
                r2 += (points[2, i] - poses[k, 2]) ** 2
            r = np.sqrt(r2)
            if r <= breaks[0]:
                out[k, i] *= gains[0]
            elif r >= breaks[last]:
                out[k, i] *= gains[last]
            else:
                b = np.searchsorted(breaks, r, side="right") - 1
                t = (r - breaks[b]) / (breaks[b + 1] - breaks[b])
                out[k, i] *= gains[b] + t * (gains[b + 1] - gains[b])


@kernel
def _times_beam(points: FloatArray, poses: FloatArray, beam: float, out: FloatArray) -> None:
    """Multiply by min(1, beam / r)."""
    for k in range(poses.shape[0]):
        for i in range(points.shape[1]):
            r2 = (points[0, i] - poses[k, 0]) ** 2 + (points[1, i] - poses[k, 1]) ** 2
            if points.shape[0] == 3:
                r2 += (points[2, i] - poses[k, 2]) ** 2
            if r2 > beam * beam:
                out[k, i] *= beam / np.sqrt(r2)
