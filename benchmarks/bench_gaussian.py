"""How long the GM-PHD filter takes, and Stone Soup's on the same input in the same run."""

import time
from datetime import datetime
from typing import Any

import numpy as np

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.gaussian.components import Components
from estimator.gaussian.gm_phd import GmPhd, GmPhdState
from estimator.sensors.range_bearing import RangeBearing

SIDE, TARGETS, SIGMA = 200.0, 20, 0.5
AREA = Area(np.zeros(2), np.full(2, SIDE))
SENSOR = RangeBearing.of(
    RangeBearing.Config(
        period_s=1.0, range_sigma_m=SIGMA, bearing_sigma_deg=0.5, reach_m=[60.0] * 2, gain=0.98, clutter=1.0
    ),
    AREA,
)
POSE = np.array([100.0, 100.0, 10.0, 0.0])


def scene(components: int = 200) -> tuple[GmPhd, GmPhdState, FloatArray]:
    """Components about forty places, five each and apart from each other; half of the places are measured."""
    rng = np.random.default_rng(1)
    places = rng.uniform(20.0, SIDE - 20.0, (2 * TARGETS, 2))
    means = places[np.arange(components) % len(places)] + rng.normal(0.0, 1.5, (components, 2))
    root = rng.normal(0.0, 0.3, (components, 2, 2))
    covariances = root @ np.swapaxes(root, 1, 2) + 0.05 * np.eye(2)
    filter = GmPhd(GmPhd.Config(expected_targets=5.0))
    mixture = Components(rng.uniform(0.05, 0.35, components), means, covariances)
    state = GmPhdState(mixture, np.full(components, -1), filter.init(AREA, rng).undetected)
    z = SENSOR.measure(np.ascontiguousarray(places[:TARGETS].T), POSE)
    return filter, state, z + rng.standard_normal(z.shape) * SENSOR.sigmas


def stone_soup_ms(state: GmPhdState, z: FloatArray, repeats: int) -> float:
    """Stone Soup's GM-PHD on the same input, gated, with pruning and merging; the best."""
    from stonesoup.hypothesiser.distance import DistanceHypothesiser  # noqa: PLC0415
    from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser  # noqa: PLC0415
    from stonesoup.measures import Mahalanobis  # noqa: PLC0415
    from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer  # noqa: PLC0415
    from stonesoup.models.measurement.nonlinear import CartesianToBearingRange  # noqa: PLC0415
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, RandomWalk  # noqa: PLC0415
    from stonesoup.predictor.kalman import KalmanPredictor  # noqa: PLC0415
    from stonesoup.types.array import StateVector  # noqa: PLC0415
    from stonesoup.types.detection import Detection  # noqa: PLC0415
    from stonesoup.types.state import TaggedWeightedGaussianState  # noqa: PLC0415
    from stonesoup.updater.kalman import ExtendedKalmanUpdater  # noqa: PLC0415
    from stonesoup.updater.pointprocess import PHDUpdater  # noqa: PLC0415

    when = datetime(2024, 1, 1)
    model = CartesianToBearingRange(
        ndim_state=2,
        mapping=(0, 1),
        noise_covar=np.diag(SENSOR.sigmas[::-1] ** 2),
        translation_offset=StateVector(POSE[:2]),
    )
    updater = ExtendedKalmanUpdater(model)
    still = KalmanPredictor(CombinedLinearGaussianTransitionModel([RandomWalk(0.0), RandomWalk(0.0)]))
    hypothesiser = GaussianMixtureHypothesiser(
        DistanceHypothesiser(still, updater, measure=Mahalanobis(), missed_distance=5.0),
        order_by_detection=True,
    )
    phd = PHDUpdater(updater, clutter_spatial_density=SENSOR.clutter / 1777.0, prob_detection=0.7)
    reducer = GaussianMixtureReducer(prune_threshold=1e-5, merge_threshold=4.0, max_number_components=500)
    detections = [Detection(StateVector([b, r]), timestamp=when, measurement_model=model) for r, b in z]
    best = float("inf")
    for _ in range(repeats):
        mixture = state.components
        given = [
            TaggedWeightedGaussianState(StateVector(x), p, weight=float(w), tag=str(i), timestamp=when)
            for i, (w, x, p) in enumerate(
                zip(mixture.weights, mixture.means, mixture.covariances, strict=True)
            )
        ]
        began = time.perf_counter()
        hypotheses = hypothesiser.hypothesise(given, detections, when)
        reducer.reduce(phd.update(hypotheses).components)
        best = min(best, time.perf_counter() - began)
    return 1e3 * best


def run(benchmark: Any, update: str, quick: bool) -> None:
    """The whole update: p_D, gates, likelihoods, posteriors, births, pruning, merging, cap."""
    filter, state, z = scene()
    filter = GmPhd(filter.config.__class__(expected_targets=5.0, update=update))  # type: ignore[arg-type]
    rng = np.random.default_rng(2)
    after = filter.update(state, SENSOR, POSE, z, rng)
    benchmark.extra_info.update(
        unit="ms",
        asked=1.0,
        note=f"{update.upper()} with pruning and merging, {after.components.count} components after it",
    )
    assert after.components.count > 100
    benchmark(filter.update, state, SENSOR, POSE, z, rng)
    if not quick and update == "ekf":
        peer = stone_soup_ms(state, z, 3)
        benchmark.extra_info["peers"] = {"stonesoup 1.9 PHDUpdater with GaussianMixtureReducer": peer}


def test_gm_phd_200_20(benchmark: Any, quick: bool) -> None:
    run(benchmark, "ekf", quick)


def test_gm_phd_200_20_ukf(benchmark: Any, quick: bool) -> None:
    run(benchmark, "ukf", quick)
