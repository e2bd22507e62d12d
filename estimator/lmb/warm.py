"""A small call of every kernel of the LMB filter, as `estimator.warm` makes them."""

import numpy as np

from estimator.filter import Area
from estimator.lmb.lmb import Lmb
from estimator.motion import MotionConfig
from estimator.sensor import SensorModel


def run(sensor: SensorModel, area: Area) -> None:
    """Tracks are born, associated in every way, merged and thinned, in the area's dimension."""
    d = area.dimension
    pose = np.array([10.0, 10.0, 9.0, 0.5])
    rng = np.random.default_rng(0)
    targets = 12.0 + 0.1 * rng.random((d, 6))
    for association, exact, update in (("lbp", 10, "ekf"), ("lbp", 0, "ukf"), ("gibbs", 0, "ekf")):
        config = Lmb.Config(
            expected_targets=5.0,
            motion=MotionConfig(kind="constant_velocity"),
            association=association,  # type: ignore[arg-type]
            exact_groups=exact,
            update=update,  # type: ignore[arg-type]
            track_merging=3.0,
            spacing_m=0.1,
        )
        filter = Lmb(config)
        state = filter.init(area, rng)
        for count in (6, 4, 6):
            state = filter.predict(state, 0.1, rng)
            state = filter.update(state, sensor, pose, sensor.sample(targets[:, :count], pose, rng), rng)
        state, clusters = filter.clusters(state, rng)
        filter.thinned(filter.remove(state, np.arange(min(1, clusters.masses.size))), 20)
