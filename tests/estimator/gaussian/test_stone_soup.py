"""The GM-PHD filter beside Stone Soup's on identical input, where p_D is the same everywhere."""

from datetime import datetime
from typing import Any

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.gaussian.components import Components
from estimator.gaussian.gm_phd import GmPhd, GmPhdState
from estimator.gaussian.reduction import reduced
from estimator.sensors.range_bearing import RangeBearing

AREA = Area(np.zeros(2), np.full(2, 200.0))
SENSOR = RangeBearing.of(
    RangeBearing.Config(
        period_s=1.0,
        range_sigma_m=0.5,
        bearing_sigma_deg=1.0,
        gain=0.85,
        clutter=2.0,
        max_range_m=500.0,
        field_of_view="box",
        box_m=[(-1e4, 1e4)] * 2,
    ),
    AREA,
)
POSE = np.array([100.0, 90.0, 0.0, 0.0])
WHEN = datetime(2024, 1, 1)


def scene(seed: int) -> tuple[Components, FloatArray]:
    rng = np.random.default_rng(seed)
    places = rng.uniform(60.0, 140.0, (6, 2))
    root = rng.normal(0.0, 0.5, (24, 2, 2))
    means = places[np.arange(24) % 6] + rng.normal(0.0, 1.0, (24, 2))
    mixture = Components(rng.uniform(0.1, 0.6, 24), means, root @ np.swapaxes(root, 1, 2) + 0.05 * np.eye(2))
    return mixture, SENSOR.sample(np.ascontiguousarray(places.T), POSE, rng)


def theirs(mixture: Components, z: FloatArray) -> list[Any]:
    """Stone Soup's extended update of the same mixture; it gates with its missed distance."""
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser
    from stonesoup.measures import Mahalanobis
    from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, RandomWalk
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.array import StateVector
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import TaggedWeightedGaussianState
    from stonesoup.updater.kalman import ExtendedKalmanUpdater
    from stonesoup.updater.pointprocess import PHDUpdater

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
    density = SENSOR.clutter_intensity(z[:1], POSE)[0]
    phd = PHDUpdater(updater, clutter_spatial_density=density, prob_detection=0.85, prob_survival=1.0)
    given = [
        TaggedWeightedGaussianState(StateVector(x), p, weight=float(w), tag=str(i), timestamp=WHEN)
        for i, (w, x, p) in enumerate(zip(mixture.weights, mixture.means, mixture.covariances, strict=True))
    ]
    detections = [Detection(StateVector([b, r]), timestamp=WHEN, measurement_model=model) for r, b in z]
    return list(phd.update(hypothesiser.hypothesise(given, detections, WHEN)).components)


def as_rows(mixture: Components) -> FloatArray:
    """Weight, mean and covariance of each component with some weight, in an order of their own."""
    heavy = mixture.chosen(mixture.weights > 1e-9)
    rows = np.column_stack([heavy.weights, heavy.means, heavy.covariances.reshape(heavy.count, -1)])
    return np.asarray(rows[np.lexsort(np.round(rows[:, :3].T, 5))])


def converted(components: list[Any]) -> Components:
    return Components(
        np.array([float(c.weight) for c in components]),
        np.array([np.ravel(c.state_vector).astype(float) for c in components]),
        np.array([np.asarray(c.covar, dtype=float) for c in components]),
    )


@pytest.mark.parametrize("seed", range(4))
def test_every_component_is_stone_soups(seed: int) -> None:
    mixture, z = scene(seed)
    config = GmPhd.Config(expected_targets=0.0, prune=0.0, merge_sigmas=0.0, components=10_000)
    filter, rng = GmPhd(config), np.random.default_rng(0)
    state = GmPhdState(mixture, np.full(24, -1), filter.init(AREA, rng).undetected)
    ours = as_rows(filter.update(state, SENSOR, POSE, z, rng).components)
    other = as_rows(converted(theirs(mixture, z)))
    assert ours.shape == other.shape
    assert len(ours) > 30
    assert np.allclose(ours, other, atol=1e-6, rtol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_pruning_is_stone_soups_but_for_the_mass_that_it_hands_round(seed: int) -> None:
    from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer

    mixture, z = scene(seed)
    components = theirs(mixture, z)
    whole = converted(components)
    reducer = GaussianMixtureReducer(prune_threshold=1e-3, merging=False)
    other = converted(reducer.reduce(components))
    ours = reduced(whole, prune=1e-3, merge_sigmas=0.0, most=10_000)
    assert ours.count == other.count
    shared = whole.weights[whole.weights < 1e-3].sum() / other.count
    assert np.allclose(np.sort(ours.weights) + shared, np.sort(other.weights), atol=1e-12)
