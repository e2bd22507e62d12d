"""The particle PHD filter: SMC-PHD, and IC-PHD by calling `update` sensor after sensor.

(MA)ASI (11)-(16): Yousuf, Herzal, Lendek, Buşoniu, Control Engineering Practice, 2024, after Vo, Singh &
Doucet (2005) and Liu, Ji, Zhang & Liao (2020). By default the intensity is a sum of two parts. What was never
detected is smooth and lies on a grid (`estimator.undetected`); what was detected at least once is narrow and
lies in particles. Only the representation differs from particles everywhere: with 10,000 of those in a 260 m
cube the next one is 12 m away, further than most measurements reach, and a measurement without a particle
near says nothing.

With `initial = "grid"` particles are everywhere, as Dames & Kumar (2015, section IV-B) begin: for sensors
whose measurements do not say a place, such as bearings, ranges or detections alone.
"""

from dataclasses import replace

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.filter import Area, Clusters
from estimator.motion import Motion
from estimator.sensor import SensorModel, checked_poses, validated
from estimator.smc import regularisation
from estimator.smc.clustering import clustered, grown, recentred, without
from estimator.smc.config import SmcPhdConfig
from estimator.smc.correction import blocks_of, corrected, explained
from estimator.smc.newcomers import Located, initial_places, newcomers, scattered, shown
from estimator.smc.regularisation import REACH
from estimator.smc.resampling import systematic
from estimator.smc.state import SmcPhdState, moved, with_velocities
from estimator.smc.super_particles import at_most
from estimator.soft.intensity import agreeing, factors
from estimator.soft.statement import SoftObservation
from estimator.spacing import capped
from estimator.undetected import Undetected

_NEW = 200_000  # particles that one set may add, or as many as there may be


class SmcPhd:
    """estimator.filter.Filter with particles. Stateless but for its Config."""

    Config = SmcPhdConfig

    def __init__(self, config: SmcPhdConfig) -> None:
        self.config = config

    def __repr__(self) -> str:
        return f"SmcPhd({self.config})"

    def init(self, area: Area, rng: np.random.Generator, places: FloatArray | None = None) -> SmcPhdState:
        """The uniform prior of `expected_targets`, in particles if `initial` is "grid"; else draws nothing.

        `places` (d, f) are then where targets can be; by default a grid over the area, with a map over its
        free space.

        Raises:
            ValueError: if grid_points does not fit the area, or places are none, not finite, outside the area
                or more than `particles`.
        """
        d, everywhere = area.dimension, self.config.initial == "grid"
        if places is not None and not everywhere:
            raise ValueError('places: only with initial = "grid" are particles everywhere')
        points = self.config.grid_points or ([33] * 2 if d == 2 else [17] * 3)
        if len(points) != d:
            raise ValueError(f"grid_points: expected {d} numbers, one per axis, got {points}")
        if everywhere:
            undetected = Undetected(np.zeros((1,) * d), area)
        else:
            undetected = Undetected.uniform(area, tuple(points), self.config.expected_targets)
        state = SmcPhdState(
            states=np.zeros((Motion(d, self.config.motion).state_size, 0)),
            weights=np.zeros(0),
            labels=np.zeros(0, np.int64),
            undetected=undetected,
            centres=np.zeros((d, 0)),
            reach=0.0,
        )
        return self._everywhere(state, places, rng) if everywhere else state

    def predict(self, state: SmcPhdState, duration: float, rng: np.random.Generator) -> SmcPhdState:
        """(12) over `duration` seconds: motion, survival, birth, spawning; draws nothing for static targets.

        Birth adds to the undetected intensity, evenly; with particles everywhere it adds particles; with
        `birth_at` "measurements" it waits for the next set. Spawning adds to the clusters: what the constant
        Υ of (12) does when it is added to the weight of every particle, wherever the particles are.

        Raises:
            ValueError: if duration is negative or not finite.
        """
        if not 0.0 <= duration < np.inf:
            raise ValueError(f"duration: expected a finite number from 0 up, got {duration}")
        config, motion = self.config, self._motion(state)
        constant = config.survival == 1.0 and config.birth == 0.0 and config.spawning == 0.0
        if duration == 0.0 or (constant and motion.is_static):
            return state
        survival, births = config.survival**duration, config.birth * duration
        weights = state.weights
        if not constant:
            weights = weights * (survival * grown(state, config, duration) if config.spawning else survival)
        if config.birth_at == "measurements":
            state, births = replace(state, unborn=state.unborn * survival + births), 0.0
        if state.places is not None and births > 0.0:
            state, weights = self._born_anywhere(state, weights, births, rng)
            births = 0.0
        undetected = state.undetected
        if state.places is None:
            undetected = undetected.later(survival, births, motion, duration)
        state = replace(
            state,
            states=moved(state.states, motion, duration, undetected.area, rng),
            weights=weights,
            undetected=undetected,
        )
        return state if motion.is_static else recentred(state)

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
        if regularisation.is_due(state, self.config):
            state = self.resampled(state, rng)
        blocks = list(blocks_of(measurements, state.weights.size))
        weights, spreads, arrivals = state.weights, [], []
        for k, block in enumerate(blocks):
            look = sensor.look(state.positions, pose, block)
            known = explained(state.weights, look)
            parts = newcomers(state, sensor, pose, block, rng)
            denominators = look.clutter + known
            fresh = [shown(part.totals, known, denominators) for part in parts]
            for totals in fresh:
                denominators += totals
            posterior = corrected(state.weights, look, denominators)
            # A later block finds what was not detected counted already.
            weights = posterior if k == 0 else weights + (posterior - state.weights * (1.0 - look.detection))
            for part, totals in zip(parts, fresh, strict=True):
                if totals.any():
                    masses = np.divide(totals, denominators, out=np.zeros_like(totals), where=totals > 0.0)
                    counts = self._counts(masses, len(measurements))
                    arrivals.append(part.drawn(masses, counts, rng))
                if isinstance(part, Located) and not part.explained.certain:
                    spreads.append(part.explained.spread)
        reach = state.reach
        if len(measurements) and spreads:
            reach = _mixed(reach, REACH * (sum(spreads) / len(spreads)))
        state = replace(
            state,
            weights=weights,
            undetected=state.undetected.after(sensor, pose) if state.places is None else state.undetected,
            reach=reach,
            unborn=0.0,
        )
        state = self._joined(state, arrivals, rng) if arrivals else state
        if self.config.spacing_m > 0.0:
            state = replace(state, weights=capped(state.positions, state.weights, self.config.spacing_m))
        return state

    def observe(
        self,
        state: SmcPhdState,
        statement: SoftObservation,
        rng: np.random.Generator,
        *,
        known: FloatArray | None = None,
    ) -> SmcPhdState:
        """An operator's statement by the factors of `estimator.soft.intensity`; draws nothing.

        What of the intensity was never detected stays on its grid, so what is said of it is as sharp as that.
        What cannot have been is ignored: "something is" where no target can be.

        Raises:
            ValueError: if the statement names a target, or its dimension is another.
        """
        d = state.centres.shape[0]
        if statement.softmax.dimension != d:
            raise ValueError(f"softmax: a model in {statement.softmax.dimension} dimensions, expected {d}")
        points, weights = self.points(state)
        factor = factors(statement, agreeing(statement, points), weights, known)
        n = state.weights.size
        state = replace(state, weights=state.weights * factor[:n])
        if state.places is not None:
            return state
        old = state.undetected
        there = factor[n:].reshape(old.values.shape)
        parts = None if old.parts is None else old.parts * there
        return replace(state, undetected=replace(old, values=old.values * there, parts=parts))

    def clusters(self, state: SmcPhdState, rng: np.random.Generator) -> tuple[SmcPhdState, Clusters]:
        """K-means of the particles, see `estimator.smc.clustering`. Draws nothing."""
        return clustered(state, self.config)

    def remove(self, state: SmcPhdState, clusters: IntArray) -> SmcPhdState:
        """Without the particles of the given clusters; the others keep their numbers."""
        return without(state, self.config, clusters)

    def mass(self, state: SmcPhdState) -> float:
        """The expected number of targets in the intensity, undetected and newborn ones among them."""
        return float(state.weights.sum()) + state.undetected.mass() + state.unborn

    def points(self, state: SmcPhdState) -> tuple[FloatArray, FloatArray]:
        """The whole intensity as points (d, n) with weights (n,): particles, then the grid's nodes."""
        if state.places is not None:
            return state.positions, state.weights
        points = np.concatenate([state.positions, state.undetected.nodes()], axis=1)
        masses: FloatArray = np.concatenate([state.weights, state.undetected.node_masses()])
        return points, masses

    def thinned(self, state: SmcPhdState, size: int) -> tuple[FloatArray, FloatArray]:
        """At most `size` points (d, k) with weights (k,) that stand for the intensity, mass kept.

        By systematic resampling, or as super-particles, as `thinning` says.
        """
        points, weights = self.points(state)
        if self.config.thinning == "super_particles":
            return at_most(points, weights, size)
        total = float(weights.sum())
        if total <= 0.0 or size < 1:
            return np.zeros((points.shape[0], 0)), np.zeros(0)
        chosen, counts = np.unique(systematic(weights, size, 0.5), return_counts=True)
        return np.ascontiguousarray(points[:, chosen]), np.asarray(counts * (total / size), dtype=np.float64)

    def resampled(self, state: SmcPhdState, rng: np.random.Generator) -> SmcPhdState:
        """The same intensity in equal weights and other places, see `estimator.smc.regularisation`."""
        return regularisation.resampled(state, self.config, rng)

    def _motion(self, state: SmcPhdState) -> Motion:
        return Motion(state.centres.shape[0], self.config.motion)

    def _everywhere(
        self, state: SmcPhdState, places: FloatArray | None, rng: np.random.Generator
    ) -> SmcPhdState:
        """The prior as particles of equal weight at the places."""
        config, area = self.config, state.undetected.area
        places, spacing = initial_places(area, config.particles, config.grid_spacing_m, places)
        n = places.shape[1]
        return replace(
            state,
            states=with_velocities(places, self._motion(state), rng),
            weights=np.full(n, config.expected_targets / n),
            labels=np.full(n, -1),
            reach=REACH * spacing,
            places=places,
            spacing=spacing,
        )

    def _born_anywhere(
        self, state: SmcPhdState, weights: FloatArray, births: float, rng: np.random.Generator
    ) -> tuple[SmcPhdState, FloatArray]:
        """The state with particles of `births` expected targets; its weights are the ones returned."""
        count = int(np.ceil(births * self._each))
        assert state.places is not None
        chosen = rng.integers(0, state.places.shape[1], count)
        states = with_velocities(scattered(state, chosen, rng), self._motion(state), rng)
        return _with(state, states), np.append(weights, np.full(count, births / count))

    @property
    def _each(self) -> int:
        """Particles for a new target."""
        return max(50, self.config.particles // 20)

    def _counts(self, masses: FloatArray, measurements: int) -> IntArray:
        """Particles for what a block of the set's measurements shows, fewer if the set is very large."""
        most = max(self.config.particles, _NEW) // measurements
        return np.ceil(masses * max(1, min(self._each, most))).astype(np.int64)

    def _joined(
        self,
        state: SmcPhdState,
        arrivals: list[tuple[FloatArray, FloatArray]],
        rng: np.random.Generator,
    ) -> SmcPhdState:
        """The state with what the measurements show of the intensity outside the particles."""
        points = np.concatenate([points for points, _ in arrivals], axis=1)
        weights = np.concatenate([state.weights, *(weights for _, weights in arrivals)])
        return replace(_with(state, with_velocities(points, self._motion(state), rng)), weights=weights)


def _with(state: SmcPhdState, states: FloatArray) -> SmcPhdState:
    """The state with more particles, in no cluster, whose weights are not yet in it."""
    return replace(
        state,
        states=np.concatenate([state.states, states], axis=1),
        labels=np.concatenate([state.labels, np.full(states.shape[1], -1)]),
    )


def _mixed(old: float, new: float) -> float:
    """A running mean with a memory of ten sets; 0 is no memory yet."""
    return 0.9 * old + 0.1 * new if old > 0.0 else new
