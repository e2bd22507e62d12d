"""Clusters of the particle filter's state: estimated targets, their removal, and what they bring forth."""

from dataclasses import replace

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.filter import Clusters
from estimator.smc.config import SmcPhdConfig
from estimator.smc.kmeans import kmeans
from estimator.smc.regularisation import REACH
from estimator.smc.resampling import effective_sizes
from estimator.smc.state import SmcPhdState


def clustered(state: SmcPhdState, config: SmcPhdConfig) -> tuple[SmcPhdState, Clusters]:
    """K-means of the particles; the state remembers labels and centres.

    A few particles are narrower than what they stand for: with a `cluster_floor` f, covariances grow by
    (f sigma)^2 / n, sigma the standard deviation of where measurements point and n the effective number
    of the cluster's particles.
    """
    cutoff = config.cluster_cutoff_m or state.reach
    if cutoff <= 0.0:
        return state, Clusters.none(state.positions.shape[0])
    found, labels = kmeans(
        state.positions,
        state.weights,
        cutoff,
        least=config.cluster_least_mass,
        separation=config.cluster_separation,
        start=state.centres,
    )
    if config.cluster_floor > 0.0:
        effective = effective_sizes(state.weights, labels, found.masses.size)
        found = _widened(found, (config.cluster_floor * state.reach / REACH) ** 2 / effective)
    return replace(state, labels=labels, centres=found.means), found


def without(state: SmcPhdState, config: SmcPhdConfig, clusters: IntArray) -> SmcPhdState:
    """The state without the particles of the given clusters; the others keep their numbers.

    With `stray_sigmas`, particles in no cluster go too where they are that near to a removed one: they
    are its tail, and one of them alone would otherwise explain the target's next odd measurement.
    """
    gone = np.isin(state.labels, clusters) & (state.labels >= 0)
    if config.stray_sigmas > 0.0:
        stray = np.flatnonzero(state.labels < 0)
        for c in clusters:
            near = _within(state, state.labels == c, stray, config.stray_sigmas)
            gone[near] = True
    kept = ~gone
    return replace(
        state,
        states=np.ascontiguousarray(state.states[:, kept]),
        weights=state.weights[kept],
        labels=state.labels[kept],
    )


def grown(state: SmcPhdState, config: SmcPhdConfig, duration: float) -> FloatArray:
    """(n,) by what spawning multiplies each weight: exp(spawning duration), kept below `spawning_to`.

    Stray particles, in no cluster, and clusters that are rather nothing bring forth nothing: they would
    grow into targets of their own.
    """
    inside = state.labels >= 0
    masses = np.bincount(state.labels[inside], state.weights[inside], state.centres.shape[1])
    room = np.maximum(config.spawning_to / np.maximum(masses, 1e-300), 1.0)
    growth = np.minimum(np.exp(config.spawning * duration), room)
    growth[masses < config.spawning_from] = 1.0
    return np.asarray(np.append(growth, 1.0)[state.labels])  # label -1 takes the last


def recentred(state: SmcPhdState) -> SmcPhdState:
    """The state with its clusters' centres where their particles are now; those of no particle stay."""
    inside = np.flatnonzero((state.labels >= 0) & (state.weights > 0.0))
    labels, weights = state.labels[inside], state.weights[inside]
    count = state.centres.shape[1]
    masses = np.bincount(labels, weights, count)
    centres = state.centres.copy()
    for axis, row in enumerate(state.positions):
        sums = np.bincount(labels, weights * row[inside], count)
        np.divide(sums, masses, out=centres[axis], where=masses > 0.0)
    return replace(state, centres=centres)


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
