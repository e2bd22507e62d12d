"""The exploration function e: how much of each place nobody has looked at, (MA)ASI (20), (30).

Yousuf, Herzal, Lendek, Buşoniu, "Multi-agent active multi-target search with intermittent measurements",
Control Engineering Practice, 2024.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.grid import interpolate, nodes
from estimator.kernels import kernel
from estimator.sensor import SensorModel


@dataclass(frozen=True, slots=True)
class Exploration:
    """The exploration function e on a regular grid: the fraction of each grid point still unexplored."""

    values: FloatArray  # (g1, ..., gd) between 0 and 1
    low: FloatArray  # (d,) position of values[0, ..., 0], metres
    high: FloatArray  # (d,) position of values[-1, ..., -1], metres

    @staticmethod
    def unexplored(area: Area, points: tuple[int, ...] | list[int]) -> "Exploration":
        """e_0 = 1 on a grid of `points` nodes per axis whose corners are the area's; 0 outside free space.

        Raises:
            ValueError: if there is not one positive number of nodes per axis of the area.
        """
        if len(points) != area.dimension or min(points) < 1:
            raise ValueError(
                f"points: expected {area.dimension} positive numbers, one per axis, got {points}"
            )
        free = area.is_free(nodes(tuple(points), area.low, area.high))
        return Exploration(free.astype(np.float64).reshape(points), area.low, area.high)

    def nodes(self) -> FloatArray:
        """The grid points x_l, (d, g1 * ... * gd), in the order of `values.ravel()`. Read-only."""
        return nodes(self.values.shape, self.low, self.high)

    def at(self, points: FloatArray) -> FloatArray:
        """e at points (d, n) by multilinear interpolation, shape (n,)."""
        return interpolate(self.values, self.low, self.high, points)

    def after(self, sensor: SensorModel, poses: FloatArray) -> "Exploration":
        """e after measurements at poses (k, 4): e * prod_k (1 - p_D(x; q_k)), (20), (30).

        Sensors of several robots are applied one after another; the product does not depend on the order.
        No pose changes nothing.
        """
        poses = np.atleast_2d(poses)
        if poses.size == 0:
            return self
        values = self.values.copy()
        undetected(values.reshape(-1), sensor.detection(self.nodes(), poses))
        return Exploration(values, self.low, self.high)


@kernel
def undetected(values: FloatArray, detection: FloatArray) -> None:
    """values (g,) times prod_k (1 - detection (k, g)), in place."""
    for k in range(detection.shape[0]):
        for i in range(values.size):
            values[i] *= 1.0 - detection[k, i]
