"""Fewer components that say the same: pruning, merging, a cap.

Vo & Ma, "The Gaussian mixture probability hypothesis density filter", IEEE Transactions on Signal Processing,
2006, table II; merged moments as Salmond (1990).
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.gaussian.components import Components, factorise
from estimator.kernels import kernel

_ROOM = 8  # times as many components as may stay are merged at most, the heaviest


def reduced(
    components: Components, *, prune: float, merge_sigmas: float, most: int, mutual: bool = False
) -> Components:
    """The components but those lighter than `prune`, close ones merged, the `most` heaviest, in that order.

    What is dropped is dropped: other weights do not grow by it.
    """
    kept = components.chosen(components.weights >= prune) if prune > 0.0 else components
    if kept.count > _ROOM * most:  # merging a hundred thousand components would take minutes
        heaviest = np.argsort(-kept.weights, kind="stable")[: _ROOM * most]
        kept = kept.chosen(np.sort(heaviest))
    groups, count = grouped(kept, merge_sigmas, mutual)
    merged = together(kept, groups, count)
    order = np.argsort(-merged.weights, kind="stable")[:most]
    return merged.chosen(order)


def grouped(components: Components, sigmas: float, mutual: bool = False) -> tuple[IntArray, int]:
    """The group (k,) of each component, and how many groups there are.

    Again and again the heaviest component left takes to itself all those left whose mean is, measured with
    their own covariance, at most `sigmas` from its own; if `mutual`, measured with its own covariance too, so
    that a wide component beside a narrow one stays for itself.

    Raises:
        ValueError: if a covariance is not positive definite.
    """
    groups = np.full(components.count, -1)
    order = np.argsort(-components.weights, kind="stable")
    count = _group(components.means, components.covariances, order, sigmas * sigmas, mutual, groups)
    if count < 0:
        raise ValueError(f"covariances: number {-1 - count} is not positive definite")
    return groups, count


def together(components: Components, groups: IntArray, count: int) -> Components:
    """One component per group 0..count - 1, with the weight, mean and covariance of all its members together.

    Members of group -1 are left out.
    """
    n = components.state_size
    out = Components(np.zeros(count), np.zeros((count, n)), np.zeros((count, n, n)))
    _combine(
        components.weights,
        components.means,
        components.covariances,
        groups,
        out.weights,
        out.means,
        out.covariances,
    )
    return out


@kernel
def _group(
    means: FloatArray, covariances: FloatArray, order: IntArray, limit: float, mutual: bool, groups: IntArray
) -> int:
    """Fills groups (k,); their number, or -1 - i if covariance i is not positive definite.

    Those left are kept in the order of their first coordinate, so that a leader looks only at those within
    its widest neighbour's reach; that reach is kept for stretches of 16.
    """
    k, n = means.shape
    factors = np.empty((k, n, n))
    reach = np.empty(k)
    for i in range(k):
        if not factorise(covariances[i], factors[i]):
            return -1 - i
        reach[i] = np.sqrt(limit * covariances[i, 0, 0])
    along = np.argsort(means[:, 0])
    rank = np.empty(k, np.int64)
    keys = np.empty(k)
    for t in range(k):
        rank[along[t]] = t
        keys[t] = means[along[t], 0]
    stretches = (k + 15) // 16
    widest = np.zeros(stretches)
    for t in range(k):
        widest[t // 16] = max(widest[t // 16], reach[along[t]])
    y = np.empty(n)
    count = 0
    for i in order:
        if groups[i] >= 0:
            continue
        groups[i] = count
        for block in range(stretches):
            begin, end = 16 * block, min(16 * block + 16, k)
            if keys[begin] - keys[rank[i]] > widest[block] or keys[rank[i]] - keys[end - 1] > widest[block]:
                continue
            for t in range(begin, end):
                j = along[t]
                if groups[j] >= 0 or abs(keys[t] - keys[rank[i]]) > reach[j]:
                    continue
                if not _within(means[i], means[j], factors[j], limit, y):
                    continue
                if mutual and not _within(means[i], means[j], factors[i], limit, y):
                    continue
                groups[j] = count
        count += 1
    return count


@kernel
def _within(one: FloatArray, other: FloatArray, lower: FloatArray, limit: float, y: FloatArray) -> bool:
    """Whether |L^-1 (one - other)|^2 is at most the limit."""
    square = 0.0
    for a in range(one.size):
        step = one[a] - other[a]
        for b in range(a):
            step -= lower[a, b] * y[b]
        y[a] = step / lower[a, a]
        square += y[a] * y[a]
        if square > limit:
            return False
    return True


@kernel
def _combine(
    weights: FloatArray,
    means: FloatArray,
    covariances: FloatArray,
    groups: IntArray,
    out_weights: FloatArray,
    out_means: FloatArray,
    out_covariances: FloatArray,
) -> None:
    k, n = means.shape
    count = out_weights.size
    sizes, only = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for i in range(k):
        g = groups[i]
        if g >= 0:
            out_weights[g] += weights[i]
            sizes[g] += 1
            only[g] = i
            for a in range(n):
                out_means[g, a] += weights[i] * means[i, a]
    for g in range(count):
        if sizes[g] == 1:  # as it was, to the last bit
            out_means[g] = means[only[g]]
            out_covariances[g] = covariances[only[g]]
        elif out_weights[g] > 0.0:
            for a in range(n):
                out_means[g, a] /= out_weights[g]
    for i in range(k):
        g = groups[i]
        if g < 0 or sizes[g] == 1:
            continue
        share = weights[i] / out_weights[g] if out_weights[g] > 0.0 else 0.0
        for a in range(n):
            da = means[i, a] - out_means[g, a]
            for b in range(a + 1):
                value = share * (covariances[i, a, b] + da * (means[i, b] - out_means[g, b]))
                out_covariances[g, a, b] += value
                if a != b:
                    out_covariances[g, b, a] += value
