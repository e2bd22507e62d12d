"""The detection probability of wide components: its mean over the Gaussian, and splits where it varies.

A component that the edge of a field of view cuts in two is neither seen nor unseen. What is missed of it lies
outside, so the component is split along the axis over which p_D changes most, until its parts are on one side
or small. The parts together keep the whole's moments, and merge again where nothing tells them apart. Compare
LeGrand & Ferrari, "Split happens! Imprecise and negative information in Gaussian mixture random finite set
filtering", Journal of Advances in Information Fusion, 2022.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.gaussian.components import Components, sigma_points
from estimator.kernels import kernel
from estimator.sensor import SensorModel

_PART = 0.5  # a part's standard deviation along the axis, in the whole's
# Four parts at the nodes of Gauss-Hermite, drawn together by sqrt(1 - _PART^2), with its weights: moments up
# to the seventh agree. An even number, so that an edge through the middle does not halve the heaviest part.
_STEPS = np.sqrt((1.0 - _PART**2) * np.array([3.0 - np.sqrt(6.0), 3.0 + np.sqrt(6.0)]))
_SHARES = 0.25 / np.array([3.0 - np.sqrt(6.0), 3.0 + np.sqrt(6.0)])


def mean_detection(
    means: FloatArray,
    covariances: FloatArray,
    owners: IntArray | None,
    sensor: SensorModel,
    pose: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """E[p_D] (k,) and how much p_D varies (k,), over Gaussians with means (k, n_x).

    The covariance of Gaussian i is `covariances[owners[i]]`, or `covariances[i]` without owners. By 2 d + 1
    points, exact for polynomials of third degree.

    Raises:
        ValueError: if a covariance of positions is not positive definite.
    """
    d, k = sensor.dimension, len(means)
    if owners is None:
        owners = np.arange(k)
    points = np.empty((d, k * (2 * d + 1)))
    bad = sigma_points(means, covariances, owners, points)
    if bad >= 0:
        raise ValueError(f"covariances: number {bad} is not positive definite")
    values = sensor.detection(points, pose[None, :])[0].reshape(k, 2 * d + 1)
    mean, variation = np.empty(k), np.empty(k)
    _averages(values, d, mean, variation)
    return mean, variation


def split_at_edges(
    components: Components, sensor: SensorModel, pose: FloatArray, *, tolerance: float, depth: int
) -> tuple[Components, FloatArray]:
    """The components and E[p_D] of each; those over which p_D varies by more than `tolerance` come in four
    parts, and these again, `depth` times over.
    """
    detection, variation = mean_detection(components.means, components.covariances, None, sensor, pose)
    for _ in range(depth):
        uneven = variation > tolerance
        if not uneven.any():
            break
        parts = split(components.chosen(uneven), sensor, pose)
        mean, varies = mean_detection(parts.means, parts.covariances, None, sensor, pose)
        components = components.chosen(~uneven).joined(parts)
        detection = np.concatenate([detection[~uneven], mean])
        variation = np.concatenate([variation[~uneven], varies])
    return components, detection


def split(components: Components, sensor: SensorModel, pose: FloatArray) -> Components:
    """Four parts for each component, along the axis of its positions over which p_D varies most."""
    d, k = sensor.dimension, components.count
    values, vectors = np.linalg.eigh(components.covariances[:, :d, :d])
    axes = vectors * np.sqrt(values)[:, None, :]  # (k, d, d), axes in columns, a standard deviation long
    ends = components.means[:, :d, None] + np.sqrt(3.0) * np.concatenate([axes, -axes], axis=2)
    points = np.concatenate([components.means[:, :d, None], ends], axis=2)
    seen = sensor.detection(np.ascontiguousarray(np.moveaxis(points, 1, 0).reshape(d, -1)), pose[None, :])
    seen = seen[0].reshape(k, 2 * d + 1)
    three = np.stack([seen[:, 1 : d + 1], seen[:, d + 1 :], np.repeat(seen[:, :1], d, axis=1)])
    # of axes with the same change the longest: eigh gives it last
    best = d - 1 - np.argmax((three.max(axis=0) - three.min(axis=0))[:, ::-1], axis=1)
    chosen = np.arange(k), slice(None), best
    # the whole state goes along: the regression of x on the position's part along the axis
    direction = np.einsum(
        "kij,kj->ki",
        components.covariances[:, :, :d],
        vectors[chosen] / np.sqrt(values[np.arange(k), best])[:, None],
    )
    narrowed = components.covariances - (1.0 - _PART**2) * direction[:, :, None] * direction[:, None, :]
    steps, shares = np.append(-_STEPS, _STEPS), np.append(_SHARES, _SHARES)
    means = components.means + steps[:, None, None] * direction
    return Components(
        np.outer(shares, components.weights).ravel(),
        means.reshape(-1, components.state_size),
        np.tile(narrowed, (steps.size, 1, 1)),
    )


@kernel
def _averages(values: FloatArray, d: int, mean: FloatArray, variation: FloatArray) -> None:
    for i in range(values.shape[0]):
        low, high, total = values[i, 0], values[i, 0], (1.0 - d / 3.0) * values[i, 0]
        for b in range(1, values.shape[1]):
            total += values[i, b] / 6.0
            low, high = min(low, values[i, b]), max(high, values[i, b])
        mean[i] = min(max(total, 0.0), 1.0)  # rounding only: weights are not negative for d <= 3
        variation[i] = high - low
