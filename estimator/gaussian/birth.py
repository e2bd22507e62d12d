"""New components where measurements show targets that were never detected before.

Measurement-driven birth as Ristic, Clark, Vo & Vo, "Adaptive target birth intensity for PHD and CPHD
filters", IEEE Transactions on Aerospace and Electronic Systems, 2012, but with the undetected intensity as
the prior: nothing is added to it.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.gaussian.components import Components
from estimator.gaussian.pairs import summed
from estimator.gaussian.update import Rule, kalman_pairs
from estimator.grid import node_volumes
from estimator.motion import Motion
from estimator.newly_detected import explanations
from estimator.sensor import GaussianSensor
from estimator.undetected import Undetected

# A measurement is left to the components if they explain it so much better than the undetected part does,
_PLAIN = 1e-2
_TRACE = 1e-4  # or if the new target would have less mass than this.
_BLOCK = 4096  # measurements looked at together: bounds the memory of large sets


@dataclass(frozen=True, slots=True, eq=False)
class Births:
    """What the undetected intensity explains of m measurements, and the components that this becomes."""

    totals: FloatArray  # (m,) e_j = integral of p_D g(z_j | x) v(x), 0 where it is left to others
    components: Components  # (b) of weights that are e_j together for each j
    measurements: IntArray  # (b,) j of each component


def born(
    undetected: Undetected,
    sensor: GaussianSensor,
    pose: FloatArray,
    measurements: FloatArray,
    known: FloatArray,
    clutter: FloatArray,
    motion: Motion,
    rule: Rule,
) -> Births:
    """New components from measurements (m, s) of which other components already explain `known` (m,).

    A sensor that gives a place gives one component per measurement. One that does not (a bearing or a range
    alone) gives a row of them: each cell of the grid is updated by itself, and so keeps the form of a ray or
    a ring.
    """
    if sensor.measurement_size < sensor.dimension:
        return _by_cells(undetected, sensor, pose, measurements, known, clutter, motion, rule)
    places = sensor.location_covariance(measurements, pose)
    # e_j is at most about max v times the integral of g over x; the look at where it is exactly costs more
    volumes = np.sqrt(np.maximum(np.linalg.det(places), 0.0) / np.linalg.det(sensor.noise))
    likely = np.flatnonzero(_worth(2.0 * undetected.values.max() * volumes, known, clutter))
    totals = np.zeros(len(measurements))
    if likely.size == 0:
        return Births(totals, Components.none(motion.state_size), likely)
    centres = np.zeros((len(measurements), sensor.dimension))
    for begin in range(0, likely.size, _BLOCK):
        block = likely[begin : begin + _BLOCK]
        explained = explanations(undetected, sensor, pose, measurements[block])
        totals[block] = _worth(explained.totals, known[block], clutter[block])
        centres[block] = explained.centres.T
    which = likely[totals[likely] > 0.0]
    return Births(totals, _started(totals[which], centres[which], places[which], motion), which)


def _worth(totals: FloatArray, known: FloatArray, clutter: FloatArray) -> FloatArray:
    denominators = clutter + known + totals
    return np.where((totals > _PLAIN * known) & (totals > _TRACE * denominators), totals, 0.0)


def _started(weights: FloatArray, places: FloatArray, spreads: FloatArray, motion: Motion) -> Components:
    """Components at places (b, d) with covariances (b, d, d), their velocities unknown."""
    d, n = motion.dimension, motion.state_size
    means = np.zeros((weights.size, n))
    means[:, :d] = places
    if weights.size == 0:
        return Components.none(n)
    return Components(weights, means, np.ascontiguousarray(motion.start_covariance(spreads)))


def _by_cells(
    undetected: Undetected,
    sensor: GaussianSensor,
    pose: FloatArray,
    measurements: FloatArray,
    known: FloatArray,
    clutter: FloatArray,
    motion: Motion,
    rule: Rule,
) -> Births:
    """Kalman updates of the grid's cells, each a Gaussian as wide as the cell."""
    d, area, shape = sensor.dimension, undetected.area, undetected.values.shape
    masses, nodes = undetected.node_masses(), undetected.nodes()
    live = np.flatnonzero(masses > 0.0)
    detection = sensor.detection(np.ascontiguousarray(nodes[:, live]), pose[None, :])[0]
    live, detection = live[detection > 0.0], detection[detection > 0.0]
    means = np.ascontiguousarray(nodes[:, live].T)
    widths = (area.high - area.low) / np.maximum(np.array(shape) - 1, 1)
    # a share of each axis in step with the node's own volume, so that cells at the border are as small
    shares = (node_volumes(shape, area.low, area.high).ravel()[live] / np.prod(widths)) ** (1.0 / d)
    spreads = (shares**2)[:, None, None] * np.diag(widths**2 / 12.0)
    pairs = kalman_pairs(means, spreads, sensor, pose, measurements, rule=rule, gate=4.0)
    owners = pairs.owners()
    parts = masses[live][owners] * detection[owners] * np.exp(pairs.log_likelihood)
    m = len(measurements)
    totals = _worth(summed(parts, pairs.measurements, m), known, clutter)
    kept = (totals[pairs.measurements] > 0.0) & (parts > 1e-4 * totals[pairs.measurements])
    which = pairs.measurements[kept]
    weights = parts[kept]
    sums = summed(weights, which, m)
    weights = weights * np.divide(totals, sums, out=np.zeros(m), where=sums > 0.0)[which]
    components = _started(weights, pairs.means[kept], pairs.covariances[owners[kept]], motion)
    return Births(totals, components, which)
