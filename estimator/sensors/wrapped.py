"""What a sensor model that is made of another one leaves as it is."""

import numpy as np

from estimator.arrays import BoolArray, FloatArray
from estimator.sensor import Look, SensorModel, gaussian


class Wrapped:
    """A sensor model that answers as `sensor` does; a subclass says what it changes.

    What only a sensor with Gaussian noise has (`noise`, `angular`, `measure`, `jacobian`) raises ValueError
    if the inner one has it not.
    """

    __slots__ = ()
    sensor: SensorModel

    @property
    def dimension(self) -> int:
        return self.sensor.dimension

    @property
    def measurement_size(self) -> int:
        return self.sensor.measurement_size

    def detection(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        """p_D (k, n) of points (d, n) from poses (k, 4)."""
        return self.sensor.detection(points, poses)

    def look(self, points: FloatArray, pose: FloatArray, measurements: FloatArray) -> Look:
        """All that a measurement set (m, s) taken at pose (4,) says about points (d, n)."""
        return self.sensor.look(points, pose, measurements)

    def locate(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """Where measurements (m, s) point, (d, m)."""
        return self.sensor.locate(measurements, pose)

    def location_covariance(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """(m, d, d) of these places."""
        return self.sensor.location_covariance(measurements, pose)

    def clutter_intensity(self, measurements: FloatArray, pose: FloatArray) -> FloatArray:
        """c(z; q) (m,) at measurements (m, s)."""
        return self.sensor.clutter_intensity(measurements, pose)

    @property
    def noise(self) -> FloatArray:
        """(s, s)."""
        return gaussian(self.sensor).noise

    @property
    def angular(self) -> BoolArray:
        """(s,) which components are angles."""
        return gaussian(self.sensor).angular

    def measure(self, targets: FloatArray, pose: FloatArray) -> FloatArray:
        """Noise-free measurements (n, s) of targets (d, n)."""
        return gaussian(self.sensor).measure(targets, pose)

    def jacobian(self, targets: FloatArray, pose: FloatArray) -> FloatArray:
        """(n, s, d) of these measurements."""
        return gaussian(self.sensor).jacobian(targets, pose)

    def sample(self, targets: FloatArray, pose: FloatArray, rng: np.random.Generator) -> FloatArray:
        """One random measurement set (m, s) of targets (d, n)."""
        return self.sensor.sample(targets, pose, rng)

    def outline(self, pose: FloatArray) -> FloatArray:
        """(k, 3) the edge of the field of view, for people."""
        return self.sensor.outline(pose)
