"""Small calls that compile every kernel of this room for the types used at run time, to the cache on disk."""

from collections.abc import Callable
from functools import partial

import numpy as np

from estimator.filter import Area
from estimator.gaussian import warm as gaussian
from estimator.lmb import warm as lmb
from estimator.maps import warm as maps
from estimator.metrics.gospa import gospa, matched
from estimator.search import Search
from estimator.sensors import warm as sensors
from estimator.sensors.range_bearing import RangeBearing, RangeBearingConfig
from estimator.smc.config import SmcPhdConfig
from estimator.smc.kmeans import kmeans
from estimator.smc.smc_phd import SmcPhd
from estimator.soft import warm as soft
from estimator.spacing import capped

_SHAPES = ("exponential", "box", "sector")


def warmups() -> list[tuple[str, Callable[[], None]]]:
    """Named calls; after all of them no kernel of estimator/ needs a compiler."""
    # The longest first, so that in the end no process works alone.
    calls: list[tuple[str, Callable[[], None]]] = []
    calls += [(f"LMB filter, {d}D", partial(lmb.run, *_sensor(d, "exponential"))) for d in (2, 3)]
    calls += [(f"PHD filter, {d}D", partial(_search, d)) for d in (2, 3)]
    calls += [(f"mixtures filter, {d}D", partial(soft.run, *_sensor(d, "exponential"))) for d in (2, 3)]
    calls += [(f"K-means, {d}D", partial(_kmeans, d)) for d in (2, 3)]
    calls += [(f"{shape} field of view, {d}D", partial(_look, d, shape)) for shape in _SHAPES for d in (2, 3)]
    calls += [(f"GM-PHD filter, {d}D", partial(gaussian.warm, *_sensor(d, "exponential"))) for d in (2, 3)]
    calls.append(("metrics and spacing", _metrics))
    calls += [(f"{kind}, {d}D", partial(sensors.run, kind, d)) for kind in sensors.KINDS for d in (2, 3)]
    calls += [(f"line of sight, {d}D", partial(maps.run, *_sensor(d, "exponential"))) for d in (2, 3)]
    return calls


def _sensor(d: int, shape: str) -> tuple[RangeBearing, Area]:
    area = Area(np.zeros(d), np.full(d, 20.0))
    config = RangeBearingConfig(
        period_s=1.0,
        range_sigma_m=0.5,
        bearing_sigma_deg=1.0,
        elevation_sigma_deg=1.0 if d == 3 else None,
        gain=0.9,
        clutter=0.5,
        field_of_view=shape,  # type: ignore[arg-type]
        reach_m=[10.0] * d,
        box_m=[(-10.0, 10.0)] * d,
        range_m=10.0,
        angle_deg=90.0,
        range_breaks_m=[0.0, 10.0],
        range_gains=[1.0, 0.9],
    )
    return RangeBearing.of(config, area), area


def _look(d: int, shape: str) -> None:
    sensor, _ = _sensor(d, shape)
    rng = np.random.default_rng(0)
    pose = np.array([10.0, 10.0, 5.0, 0.5])
    points = rng.uniform(0.0, 20.0, (d, 200))
    sensor.look(points, pose, sensor.measure(points[:, :3], pose))


def _search(d: int) -> None:
    sensor, area = _sensor(d, "exponential")
    rng = np.random.default_rng(0)
    filter = SmcPhd(SmcPhdConfig(particles=200, birth=0.1, survival=0.99))
    search = Search(filter, area, [5] * d, radius=1.0, mass=100.0, gate=4.0)
    state = search.init(rng)
    target = np.full((d, 1), 12.0)
    for k in range(2):
        pose = np.array([10.0 + k, 10.0, 9.0, 0.5])
        state = search.apply(state, sensor, pose, sensor.measure(target, pose), float(k), rng)
    filter.resampled(state.filter_state, rng)
    search.thinned(state, 20)
    state.exploration.at(target)


def _kmeans(d: int) -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.normal(5.0, 0.2, (d, 50)), rng.normal(9.0, 0.2, (d, 50))], axis=1)
    clusters, _ = kmeans(points, np.full(100, 0.02), 3.0)
    kmeans(points, np.full(100, 0.02), 8.0, start=clusters.means)


def _metrics() -> None:
    points = np.random.default_rng(0).uniform(0.0, 1.0, (2, 6))
    gospa(points, points[:, :5], c=0.5)
    matched(points, points[:, :5], 0.5)
    capped(points, np.full(6, 0.5), 0.5)
