"""Where a target may be before anything is known of it."""

import numpy as np

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.gaussian.components import Components
from estimator.motion import Motion
from estimator.soft.config import MixturesConfig


def uniform(area: Area, most: int) -> Components:
    """An even mixture over the area with the mean and covariance of the uniform density.

    A grid of equal components, as even in metres as `most` allows, each half a spacing wide: densities inside
    vary by 1.5 %, and the edges are soft. With a map, components in occupied cells are left out.
    """
    sides = area.high - area.low
    d = sides.size
    counts = np.ones(d, np.int64)
    while True:  # the axis with the widest spacing gets one more, while that is not too many
        order = np.argsort(-(sides / np.sqrt(counts**2 + 2.0)), kind="stable")
        for a in order:
            more = counts.copy()
            more[a] += 1
            if np.prod(more) <= most:
                counts = more
                break
        else:
            break
    spacing = sides / np.sqrt(counts**2 + 2.0)
    middle = 0.5 * (area.low + area.high)
    axes = [middle[a] + spacing[a] * (np.arange(counts[a]) - 0.5 * (counts[a] - 1)) for a in range(d)]
    means: FloatArray = np.stack([x.ravel() for x in np.meshgrid(*axes, indexing="ij")], axis=1)
    free = area.is_free(np.ascontiguousarray(means.T))
    if free.any():
        means = means[free]
    k = len(means)
    covariances = np.tile(np.diag((0.5 * spacing) ** 2), (k, 1, 1))
    return Components(np.full(k, 1.0 / k), means, covariances)


def priors(config: MixturesConfig, area: Area, count: int) -> list[Components]:
    """Where each of `count` targets may be, the named ones first.

    Raises:
        ValueError: if a target's prior does not fit the area; names the key.
    """
    d = area.dimension
    anywhere = uniform(area, config.components)
    out = []
    for i, target in enumerate(config.targets):
        where = f"targets[{i}]"
        if target.mean_m is None:
            out.append(anywhere)
            continue
        if len(target.mean_m) != d or not np.isfinite(target.mean_m).all():
            raise ValueError(f"{where}.mean_m: expected {d} finite numbers, got {target.mean_m}")
        if target.sigma_m is None:
            raise ValueError(f"{where}.sigma_m: needed with a mean")
        covariance = target.sigma_m**2 * np.eye(d)[None]
        out.append(Components(np.ones(1), np.array([target.mean_m]), covariance))
    return [*out, *[anywhere] * (count - len(out))]


def moving(prior: Components, motion: Motion) -> Components:
    """A prior of positions with what a motion's state has beside them."""
    rest = np.zeros((prior.count, motion.state_size - prior.state_size))
    means = np.concatenate([prior.means, rest], axis=1)
    return Components(prior.weights, means, motion.start_covariance(prior.covariances))
