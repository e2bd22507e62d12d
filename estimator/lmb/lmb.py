"""The labelled multi-Bernoulli filter (LMB): tracks for what was detected, an intensity for what never was.

Reuter, Vo, Vo & Dietmayer, "The labeled multi-Bernoulli filter", IEEE Transactions on Signal Processing,
2014. The intensity of the targets is v = v_tracker + v_n, Olofsson et al. 2020, (6)-(9): v_tracker is the sum
of r p(x) over the tracks, v_n (`estimator.undetected`) starts uniform, grows by births and falls by 1 - p_D
where a sensor looked. A measurement's new track has the part of v_n that would explain it as its existence
probability, beside clutter and all tracks: Williams, "Marginal multi-Bernoulli filters: RFS derivation of
MHT, JIPDA, and association-based MeMBer", IEEE Transactions on Aerospace and Electronic Systems, 2015.
So nothing is born that v_n does not hold, and sensors with any p_D(x), clutter and known objects fit in.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from estimator.arrays import Count, FloatArray, Fraction, IntArray, NonNegative, Positive
from estimator.filter import Area, Clusters
from estimator.gaussian.components import Components
from estimator.gaussian.detection import mean_detection
from estimator.gaussian.extraction import sampled
from estimator.gaussian.prediction import predicted
from estimator.gaussian.update import kalman_pairs
from estimator.lmb.association import Marginals, Pairs, associated
from estimator.lmb.births import Births, newborn
from estimator.lmb.correction import Reduction, Sightings, corrected, reduced, sightings, unseen_weights
from estimator.lmb.merging import apart, merged
from estimator.lmb.tracks import Tracks
from estimator.lmb.trajectories import Instant
from estimator.motion import Motion, MotionConfig
from estimator.sensor import GaussianSensor, SensorModel, checked_poses, gaussian, validated
from estimator.undetected import Undetected

_THERE = 0.5  # existence probability from which a track is believed, and remembered in trajectories


class LmbConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The filter's table in a mission."""

    expected_targets: NonNegative = 1.0  # mass of the uniform prior intensity
    birth: NonNegative = 0.0  # expected new targets per second in the whole area
    survival: Fraction = 1.0  # p_S per second
    motion: MotionConfig = MotionConfig()
    grid_points: list[Count] | None = None  # of the undetected intensity; default 33 x 33 or 17 x 17 x 17
    association: Literal["lbp", "gibbs"] = "lbp"  # of groups too large to be solved exactly
    exact_groups: Annotated[int, Meta(ge=0, le=10)] = 5  # smaller side of a group that is solved exactly
    sweeps: Annotated[int, Meta(ge=1, le=100_000)] = 100  # of the Gibbs sampler
    update: Literal["ekf", "ukf"] = "ekf"
    gate_sigmas: Positive = 5.0  # measurements further from a component than this are not of it
    least_existence: Annotated[float, Meta(gt=0, lt=1)] = 1e-3  # tracks less likely than this are dropped
    most_existence: Annotated[float, Meta(gt=0, lt=1)] = 0.999999  # a certain track could never leave
    tracks: Annotated[int, Meta(ge=1, le=100_000)] = 1000  # at most
    track_merging: NonNegative = 1.0  # rivals for one target nearer than this become one, standard deviations
    spacing_m: NonNegative = 0.0  # targets are never nearer to each other than this
    components: Annotated[int, Meta(ge=1, le=1000)] = 10  # of a track, at most
    component_least: Annotated[float, Meta(gt=0, lt=1)] = 1e-3  # of the track's heaviest; lighter ones go
    component_merging: NonNegative = 1.0  # components nearer than this are one, standard deviations
    cluster_least_existence: Fraction = 0.1  # tracks less likely than this are not reported
    remembered: Annotated[int, Meta(ge=0, le=1_000_000)] = 100  # instants kept of the trajectories


@dataclass(frozen=True, slots=True, eq=False)
class LmbState:
    """The multi-target density after some time and some measurement sets."""

    tracks: Tracks
    undetected: Undetected  # v_n
    next_label: int
    time: float  # s since the start
    shown: IntArray  # (c,) labels of the last `clusters` call
    history: tuple[Instant, ...]  # of the last `clusters` calls, for `trajectories`
    converged: bool  # whether the last update's associations did, see association.Marginals


class Lmb:
    """estimator.filter.Filter with labelled tracks. Stateless but for its Config."""

    Config = LmbConfig

    def __init__(self, config: LmbConfig) -> None:
        self.config = config
        self._reduction = Reduction(config.component_least, config.component_merging, config.components)

    def __repr__(self) -> str:
        return f"Lmb({self.config})"

    def init(self, area: Area, rng: np.random.Generator) -> LmbState:
        """No track, and the uniform prior of `expected_targets`; draws nothing.

        Raises:
            ValueError: if grid_points does not fit the area.
        """
        d = area.dimension
        points = self.config.grid_points or ([33] * 2 if d == 2 else [17] * 3)
        if len(points) != d:
            raise ValueError(f"grid_points: expected {d} numbers, one per axis, got {points}")
        return LmbState(
            tracks=Tracks.none(self._motion(d).state_size),
            undetected=Undetected.uniform(area, tuple(points), self.config.expected_targets),
            next_label=0,
            time=0.0,
            shown=np.zeros(0, np.int64),
            history=(),
            converged=True,
        )

    def predict(self, state: LmbState, duration: float, rng: np.random.Generator) -> LmbState:
        """`duration` seconds later: motion, survival, birth; draws nothing.

        Raises:
            ValueError: if duration is negative or not finite.
        """
        if not 0.0 <= duration < np.inf:
            raise ValueError(f"duration: expected a finite number from 0 up, got {duration}")
        if duration == 0.0:
            return state
        config, tracks, undetected = self.config, state.tracks, state.undetected
        motion = self._motion(undetected.area.dimension)
        survival = config.survival**duration
        if tracks.count and not motion.is_static:
            tracks = replace(tracks, components=predicted(tracks.components, motion, duration))
        if survival < 1.0:
            tracks = replace(tracks, existence=tracks.existence * survival)
        if survival < 1.0 or config.birth > 0.0 or not motion.is_static:
            undetected = undetected.later(survival, config.birth * duration, motion, duration)
        return replace(state, tracks=tracks, undetected=undetected, time=state.time + duration)

    def update(
        self,
        state: LmbState,
        sensor: SensorModel,
        pose: FloatArray,
        measurements: FloatArray,
        rng: np.random.Generator,
    ) -> LmbState:
        """The posterior after one sensor's measurement set (m, s), which may be empty, from pose (4,).

        A sensor after another is the iterated corrector. Only Gibbs sampling draws random numbers.

        Raises:
            ValueError: if an argument has a wrong shape or is not finite, or the sensor's noise is not
                Gaussian; names it.
        """
        pose = checked_poses(pose)[0]
        measurements = validated(measurements, sensor.measurement_size)
        kalman = gaussian(sensor)
        motion = self._motion(sensor.dimension)
        born = newborn(state.undetected, kalman, pose, measurements, motion, self.config.update)
        tracks, marginals = self._corrected(state.tracks, kalman, pose, measurements, born, rng)
        kept = self._strongest(tracks.existence)
        tracks = tracks if kept.size == tracks.count else tracks.chosen(kept)
        tracks, next_label = self._with_newborn(tracks, born, marginals, state.next_label)
        if self.config.track_merging > 0.0 and tracks.count > 1:
            tracks = merged(tracks, self.config.track_merging, self._reduction)
        if self.config.spacing_m > 0.0 and tracks.count > 1:
            tracks = apart(tracks, sensor.dimension, self.config.spacing_m, self._reduction)
        return replace(
            state,
            tracks=tracks,
            undetected=state.undetected.after(sensor, pose),
            next_label=next_label,
            converged=marginals.converged,
        )

    def clusters(self, state: LmbState, rng: np.random.Generator) -> tuple[LmbState, Clusters]:
        """The tracks that may well be there, likeliest first, with their labels; the state remembers them."""
        d, tracks = state.undetected.area.dimension, state.tracks
        shown = np.flatnonzero(tracks.existence >= self.config.cluster_least_existence)
        shown = shown[np.argsort(-tracks.existence[shown], kind="stable")]
        chosen = tracks.chosen(shown)
        means, covariances = chosen.moments(chosen.components.means.shape[1])
        covariances = np.ascontiguousarray(covariances[:, :d, :d])
        radii = np.sqrt(np.trace(covariances, axis1=1, axis2=2) / d)
        places = np.ascontiguousarray(means[:, :d].T)
        moving = means.shape[1] >= 2 * d
        velocities = np.ascontiguousarray(means[:, d : 2 * d].T) if moving else None
        found = Clusters(places, covariances, chosen.existence, radii, chosen.labels, velocities)
        history = state.history
        if self.config.remembered:
            there = chosen.existence >= _THERE
            now = Instant(state.time, chosen.labels[there], np.ascontiguousarray(places[:, there]))
            history = (*history[max(0, len(history) + 1 - self.config.remembered) :], now)
        return replace(state, shown=chosen.labels, history=history), found

    def remove(self, state: LmbState, clusters: IntArray) -> LmbState:
        """Without the tracks of the given clusters; the others keep their numbers."""
        gone = np.isin(state.tracks.labels, state.shown[clusters])
        return replace(state, tracks=state.tracks.chosen(np.flatnonzero(~gone)))

    def mass(self, state: LmbState) -> float:
        """The expected number of targets, undetected ones among them."""
        return float(state.tracks.existence.sum()) + state.undetected.mass()

    def intensity(self, state: LmbState) -> Components:
        """v_tracker: the tracks' components with weights in expected targets, r times that in the track."""
        tracks = state.tracks
        return tracks.components.scaled(tracks.existence[tracks.owners()])

    def thinned(self, state: LmbState, size: int) -> tuple[FloatArray, FloatArray]:
        """At most `size` points (d, k) with weights (k,) that stand for the intensity v, mass kept."""
        return sampled(self.intensity(state), state.undetected, size, state.undetected.area.dimension)

    def _motion(self, dimension: int) -> Motion:
        return Motion(dimension, self.config.motion)

    def _corrected(
        self,
        tracks: Tracks,
        sensor: GaussianSensor,
        pose: FloatArray,
        measurements: FloatArray,
        born: Births,
        rng: np.random.Generator,
    ) -> tuple[Tracks, Marginals]:
        config, m = self.config, len(measurements)
        parts = tracks.components
        if tracks.count == 0:
            return tracks, Marginals(np.zeros(0), np.zeros(0), np.ones(m), True)
        detection, _ = mean_detection(parts.means, parts.covariances, None, sensor, pose)
        missed = 1.0 - detection
        pairs = kalman_pairs(
            parts.means,
            parts.covariances,
            sensor,
            pose,
            measurements,
            rule=config.update,
            gate=config.gate_sigmas,
        )
        # p_D where the measurement says the target is: the mean over each pair's posterior
        there, _ = mean_detection(pairs.means, pairs.covariances, pairs.owners(), sensor, pose)
        seen = sightings(tracks, pairs, there, m)
        marginals = associated(
            Pairs(seen.offsets, seen.columns, self._ratios(tracks, missed, seen, born.rivals), m),
            config.association,
            exact_up_to=config.exact_groups,
            sweeps=config.sweeps,
            rng=rng,
        )
        tracks = corrected(tracks, missed, pairs, seen, marginals, self._reduction)
        return replace(tracks, existence=np.minimum(tracks.existence, config.most_existence)), marginals

    def _ratios(self, tracks: Tracks, missed: FloatArray, seen: Sightings, rivals: FloatArray) -> FloatArray:
        """psi (t,) of association.Pairs."""
        rows = np.repeat(np.arange(tracks.count), np.diff(seen.offsets))
        alone = unseen_weights(tracks, missed)[rows] * rivals[seen.columns]
        made = tracks.existence[rows] * seen.weights
        certain = np.where(made > 0.0, np.inf, 0.0)
        return np.divide(made, alone, out=certain, where=alone > 0.0)

    def _strongest(self, existence: FloatArray) -> IntArray:
        """Indices of the tracks that are likely enough to stay, at most `tracks` of them, in their order."""
        kept = np.flatnonzero(existence >= self.config.least_existence)
        if kept.size > self.config.tracks:
            best = np.argsort(-existence[kept], kind="stable")[: self.config.tracks]
            kept = np.sort(kept[best])
        return kept

    def _with_newborn(
        self, tracks: Tracks, born: Births, marginals: Marginals, next_label: int
    ) -> tuple[Tracks, int]:
        """The tracks and those that measurements begin, each with the next label."""
        existence = np.minimum(marginals.others * born.existence, self.config.most_existence)
        room = self.config.tracks - tracks.count
        chosen = self._strongest(existence)
        if chosen.size > room:
            chosen = np.sort(chosen[np.argsort(-existence[chosen], kind="stable")[: max(room, 0)]])
        if chosen.size == 0:
            return tracks, next_label
        labels = np.arange(next_label, next_label + chosen.size)
        new = born.tracks(chosen, existence[chosen], labels)
        if new.components.count > new.count:
            new = reduced(new, self._reduction)
        return (tracks.joined(new) if tracks.count else new), next_label + int(chosen.size)
