"""The particle PHD filter for static targets: SMC-PHD, and IC-PHD by calling `update` sensor after sensor.

(MA)ASI (11)-(16): Yousuf, Herzal, Lendek, Buşoniu, Control Engineering Practice, 2024, after Vo, Singh &
Doucet (2005) and Liu, Ji, Zhang & Liao (2020). The intensity is a sum of two parts. What was never detected
is smooth and lies on a grid (`estimator.undetected`); what was detected at least once is narrow and lies in
particles. Only the representation differs from particles everywhere: with 10,000 of those in a 260 m cube the
next one is 12 m away, further than most measurements reach, and a measurement without a particle near says
nothing.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from estimator.arrays import BoolArray, Count, FloatArray, Fraction, IntArray, NonNegative, Positive
from estimator.filter import Area, Clusters
from estimator.sensor import SensorModel, checked_poses, validated
from estimator.smc.correction import corrected, explained
from estimator.smc.kmeans import kmeans
from estimator.smc.resampling import effective_size, effective_sizes, gathered, jittered, systematic
from estimator.undetected import Explanations, Undetected, detected, explanations

# A measurement is left to the particles if they explain it so much better than the undetected part does,
_PLAIN = 1e-2
_TRACE = 1e-4  # or if the new target would have less mass than this.
_REACH = 3.0  # standard deviations of a measurement's location that a cluster reaches by default


class SmcPhdConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The filter's table in a mission."""

    particles: Annotated[int, Meta(ge=100, le=10_000_000)] = 10_000  # at most
    expected_targets: NonNegative = 1.0  # mass of the uniform prior intensity
    birth: NonNegative = 0.0  # expected new targets per second in the whole area
    survival: Fraction = 1.0  # p_S per second
    spawning: NonNegative = 0.0  # targets that a detected one brings forth at its place, per second
    spawning_from: NonNegative = 0.5  # mass from which a cluster spawns: it is there rather than not
    spawning_to: Positive = 3.0  # mass up to which a cluster spawns
    grid_points: list[Count] | None = None  # of the undetected intensity; default 33 x 33 or 17 x 17 x 17
    jitter: NonNegative = 0.5  # bandwidth of the regularisation, 1 is the normal rule, 0 is none
    roughening: NonNegative = 0.0  # noise on copies after resampling, in standard deviations of a location
    cluster_cutoff_m: Positive | None = None  # default: 3 standard deviations of a measurement's location
    cluster_least_mass: Positive = 0.1
    cluster_separation: Positive = 3.0  # standard deviations at which two clusters are two
    cluster_floor: NonNegative = 0.0  # width of a single particle, in standard deviations of a location
    stray_sigmas: NonNegative = 0.0  # stray particles this near to a removed cluster go with it


@dataclass(frozen=True, slots=True, eq=False)
class SmcPhdState:
    """The intensity after some time and some measurement sets."""

    positions: FloatArray  # (d, n) of the particles
    weights: FloatArray  # (n,) expected targets each
    labels: IntArray  # (n,) cluster of the last `clusters` call, -1 for none
    undetected: Undetected
    centres: FloatArray  # (d, c) of the last `clusters` call
    reach: float  # metres, how far a measurement's target may be from where it points; 0 before the first


class SmcPhd:
    """estimator.filter.Filter with particles. Stateless but for its Config."""

    Config = SmcPhdConfig

    def __init__(self, config: SmcPhdConfig) -> None:
        self.config = config

    def __repr__(self) -> str:
        return f"SmcPhd({self.config})"

    def init(self, area: Area, rng: np.random.Generator) -> SmcPhdState:
        """The uniform prior of `expected_targets`; draws nothing.

        Raises:
            ValueError: if grid_points does not fit the area.
        """
        d = area.dimension
        points = self.config.grid_points or ([33] * 2 if d == 2 else [17] * 3)
        if len(points) != d:
            raise ValueError(f"grid_points: expected {d} numbers, one per axis, got {points}")
        return SmcPhdState(
            positions=np.zeros((d, 0)),
            weights=np.zeros(0),
            labels=np.zeros(0, np.int64),
            undetected=Undetected.uniform(area, tuple(points), self.config.expected_targets),
            centres=np.zeros((d, 0)),
            reach=0.0,
        )

    def predict(self, state: SmcPhdState, duration: float, rng: np.random.Generator) -> SmcPhdState:
        """(12) over `duration` seconds: survival, birth, spawning; static targets do not move.

        Birth adds to the undetected intensity, evenly. Spawning adds to the clusters: what the constant Υ of
        (12) does when it is added to the weight of every particle, wherever the particles are.

        Raises:
            ValueError: if duration is negative or not finite.
        """
        if not 0.0 <= duration < np.inf:
            raise ValueError(f"duration: expected a finite number from 0 up, got {duration}")
        config = self.config
        if duration == 0.0 or (config.survival == 1.0 and config.birth == 0.0 and config.spawning == 0.0):
            return state
        survival = config.survival**duration
        return replace(
            state,
            weights=state.weights
            * (survival * self._growth(state, duration) if config.spawning else survival),
            undetected=state.undetected.later(survival, config.birth * duration),
        )

    def update(
        self,
        state: SmcPhdState,
        sensor: SensorModel,
        pose: FloatArray,
        measurements: FloatArray,
        rng: np.random.Generator,
    ) -> SmcPhdState:
        """(13), (16) with the measurement set (m, s), which may be empty, of one sensor at pose (4,).

        Resamples first if that is of use: if the effective number of particles fell below half of them, or
        there are too many. Clusters so see weights that no resampling has coarsened.

        Raises:
            ValueError: if an argument has a wrong shape or is not finite; names it.
        """
        pose = checked_poses(pose)[0]
        measurements = validated(measurements, sensor.measurement_size)
        state = self._resampled_if_due(state, rng)
        look = sensor.look(state.positions, pose, measurements)
        prior = state.undetected
        known = explained(state.weights, look)
        new = explanations(prior, sensor, pose, measurements)
        denominators = look.clutter + known
        fresh = np.where(
            (new.totals > _PLAIN * known) & (new.totals > _TRACE * denominators), new.totals, 0.0
        )
        denominators += fresh
        state = replace(
            state,
            weights=corrected(state.weights, look, denominators),
            undetected=prior.after(sensor, pose),
            reach=_mixed(state.reach, _REACH * new.spread) if len(measurements) else state.reach,
        )
        if fresh.any():
            masses = np.divide(fresh, denominators, out=np.zeros_like(fresh), where=fresh > 0.0)
            state = self._joined(state, prior, sensor, pose, measurements, new, masses, rng)
        return state

    def clusters(self, state: SmcPhdState, rng: np.random.Generator) -> tuple[SmcPhdState, Clusters]:
        """K-means of the particles; the state remembers labels and centres. Draws nothing.

        A few particles are narrower than what they stand for: with a `cluster_floor` f, covariances grow by
        (f sigma)^2 / n, sigma the standard deviation of where measurements point and n the effective number
        of the cluster's particles.
        """
        cutoff = self.config.cluster_cutoff_m or state.reach
        if cutoff <= 0.0:
            return state, Clusters.none(state.positions.shape[0])
        found, labels = kmeans(
            state.positions,
            state.weights,
            cutoff,
            least=self.config.cluster_least_mass,
            separation=self.config.cluster_separation,
            start=state.centres,
        )
        if self.config.cluster_floor > 0.0:
            effective = effective_sizes(state.weights, labels, found.masses.size)
            found = _widened(found, (self.config.cluster_floor * state.reach / _REACH) ** 2 / effective)
        return replace(state, labels=labels, centres=found.means), found

    def remove(self, state: SmcPhdState, clusters: IntArray) -> SmcPhdState:
        """Without the particles of the given clusters; the others keep their numbers.

        With `stray_sigmas`, particles in no cluster go too where they are that near to a removed one: they
        are its tail, and one of them alone would otherwise explain the target's next odd measurement.
        """
        gone = np.isin(state.labels, clusters) & (state.labels >= 0)
        if self.config.stray_sigmas > 0.0:
            stray = np.flatnonzero(state.labels < 0)
            for c in clusters:
                near = _within(state, state.labels == c, stray, self.config.stray_sigmas)
                gone[near] = True
        kept = ~gone
        return replace(
            state,
            positions=np.ascontiguousarray(state.positions[:, kept]),
            weights=state.weights[kept],
            labels=state.labels[kept],
        )

    def mass(self, state: SmcPhdState) -> float:
        """The expected number of targets in the intensity, undetected ones among them."""
        return float(state.weights.sum()) + state.undetected.mass()

    def points(self, state: SmcPhdState) -> tuple[FloatArray, FloatArray]:
        """The whole intensity as points (d, n) with weights (n,): particles, then the grid's nodes."""
        points = np.concatenate([state.positions, state.undetected.nodes()], axis=1)
        masses: FloatArray = np.concatenate([state.weights, state.undetected.node_masses()])
        return points, masses

    def thinned(self, state: SmcPhdState, size: int) -> tuple[FloatArray, FloatArray]:
        """At most `size` points (d, k) with weights (k,) that stand for the intensity, mass kept."""
        points, weights = self.points(state)
        total = float(weights.sum())
        if total <= 0.0 or size < 1:
            return np.zeros((points.shape[0], 0)), np.zeros(0)
        chosen, counts = np.unique(systematic(weights, size, 0.5), return_counts=True)
        return np.ascontiguousarray(points[:, chosen]), np.asarray(counts * (total / size), dtype=np.float64)

    def _growth(self, state: SmcPhdState, duration: float) -> FloatArray:
        """(n,) by what spawning multiplies each weight: exp(spawning duration), kept below `spawning_to`.

        Stray particles, in no cluster, and clusters that are rather nothing bring forth nothing: they would
        grow into targets of their own.
        """
        inside = state.labels >= 0
        masses = np.bincount(state.labels[inside], state.weights[inside], state.centres.shape[1])
        room = np.maximum(self.config.spawning_to / np.maximum(masses, 1e-300), 1.0)
        growth = np.minimum(np.exp(self.config.spawning * duration), room)
        growth[masses < self.config.spawning_from] = 1.0
        return np.asarray(np.append(growth, 1.0)[state.labels])  # label -1 takes the last

    def _resampled_if_due(self, state: SmcPhdState, rng: np.random.Generator) -> SmcPhdState:
        n = state.weights.size
        if n <= self.config.particles and effective_size(state.weights) >= 0.5 * n:
            return state
        return self.resampled(state, rng)

    def resampled(self, state: SmcPhdState, rng: np.random.Generator) -> SmcPhdState:
        """The same intensity in equal weights and other places: systematic, then jitter within clusters, then
        roughening of copies (Gordon, Salmond & Smith 1993), which also reaches what is in no cluster.

        A quarter of `particles` per expected target, at most `particles`.
        """
        mass = float(state.weights.sum())
        if mass <= 0.0:
            none = np.zeros(0, dtype=np.int64)
            return replace(state, positions=state.positions[:, :0].copy(), weights=np.zeros(0), labels=none)
        count = int(np.clip(np.ceil(0.25 * self.config.particles * mass), 100, self.config.particles))
        chosen = systematic(state.weights, count, rng.random())
        positions, labels = gathered(state.positions, chosen), state.labels[chosen]
        if self.config.jitter > 0.0 and state.centres.shape[1]:
            clusters = int(state.labels.max(initial=-1)) + 1
            effective = effective_sizes(state.weights, state.labels, clusters)
            noise = rng.standard_normal(positions.shape)
            area = state.undetected.area
            jittered(positions, labels, effective, self.config.jitter, noise, area.low, area.high)
        if self.config.roughening > 0.0:
            step = self.config.roughening * state.reach / _REACH
            copies = np.append(False, chosen[1:] == chosen[:-1])
            positions += step * copies * rng.standard_normal(positions.shape)
        return replace(state, positions=positions, weights=np.full(count, mass / count), labels=labels)

    def _joined(
        self,
        state: SmcPhdState,
        prior: Undetected,
        sensor: SensorModel,
        pose: FloatArray,
        measurements: FloatArray,
        new: Explanations,
        masses: FloatArray,
        rng: np.random.Generator,
    ) -> SmcPhdState:
        """The state with what the measurements show of the undetected intensity."""
        counts = np.ceil(masses * max(50, self.config.particles // 20)).astype(np.int64)
        points, weights = detected(prior, sensor, pose, measurements, new, masses, counts, rng)
        return replace(
            state,
            positions=np.concatenate([state.positions, points], axis=1),
            weights=np.concatenate([state.weights, weights]),
            labels=np.concatenate([state.labels, np.full(weights.size, -1)]),
        )


def _widened(clusters: Clusters, variances: FloatArray) -> Clusters:
    """Clusters (c) with isotropic variances (c,) added."""
    d = clusters.means.shape[0]
    covariances = clusters.covariances + variances[:, None, None] * np.eye(d)
    radii = np.sqrt(np.trace(covariances, axis1=1, axis2=2) / d)
    return Clusters(clusters.means, covariances, clusters.masses, radii)


def _within(state: SmcPhdState, members: BoolArray, candidates: IntArray, sigmas: float) -> IntArray:
    """Those candidates (k,) less than `sigmas` Mahalanobis distances from the cluster of the members (n,)."""
    positions, weights = state.positions[:, members], state.weights[members]
    if candidates.size == 0 or weights.sum() <= 0.0:
        return candidates[:0]
    mean = np.average(positions, axis=1, weights=weights)[:, None]
    spread = np.atleast_2d(np.cov(positions, aweights=weights, ddof=0))
    steps = state.positions[:, candidates] - mean
    squares = np.sum(steps * (np.linalg.pinv(spread, hermitian=True) @ steps), axis=0)
    return np.asarray(candidates[squares < sigmas**2])


def _mixed(old: float, new: float) -> float:
    """A running mean with a memory of ten sets; 0 is no memory yet."""
    return 0.9 * old + 0.1 * new if old > 0.0 else new
