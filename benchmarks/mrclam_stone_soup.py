"""Stone Soup's GM-PHD on MRCLAM, with what it needs around it to have a chance.

Its p_D is one number, the same everywhere, and its clutter one density. So it gets of each set only the
components that are in view (our p_D there above 0.002), and their mean p_D as its number; the others are left
as they are. Measurements within 0.3 m of another robot's pose are taken out, since a uniform clutter density
cannot say that they are expected. It has no birth from measurements: each that no component comes near brings
a new component. Pruning, merging and the cap are its own reducer's.
"""

from datetime import datetime
from typing import Any

import numpy as np
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser
from stonesoup.measures import Mahalanobis
from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer
from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, RandomWalk
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.array import StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.state import TaggedWeightedGaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater
from stonesoup.updater.pointprocess import PHDUpdater

from estimator.arrays import FloatArray
from estimator.sensor import SensorModel, gaussian

WHEN = datetime(2024, 1, 1)
IN_VIEW, ROBOT, NEW = 0.002, 0.3, 0.05
CLUTTER = 0.01 / (5.7 * 1.15)  # false measurements per m rad


class GaussianMixture:
    """The components of Stone Soup's filter."""

    def __init__(self) -> None:
        still = CombinedLinearGaussianTransitionModel([RandomWalk(0.0), RandomWalk(0.0)])
        self._predictor = KalmanPredictor(still)
        self._reducer = GaussianMixtureReducer(
            prune_threshold=1e-5, merge_threshold=4.0, max_number_components=200
        )
        self._parts: list[Any] = []
        self._tag = 0

    @property
    def mass(self) -> float:
        """Expected number of targets."""
        return float(sum(float(part.weight) for part in self._parts))

    def estimates(self, least: float) -> FloatArray:
        """(2, k) the components of this weight or more."""
        heavy = [np.ravel(part.mean).astype(float) for part in self._parts if float(part.weight) >= least]
        return np.array(heavy).T if heavy else np.zeros((2, 0))

    def update(
        self, sensor: SensorModel, pose: FloatArray, measurements: FloatArray, teammates: FloatArray
    ) -> None:
        """One set (m, 2) of range and bearing from a pose (4,), other robots at (2, k)."""
        places = sensor.locate(measurements, pose)
        apart = np.linalg.norm(places[:, :, None] - teammates[:, None], axis=0).min(axis=1)
        z, places = measurements[apart > ROBOT], places[:, apart > ROBOT]
        inside, outside, p_d = self._in_view(sensor, pose)
        if len(z) == 0:
            for part in inside:
                part.weight *= 1.0 - p_d
            return
        noise = gaussian(sensor).noise[::-1, ::-1]
        model = CartesianToBearingRange(
            ndim_state=2, mapping=(0, 1), noise_covar=noise, translation_offset=StateVector(pose[:2])
        )
        inside = inside + self._born(sensor, pose, z, places, inside)
        updater = ExtendedKalmanUpdater(model)
        hypothesiser = GaussianMixtureHypothesiser(
            DistanceHypothesiser(self._predictor, updater, measure=Mahalanobis(), missed_distance=5.0),
            order_by_detection=True,
        )
        seen = [
            Detection(StateVector([b + pose[3], r]), timestamp=WHEN, measurement_model=model) for r, b in z
        ]
        phd = PHDUpdater(updater, clutter_spatial_density=CLUTTER, prob_detection=p_d)
        updated = phd.update(hypothesiser.hypothesise(inside, seen, WHEN))
        self._parts = outside + list(self._reducer.reduce(list(updated.components)))

    def _in_view(self, sensor: SensorModel, pose: FloatArray) -> tuple[list[Any], list[Any], float]:
        if not self._parts:
            return [], [], 0.01
        means = np.array([np.ravel(part.mean).astype(float) for part in self._parts]).T
        p_d = sensor.detection(np.ascontiguousarray(means), pose[None])[0]
        inside = [part for part, p in zip(self._parts, p_d, strict=True) if p > IN_VIEW]
        outside = [part for part, p in zip(self._parts, p_d, strict=True) if p <= IN_VIEW]
        return inside, outside, float(p_d[p_d > IN_VIEW].mean()) if inside else 0.01

    def _born(
        self,
        sensor: SensorModel,
        pose: FloatArray,
        z: FloatArray,
        places: FloatArray,
        inside: list[Any],
    ) -> list[Any]:
        spreads = sensor.location_covariance(z, pose)
        means = np.array([np.ravel(part.mean).astype(float) for part in inside]).reshape(-1, 2)
        born = []
        for place, spread in zip(places.T, spreads, strict=True):
            away = means - place
            if len(means) and np.einsum("ka,ab,kb->k", away, np.linalg.inv(spread), away).min() < 25.0:
                continue
            self._tag += 1
            born.append(
                TaggedWeightedGaussianState(
                    StateVector(place), 4.0 * spread, weight=NEW, tag=str(self._tag), timestamp=WHEN
                )
            )
        return born
