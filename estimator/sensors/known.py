"""What is already known explains what is seen: teammates and found targets as peaks of the clutter intensity.

A sensor that does not tell its measurements apart also sees what nobody is looking for: the other robots and
the targets found before. Where these stand is known, so their measurements are expected: each known object
adds to c(z; q) the density of its own measurement, and a new target there has to explain more than one.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from estimator.arrays import FloatArray
from estimator.sensor import Look, SensorModel, checked_points
from estimator.sensors.wrapped import Wrapped

# Gauss-Hermite of three nodes: exact for polynomials up to degree five of a normal variable.
_NODES = ((-np.sqrt(3.0), 1.0 / 6.0), (0.0, 2.0 / 3.0), (np.sqrt(3.0), 1.0 / 6.0))
_CORNERS = {d: list(product(_NODES, repeat=d)) for d in (2, 3)}
_STENCILS = {d: np.array([[node for node, _ in corner] for corner in c]).T for d, c in _CORNERS.items()}
_SHARES = {d: np.array([np.prod([w for _, w in corner]) for corner in c]) for d, c in _CORNERS.items()}


@dataclass(frozen=True, slots=True, eq=False)
class WithKnown(Wrapped):
    """A sensor model to whose clutter known objects add their measurements.

    An object at x_k is where a normal variable of standard deviation `spread` (m, every axis) around
    `positions` says, and gives `rates` measurements per set on average, so that
    c(z; q) grows by sum_k rates_k E[g(z | x; q)]. With a rate of p_D or more, a target hypothesised at the
    object's place does not gain on what the object explains.
    """

    sensor: SensorModel
    positions: FloatArray  # (d, k)
    spread: FloatArray  # (k,)
    rates: FloatArray  # (k,)

    def look(self, points: FloatArray, pose: FloatArray, measurements: FloatArray) -> Look:
        """The sensor's look, with the known objects in its clutter intensity.

        Raises:
            ValueError: as the sensor's own, and if positions are not (d, k).
        """
        look = self.sensor.look(points, pose, measurements)
        clutter = look.clutter + self._expected(measurements, pose)
        return Look(look.detection, look.offsets, look.indices, look.likelihood, clutter)

    def clutter_intensity(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """The sensor's own plus what the known objects give."""
        return self.sensor.clutter_intensity(measurements, pose) + self._expected(measurements, pose)

    def sample(self, targets: FloatArray, pose: FloatArray, rng: np.random.Generator) -> FloatArray:
        """As the sensor's own: the known objects' measurements are not drawn."""
        return self.sensor.sample(targets, pose, rng)

    def _expected(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """What the known objects add to the clutter intensity at measurements (m, s)."""
        m = len(measurements)
        if self.positions.shape[1] == 0 or m == 0:
            return np.zeros(m)
        nodes, weights = self._nodes()
        known = self.sensor.look(nodes, pose, measurements)
        rows = np.repeat(np.arange(m), np.diff(known.offsets))
        return np.asarray(
            np.bincount(rows, weights[known.indices] * known.likelihood, minlength=m), np.float64
        )

    def _nodes(self) -> tuple[FloatArray, FloatArray]:
        """Points (d, k 3^d) that stand for the objects' positions, and their rates."""
        d = self.dimension
        positions = checked_points(self.positions, d)
        nodes = positions[:, :, None] + self.spread[None, :, None] * _STENCILS[d][:, None, :]
        return np.ascontiguousarray(nodes.reshape(d, -1)), np.outer(self.rates, _SHARES[d]).ravel()


def with_known(
    sensor: SensorModel, positions: FloatArray, spread: FloatArray, rates: FloatArray
) -> SensorModel:
    """The sensor with more known objects, all in one `WithKnown`, so that each is looked at once."""
    if positions.shape[1] == 0:
        return sensor
    if isinstance(sensor, WithKnown):
        positions = np.concatenate([sensor.positions, positions], axis=1)
        spread, rates = np.append(sensor.spread, spread), np.append(sensor.rates, rates)
    return WithKnown(bare(sensor), np.ascontiguousarray(positions), spread, rates)


def bare(sensor: SensorModel) -> SensorModel:
    """The sensor without known objects, for where its clutter does not matter."""
    return sensor.sensor if isinstance(sensor, WithKnown) else sensor
