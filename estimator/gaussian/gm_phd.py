"""The Gaussian-mixture PHD filter, GM-PHD; called sensor after sensor it is the iterated corrector.

Vo & Ma, "The Gaussian mixture probability hypothesis density filter", IEEE Transactions on Signal Processing,
2006, with three changes. p_D depends on the state: each term of the corrector has its mean over the Gaussian
that it multiplies, and components that an edge of the field of view cuts are split (`detection`). What was
never detected lies on a grid (`estimator.undetected`) and gives birth where measurements point, so that a
uniform prior needs no components. Gates leave out pairs that have next to no likelihood.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from estimator.arrays import Count, FloatArray, Fraction, IntArray, NonNegative, Positive
from estimator.filter import Area, Clusters
from estimator.gaussian.birth import born
from estimator.gaussian.components import Components
from estimator.gaussian.detection import mean_detection, split_at_edges
from estimator.gaussian.extraction import clusters_of, sampled
from estimator.gaussian.multisensor import jointly_updated
from estimator.gaussian.pairs import Pairs, summed
from estimator.gaussian.prediction import predicted
from estimator.gaussian.reduction import reduced
from estimator.gaussian.update import kalman_pairs
from estimator.kernels import kernel
from estimator.motion import Motion, MotionConfig
from estimator.multisensor import Take, checked_take
from estimator.sensor import SensorModel, checked_poses, gaussian, validated
from estimator.spacing import capped
from estimator.undetected import Undetected

_NOTHING = 1e-290  # a denominator up to this is 0 to working precision


class GmPhdConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The filter's table in a mission."""

    expected_targets: NonNegative = 1.0  # mass of the uniform prior intensity
    birth: NonNegative = 0.0  # expected new targets per second in the whole area
    survival: Fraction = 1.0  # p_S per second
    motion: MotionConfig = MotionConfig()
    grid_points: list[Count] | None = None  # of the undetected intensity; default 33 x 33 or 17 x 17 x 17
    update: Literal["ekf", "ukf"] = "ekf"  # how measurements are made linear
    gate_sigmas: Positive = 5.0  # Mahalanobis distance beyond which a measurement is not of a component
    prune: NonNegative = 1e-5  # components of less mass are dropped
    merge_sigmas: NonNegative = 2.0  # Mahalanobis distance up to which components merge
    merge_mutual: bool = False  # measured with both covariances, not only that of the lighter component
    components: Annotated[int, Meta(ge=1, le=100_000)] = 500  # at most
    spacing_m: NonNegative = 0.0  # targets are never nearer to each other than this
    split_detection: Annotated[float, Meta(gt=0, le=1)] = 0.2  # p_D varies more over a component: split it
    split_depth: Annotated[int, Meta(ge=0, le=4)] = 2  # how often, into four; 0 never splits
    cluster_sigmas: NonNegative = 3.0  # Mahalanobis distance up to which components are one estimated target
    cluster_least_mass: Positive = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class GmPhdState:
    """The intensity after some time and some measurement sets."""

    components: Components  # of targets detected at least once
    labels: IntArray  # (k,) cluster of the last `clusters` call, -1 for none
    undetected: Undetected


class GmPhd:
    """estimator.filter.Filter with Gaussian components. Stateless but for its Config; draws nothing."""

    Config = GmPhdConfig

    def __init__(self, config: GmPhdConfig) -> None:
        self.config = config

    def __repr__(self) -> str:
        return f"GmPhd({self.config})"

    def init(self, area: Area, rng: np.random.Generator) -> GmPhdState:
        """The uniform prior of `expected_targets`.

        Raises:
            ValueError: if grid_points does not fit the area.
        """
        d = area.dimension
        points = self.config.grid_points or ([33] * 2 if d == 2 else [17] * 3)
        if len(points) != d:
            raise ValueError(f"grid_points: expected {d} numbers, one per axis, got {points}")
        return GmPhdState(
            components=Components.none(Motion(d, self.config.motion).state_size),
            labels=np.zeros(0, np.int64),
            undetected=Undetected.uniform(area, tuple(points), self.config.expected_targets),
        )

    def predict(self, state: GmPhdState, duration: float, rng: np.random.Generator) -> GmPhdState:
        """Motion, survival and birth over `duration` seconds, Vo & Ma (2006, eq. 24). Births are undetected.

        Raises:
            ValueError: if duration is negative or not finite.
        """
        motion = Motion(state.undetected.area.dimension, self.config.motion)
        if not 0.0 <= duration < np.inf:
            raise ValueError(f"duration: expected a finite number from 0 up, got {duration}")
        config = self.config
        if duration == 0.0 or (motion.is_static and config.survival == 1.0 and config.birth == 0.0):
            return state
        survival = config.survival**duration
        return replace(
            state,
            components=predicted(state.components, motion, duration).scaled(survival),
            undetected=state.undetected.later(survival, config.birth * duration, motion, duration),
        )

    def update(
        self,
        state: GmPhdState,
        sensor: SensorModel,
        pose: FloatArray,
        measurements: FloatArray,
        rng: np.random.Generator,
    ) -> GmPhdState:
        """The posterior after one sensor's set (m, s), which may be empty, at pose (4,); then reduced.

        Raises:
            ValueError: if an argument has a wrong shape or is not finite, or the sensor's noise is not
                Gaussian; names it.
        """
        pose = checked_poses(pose)[0]
        measurements = validated(measurements, sensor.measurement_size)
        config = self.config
        prior, detection = split_at_edges(
            state.components, sensor, pose, tolerance=config.split_detection, depth=config.split_depth
        )
        missed = prior.scaled(1.0 - detection)
        undetected = state.undetected.after(sensor, pose)
        if len(measurements) == 0:
            return self._reduced(state, missed, undetected)
        pairs = kalman_pairs(
            prior.means,
            prior.covariances,
            gaussian(sensor),
            pose,
            measurements,
            rule=config.update,
            gate=config.gate_sigmas,
        )
        shares = self._shares(prior, pairs, sensor, pose)
        known = summed(shares, pairs.measurements, len(measurements))
        clutter = sensor.clutter_intensity(measurements, pose)
        fresh = born(
            state.undetected,
            gaussian(sensor),
            pose,
            measurements,
            known,
            clutter,
            Motion(sensor.dimension, config.motion),
            config.update,
        )
        denominators = clutter + known + fresh.totals
        inverse = np.divide(1.0, denominators, out=np.zeros_like(denominators), where=denominators > _NOTHING)
        weights = shares * inverse[pairs.measurements]
        kept = weights >= config.prune
        owners = pairs.owners()[kept]
        detected = Components(weights[kept], pairs.means[kept], pairs.covariances[owners])
        new = fresh.components.scaled(inverse[fresh.measurements])
        return self._reduced(state, missed.joined(detected).joined(new), undetected)

    def update_together(self, state: GmPhdState, takes: Sequence[Take]) -> GmPhdState:
        """The posterior after the sets of several sensors of one time, in whatever order they are given.

        `update` sensor after sensor is the iterated corrector, which depends on the order.

        Raises:
            ValueError: as `update`.
        """
        config = self.config
        takes = [checked_take(take) for take in takes]
        if not takes:
            return state
        missed, detected, undetected = jointly_updated(
            state.components,
            state.undetected,
            takes,
            Motion(state.undetected.area.dimension, config.motion),
            gate=config.gate_sigmas,
            tolerance=config.split_detection,
            depth=config.split_depth,
        )
        return self._reduced(state, missed.joined(detected), undetected)

    def clusters(self, state: GmPhdState, rng: np.random.Generator) -> tuple[GmPhdState, Clusters]:
        """Groups of components within `cluster_sigmas` of their heaviest; the state remembers them."""
        found, labels = clusters_of(
            state.components,
            state.undetected.area.dimension,
            sigmas=self.config.cluster_sigmas,
            least=self.config.cluster_least_mass,
        )
        return replace(state, labels=labels), found

    def remove(self, state: GmPhdState, clusters: IntArray) -> GmPhdState:
        """Without the components of the given clusters; the others keep their numbers."""
        kept = ~(np.isin(state.labels, clusters) & (state.labels >= 0))
        return replace(state, components=state.components.chosen(kept), labels=state.labels[kept])

    def mass(self, state: GmPhdState) -> float:
        """The expected number of targets in the intensity, undetected ones among them."""
        return float(state.components.weights.sum()) + state.undetected.mass()

    def thinned(self, state: GmPhdState, size: int) -> tuple[FloatArray, FloatArray]:
        """At most `size` points (d, k) with weights (k,) that stand for the intensity, mass kept."""
        return sampled(state.components, state.undetected, size, state.undetected.area.dimension)

    def _shares(self, prior: Components, pairs: Pairs, sensor: SensorModel, pose: FloatArray) -> FloatArray:
        """w E[p_D] N(z; h, S) of each pair (p,), the mean of p_D taken over the pair's posterior.

        p_D(x) N(z; h(x), R) N(x; m, P) = N(z; h, S) p_D(x) N(x; posterior): so each term is exact where p_D
        is even over the posterior, however wide the component was before.
        """
        owners = pairs.owners()
        detection, _ = mean_detection(pairs.means, pairs.covariances, owners, sensor, pose)
        shares = np.empty(owners.size)
        _share(prior.weights, pairs.log_likelihood, owners, detection, shares)
        return shares

    def _reduced(self, state: GmPhdState, components: Components, undetected: Undetected) -> GmPhdState:
        config = self.config
        fewer = reduced(
            components,
            prune=config.prune,
            merge_sigmas=config.merge_sigmas,
            most=config.components,
            mutual=config.merge_mutual,
        )
        if config.spacing_m > 0.0:
            places = fewer.positions(undetected.area.dimension)
            fewer = replace(fewer, weights=capped(places, fewer.weights, config.spacing_m))
        return GmPhdState(fewer, np.full(fewer.count, -1), undetected)


@kernel
def _share(
    weights: FloatArray,
    log_likelihood: FloatArray,
    owners: IntArray,
    detection: FloatArray,
    shares: FloatArray,
) -> None:
    for p in range(shares.size):
        shares[p] = weights[owners[p]] * detection[p] * np.exp(log_likelihood[p])
