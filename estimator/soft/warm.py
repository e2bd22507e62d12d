"""A small call that compiles every kernel of this room for the types used at run time."""

import numpy as np

from estimator.filter import Area
from estimator.sensor import GaussianSensor
from estimator.soft.config import MixturesConfig
from estimator.soft.mixtures import Mixtures
from estimator.soft.models import ranges
from estimator.soft.statement import SoftObservation


def run(sensor: GaussianSensor, area: Area) -> None:
    """Some looks and some statements, surprising ones too."""
    rng, d = np.random.default_rng(0), area.dimension
    filter = Mixtures(MixturesConfig(unnamed=2, components=5))
    state = filter.init(area, rng)
    middle = 0.5 * (area.low + area.high)
    model = ranges(middle[:2], 2.0, 4.0, 3.0, dimension=d)
    pose = np.array([middle[0], middle[1], 1.0, 0.0])
    state = filter.update(state, sensor, pose, sensor.measure((middle + 2.0)[:, None], pose), rng)
    for positive in (True, False):
        state = filter.observe(state, SoftObservation.of(model, "near", positive=positive), rng)
