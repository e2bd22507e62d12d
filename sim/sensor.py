"""A simulated sensor: draws from the same model that the filter believes in."""

import numpy as np

from agents.devices import Sensor, World
from estimator.arrays import FloatArray
from estimator.sensor import SensorModel


class SimulatedSensor(Sensor):
    """Detections, noise and clutter of the model, of what is really there."""

    def __init__(self, model: SensorModel, world: World, rng: np.random.Generator) -> None:
        self._model = model
        self._world = world
        self._rng = rng

    def measure(self, now: float, pose: FloatArray) -> FloatArray:
        return self._model.sample(self._world.targets(now), pose, self._rng)
