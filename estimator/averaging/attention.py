"""How much one robot has looked at each place: its weight there when robots average what they believe."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.grid import interpolate, nodes
from estimator.kernels import kernel
from estimator.sensor import SensorModel

# Where nobody looked all count the same; this is so little that one look at a place outweighs it.
UNSEEN = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Attention:
    """a(x), the expected number of detections of a target at x, on a grid and multilinear in between.

    Looks add p_D(x; q). It is never 0: `UNSEEN` everywhere stands for what all robots knew at the start.
    """

    values: FloatArray  # (g1, ..., gd)
    area: Area

    @staticmethod
    def none(area: Area, points: tuple[int, ...]) -> "Attention":
        """Before the first look, on `points` nodes per axis."""
        return Attention(np.full(points, UNSEEN), area)

    def nodes(self) -> FloatArray:
        """Grid nodes (d, g)."""
        return nodes(self.values.shape, self.area.low, self.area.high)

    def at(self, points: FloatArray) -> FloatArray:
        """a at points (d, n); outside the area as at its nearest point."""
        return interpolate(self.values, self.area.low, self.area.high, np.ascontiguousarray(points))

    def after(self, sensor: SensorModel, poses: FloatArray) -> "Attention":
        """After looks from poses (k, 4); the empty measurement set is a look too."""
        values = self.values.copy()
        _add(values.reshape(-1), sensor.detection(self.nodes(), np.atleast_2d(poses)))
        return Attention(values, self.area)

    def aged(self, share: float) -> "Attention":
        """With only a share (0..1) of the looks so far.

        After a fusion all know about the same of what was seen until then, so that what is seen afterwards
        should weigh more than it: else a robot that alone sees something new is outvoted by those that are
        sure of the past.

        Raises:
            ValueError: if share is not in 0..1.
        """
        if not 0.0 <= share <= 1.0:
            raise ValueError(f"share: expected a number in 0..1, got {share}")
        return Attention(np.maximum(share * self.values, UNSEEN), self.area)


@kernel
def _add(values: FloatArray, detection: FloatArray) -> None:
    for k in range(detection.shape[0]):
        for i in range(values.size):
            values[i] += detection[k, i]
