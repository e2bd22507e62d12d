"""A simulated sensor: draws from the same model that the filter believes in."""

import numpy as np

from agents.devices import DeviceContext, Sensor, World
from agents.seeds import generator
from estimator.arrays import FloatArray
from estimator.maps.line_of_sight import LineOfSight
from estimator.sensor import SensorModel


class SimulatedSensor(Sensor):
    """Detections, noise and clutter of the model, of what is really there."""

    def __init__(self, model: SensorModel, world: World, rng: np.random.Generator) -> None:
        self._model = model
        self._world = world
        self._rng = rng

    def measure(self, now: float, pose: FloatArray) -> FloatArray:
        return self._model.sample(self._world.targets(now), pose, self._rng)


def simulated(model: SensorModel, context: DeviceContext) -> SimulatedSensor:
    """One robot's sensor with its own random draws, which sees no target behind a wall of the map."""
    if context.sight is not None:
        model = LineOfSight(model, context.sight)
    return SimulatedSensor(model, context.world, generator(context.seed, "sensor", context.robot))
