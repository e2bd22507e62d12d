"""Estimated targets of a Gaussian mixture, and points that stand for it."""

from functools import lru_cache

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.filter import Clusters
from estimator.gaussian.components import Components, factorise
from estimator.gaussian.reduction import grouped, together
from estimator.kernels import kernel
from estimator.smc.resampling import systematic
from estimator.undetected import Undetected

_POINTS = 64  # different offsets from a mean before they come again


def clusters_of(
    components: Components, dimension: int, *, sigmas: float, least: float
) -> tuple[Clusters, IntArray]:
    """Groups of components by position, heaviest first, and the group (k,) of each component.

    The heaviest component left takes those within `sigmas` (Mahalanobis, by their own covariance) of it, as
    in merging; groups of less mass than `least` are no cluster, and their components have -1.
    """
    d = dimension
    places = Components(
        components.weights,
        np.ascontiguousarray(components.means[:, :d]),
        np.ascontiguousarray(components.covariances[:, :d, :d]),
    )
    groups, count = grouped(places, sigmas)
    found = together(places, groups, count)
    order = np.argsort(-found.weights, kind="stable")
    order = order[found.weights[order] >= least]
    numbers = np.full(count, -1)
    numbers[order] = np.arange(order.size)
    found = found.chosen(order)
    radii = np.sqrt(np.trace(found.covariances, axis1=1, axis2=2) / d)
    velocities = None
    if components.means.shape[1] >= 2 * d:
        momenta = components.weights[:, None] * components.means[:, d : 2 * d]
        sums = np.zeros((count, d))
        np.add.at(sums, groups, momenta)
        velocities = np.ascontiguousarray((sums[order] / found.weights[:, None]).T)
    clusters = Clusters(found.positions(d), found.covariances, found.weights, radii, velocities=velocities)
    return clusters, np.asarray(numbers[groups] if count else groups)


def sampled(
    components: Components, undetected: Undetected | None, size: int, dimension: int
) -> tuple[FloatArray, FloatArray]:
    """At most `size` points (d, n) with weights (n,) of components and undetected intensity together.

    Every point stands for the same mass; a component's points lie as its Gaussian does, always the same.
    """
    d, masses = dimension, components.weights
    if undetected is not None:
        masses = np.concatenate([masses, undetected.node_masses()])
    total = float(masses.sum())
    if total <= 0.0 or size < 1:
        return np.zeros((d, 0)), np.zeros(0)
    chosen, counts = np.unique(systematic(masses, size, 0.5), return_counts=True)
    k, weight = components.count, total / size
    inside = chosen < k
    owners = np.repeat(chosen[inside], counts[inside])
    offsets = np.ascontiguousarray(_offsets(d)[:, np.arange(owners.size) % _POINTS])
    points = np.empty((d, owners.size))
    _place(components.means, components.covariances, owners, offsets, points)
    if undetected is not None:
        points = np.concatenate([points, undetected.nodes()[:, chosen[~inside] - k]], axis=1)
    weights = np.concatenate([np.full(owners.size, weight), counts[~inside] * weight])
    return np.ascontiguousarray(points), weights


@lru_cache(maxsize=4)
def _offsets(dimension: int) -> FloatArray:
    """Standard normal points (d, _POINTS), in pairs about 0."""
    half = np.random.default_rng(dimension).standard_normal((dimension, _POINTS // 2))
    points = np.stack([half, -half], axis=2).reshape(dimension, _POINTS)
    points.flags.writeable = False
    return points


@kernel
def _place(
    means: FloatArray, covariances: FloatArray, owners: IntArray, offsets: FloatArray, points: FloatArray
) -> None:
    d = points.shape[0]
    factor = np.zeros((d, d))
    for p in range(owners.size):
        i = owners[p]
        if p == 0 or owners[p - 1] != i:
            factorise(covariances[i, :d, :d], factor)
        for a in range(d):
            points[a, p] = means[i, a]
            for b in range(a + 1):
                points[a, p] += factor[a, b] * offsets[b, p]
