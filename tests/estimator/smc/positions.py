"""A sensor that gives positions with the same p_D everywhere: what closed forms and other libraries know."""

from dataclasses import dataclass, field

import numpy as np

from estimator.arrays import FloatArray
from estimator.sensor import Look


@dataclass(frozen=True)
class Positions:
    """z = x + normal noise of covariance `noise`, in 2D; clutter intensity `clutter` per m^2 everywhere."""

    noise: FloatArray = field(default_factory=lambda: np.diag([0.4, 0.9]))
    p_d: float = 1.0
    clutter: float = 0.0
    dimension: int = 2
    measurement_size: int = 2

    def detection(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        return np.full((len(np.atleast_2d(poses)), points.shape[1]), self.p_d)

    def look(self, points: FloatArray, pose: FloatArray, measurements: FloatArray) -> Look:
        off = points[None] - measurements[:, :, None]
        g = np.exp(-0.5 * np.einsum("man,ab,mbn->mn", off, np.linalg.inv(self.noise), off))
        g /= 2 * np.pi * np.sqrt(np.linalg.det(self.noise))
        m, n = g.shape
        return Look(
            np.full(n, self.p_d),
            n * np.arange(m + 1),
            np.tile(np.arange(n), m),
            g.ravel(),
            np.full(m, self.clutter),
        )

    def locate(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        return np.ascontiguousarray(measurements.T)

    def location_covariance(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        return np.repeat(self.noise[None], len(measurements), axis=0)

    def clutter_intensity(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        return np.full(len(measurements), self.clutter)

    def sample(self, targets: FloatArray, pose: FloatArray, rng: np.random.Generator) -> FloatArray:
        seen = targets[:, rng.random(targets.shape[1]) < self.p_d].T
        return np.asarray(seen + rng.multivariate_normal(np.zeros(2), self.noise, len(seen)))

    def outline(self, pose: FloatArray) -> FloatArray:
        return np.zeros((0, 3))
