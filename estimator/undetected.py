"""The intensity of targets that were never detected: smooth, so it is kept on a grid and not in particles.

It starts uniform, grows by births, falls by 1 - p_D where a sensor looked, and fills up again where targets
move (`estimator.diffusion`): what (MA)ASI (12)-(13) do to it, without Monte Carlo noise. What a measurement
makes of it is narrow and leaves it, see `estimator.newly_detected`. Compare the
undetected-target intensity of Olofsson et al., and the measurement-driven birth of Ristic, Clark, Vo & Vo
(2012); here the prior of the new particles is the uniform intensity that the paper has, nothing is added to
it.
"""

from dataclasses import dataclass, replace

import numpy as np

from estimator.arrays import FloatArray
from estimator.diffusion import blurred, exchanged, parted, shifted
from estimator.exploration import undetected
from estimator.filter import Area
from estimator.grid import interpolate, node_volumes, nodes
from estimator.kernels import kernel
from estimator.motion import Motion
from estimator.sensor import SensorModel


@dataclass(frozen=True, slots=True, eq=False)
class Undetected:
    """Intensity values on a grid over the area, multilinear in between, 0 outside it and its free space."""

    values: FloatArray  # (g1, ..., gd) targets per m^d
    area: Area
    # Of moving targets with a velocity, else None and nothing:
    parts: FloatArray | None = None  # (2, ..., 2, g1, ..., gd) `values` by direction of motion
    travelled: tuple[float, ...] = ()  # (d,) metres that the parts have not been shifted yet

    @staticmethod
    def uniform(area: Area, points: tuple[int, ...], mass: float) -> "Undetected":
        """`mass` targets spread evenly.

        Raises:
            ValueError: if the area has a map and no node lies in free space.
        """
        if area.map is None:
            return Undetected(np.full(points, mass / area.volume), area)
        return Undetected(mass * _even(area, points), area)

    def nodes(self) -> FloatArray:
        """Grid nodes (d, g)."""
        return nodes(self.values.shape, self.area.low, self.area.high)

    def node_masses(self) -> FloatArray:
        """The expected number of targets that each node stands for, (g,)."""
        volumes = node_volumes(self.values.shape, self.area.low, self.area.high)
        return np.asarray((self.values * volumes).ravel())

    def mass(self) -> float:
        """The expected number of targets never detected."""
        return float(self.node_masses().sum())

    def at(self, points: FloatArray) -> FloatArray:
        """The intensity at points (d, n), 0 outside the area and its free space."""
        values = interpolate(self.values, self.area.low, self.area.high, points)
        _zero_outside(points, self.area.low, self.area.high, values)
        if self.area.map is not None:
            values[~self.area.is_free(points)] = 0.0
        return values

    def later(
        self, survival: float, births: float, motion: Motion | None = None, duration: float = 0.0
    ) -> "Undetected":
        """After survival with a probability and `births` expected new targets, (MA)ASI (12).

        With a `motion`, targets have moved for `duration` seconds before; at borders and walls they turn.
        """
        if motion is not None and not motion.is_static:
            return self._moved(motion, duration).later(survival, births)
        if self.parts is not None:
            born = births * _even(self.area, self.values.shape) / 2.0**self.area.dimension
            parts = self.parts * survival + born
            return replace(self, values=_together(parts), parts=parts)
        if self.area.map is None:
            return Undetected(self.values * survival + births / self.area.volume, self.area)
        return Undetected(self.values * survival + births * _even(self.area, self.values.shape), self.area)

    def after(self, sensor: SensorModel, pose: FloatArray) -> "Undetected":
        """What stays undetected after a look, the first term of (13)."""
        values = self.values.copy()
        detection = sensor.detection(self.nodes(), pose[None, :])
        undetected(values.reshape(-1), detection)
        if self.parts is None:
            return Undetected(values, self.area)
        return replace(self, values=values, parts=self.parts * (1.0 - detection.reshape(values.shape)))

    def _moved(self, motion: Motion, duration: float) -> "Undetected":
        spacings = (self.area.high - self.area.low) / np.maximum(np.array(self.values.shape) - 1, 1)
        config, free = motion.config, None
        if self.area.map is not None:
            free = self.area.is_free(self.nodes()).reshape(self.values.shape)
        if config.kind == "random_walk":
            return Undetected(blurred(self.values, spacings, config.drift**2 * duration, free), self.area)
        parts = parted(self.values) if self.parts is None else self.parts
        way = config.speed * duration + np.array(self.travelled or 0.0)
        cells = np.floor(way / spacings)
        parts = shifted(parts, tuple(cells.astype(int).tolist()), free)
        crossings = config.speed * duration / float(np.mean(self.area.high - self.area.low))
        parts = exchanged(parts, float(-np.expm1(-crossings)))
        travelled = tuple((way - cells * spacings).tolist())
        return Undetected(_together(parts), self.area, parts, travelled)


def _even(area: Area, points: tuple[int, ...]) -> FloatArray:
    """Values (g1, ..., gd) of one target, evenly wherever one can be."""
    free = area.is_free(nodes(points, area.low, area.high)).reshape(points)
    volume = float((free * node_volumes(points, area.low, area.high)).sum())
    if volume == 0.0:
        raise ValueError("grid_points: none of them lies in free space of the map; take more")
    return np.asarray(free / volume, dtype=np.float64)


def _together(parts: FloatArray) -> FloatArray:
    return np.asarray(parts.sum(axis=tuple(range(parts.ndim // 2))))


@kernel
def _zero_outside(points: FloatArray, low: FloatArray, high: FloatArray, values: FloatArray) -> None:
    for k in range(values.size):
        inside = True
        for a in range(low.size):
            inside = inside and low[a] <= points[a, k] <= high[a]
        if not inside:
            values[k] = 0.0
