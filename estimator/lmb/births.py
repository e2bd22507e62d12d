"""What the intensity of undetected targets makes of measurements: each may be of a new target."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.motion import Motion
from estimator.sensor import GaussianSensor
from estimator.undetected import Undetected, explanations

_AT_ONCE = 4096  # measurements whose explanations are sampled together; bounds the memory


@dataclass(frozen=True, slots=True, eq=False)
class Births:
    """The new target that each of m measurements may be of, if it is of no track."""

    existence: FloatArray  # (m,) e_j / (c_j + e_j), 0 where nothing explains the measurement
    rivals: FloatArray  # (m,) lambda_j = c_j + e_j, what else than a track makes the measurement
    places: FloatArray  # (d, m) where the sensor says the target is
    spreads: FloatArray  # (m, d, d) m^2

    def states(self, chosen: IntArray, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """Means (k, n_x), covariances (k, n_x, n_x) of the chosen new targets; a velocity is 0 on average."""
        means = np.zeros((chosen.size, motion.state_size))
        means[:, : motion.dimension] = self.places[:, chosen].T
        return means, motion.start_covariance(self.spreads[chosen])


def newborn(
    undetected: Undetected, sensor: GaussianSensor, pose: FloatArray, measurements: FloatArray
) -> Births:
    """The new targets of measurements (m, s) taken at pose (4,), from v_n before this look lowers it."""
    m = len(measurements)
    explained = np.zeros(m)
    if undetected.values.any():
        for begin in range(0, m, _AT_ONCE):
            part = measurements[begin : begin + _AT_ONCE]
            explained[begin : begin + _AT_ONCE] = explanations(undetected, sensor, pose, part).totals
    rivals = sensor.clutter_intensity(measurements, pose) + explained
    existence = np.divide(explained, rivals, out=np.zeros(m), where=rivals > 0.0)
    if m == 0:
        d = sensor.dimension
        return Births(existence, rivals, np.zeros((d, 0)), np.zeros((0, d, d)))
    places = sensor.locate(measurements, pose)
    return Births(existence, rivals, places, sensor.location_covariance(measurements, pose))
