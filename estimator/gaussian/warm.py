"""Small calls that compile every kernel of this room for the types used at run time."""

import numpy as np

from estimator.filter import Area
from estimator.gaussian.gm_phd import GmPhd, GmPhdConfig
from estimator.motion import MotionConfig
from estimator.sensor import SensorModel


def warm(sensor: SensorModel, area: Area) -> None:
    """A short search with each kind of update, on targets that stand and that move."""
    rng, d = np.random.default_rng(0), area.dimension
    middle = 0.5 * (area.low + area.high)
    pose = np.append(middle, np.zeros(4 - d))
    targets = np.stack([middle + 1.0, middle + 1.2], axis=1)
    for config in (
        GmPhdConfig(birth=0.1, survival=0.99, merge_mutual=True, split_detection=1e-6),
        GmPhdConfig(update="ukf", motion=MotionConfig(kind="constant_velocity", acceleration=0.1)),
    ):
        filter = GmPhd(config)
        state = filter.init(area, rng)
        for k in range(3):
            z = sensor.sample(np.repeat(targets, k + 1, axis=1), pose, rng)
            state = filter.update(filter.predict(state, 1.0, rng), sensor, pose, z, rng)
            state, _ = filter.clusters(state, rng)
        filter.thinned(state, 30)
