"""What the intensity of undetected targets makes of measurements: each may be of a new target."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.gaussian.birth import born
from estimator.gaussian.components import Components
from estimator.gaussian.update import Rule
from estimator.lmb.tracks import Tracks
from estimator.motion import Motion
from estimator.sensor import GaussianSensor
from estimator.undetected import Undetected

_AT_ONCE = 4096  # measurements whose explanations are sampled together; bounds the memory


@dataclass(frozen=True, slots=True, eq=False)
class Births:
    """The new target that each of m measurements may be of, if it is of no track."""

    existence: FloatArray  # (m,) e_j / (c_j + e_j), 0 where nothing explains the measurement
    rivals: FloatArray  # (m,) lambda_j = c_j + e_j, what else than a track makes the measurement
    offsets: IntArray  # (m + 1,) components of each
    components: Components  # of weights that sum to 1 for each measurement

    def tracks(self, chosen: IntArray, existence: FloatArray, labels: IntArray) -> Tracks:
        """Tracks (k) of the chosen measurements (k,)."""
        whole = Tracks(np.arange(self.rivals.size), self.rivals, self.offsets, self.components)
        part = whole.chosen(chosen)
        return Tracks(labels, existence, part.offsets, part.components)


def newborn(
    undetected: Undetected,
    sensor: GaussianSensor,
    pose: FloatArray,
    measurements: FloatArray,
    motion: Motion,
    rule: Rule,
) -> Births:
    """The new targets of measurements (m, s) taken at pose (4,), from v_n before this look lowers it."""
    m = len(measurements)
    clutter = sensor.clutter_intensity(measurements, pose)
    totals, owners, parts = np.zeros(m), [np.zeros(0, np.int64)], [Components.none(motion.state_size)]
    if undetected.values.any():
        for begin in range(0, m, _AT_ONCE):
            part = slice(begin, begin + _AT_ONCE)
            nothing = np.zeros(len(measurements[part]))
            made = born(undetected, sensor, pose, measurements[part], nothing, clutter[part], motion, rule)
            totals[part] = made.totals
            owners.append(begin + made.measurements)
            parts.append(made.components)
    rows = np.concatenate(owners)
    order = np.argsort(rows, kind="stable")
    rows = rows[order]
    components = Components(
        np.concatenate([c.weights for c in parts])[order] / totals[rows],
        np.concatenate([c.means for c in parts])[order],
        np.concatenate([c.covariances for c in parts])[order],
    )
    rivals = clutter + totals
    existence = np.divide(totals, rivals, out=np.zeros(m), where=rivals > 0.0)
    offsets = np.append(0, np.cumsum(np.bincount(rows, minlength=m)))
    return Births(existence, rivals, offsets, components)
