"""Tracks that are rivals for one target become one.

Two tracks at the same place that share one target's measurements end with half a target each, and stay so:
independent tracks cannot say "one of us, not both". Where they lie on each other and are together at most one
target, one track with the sum of their intensities says just that.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.gaussian.components import Components, factorise
from estimator.kernels import kernel
from estimator.lmb.tracks import Reduction, Tracks, reduced


def merged(tracks: Tracks, threshold: float, reduction: Reduction) -> Tracks:
    """The tracks, rivals made one; the intensity stays as it is but for `reduction`.

    Two are rivals if their existence probabilities sum to at most 1 and each one's mean is within `threshold`
    standard deviations of the other, by its own covariance as by the other's. The likelier one's label stays.
    """
    n = tracks.count
    means, covariances = tracks.moments(tracks.components.state_size)
    hosts = np.arange(n)
    order = np.argsort(-tracks.existence, kind="stable")
    if not _find_hosts(order, tracks.existence, means, covariances, threshold, hosts):
        return tracks
    totals = np.asarray(np.bincount(hosts, tracks.existence, n), np.float64)
    kept = np.flatnonzero(hosts == np.arange(n))
    owners = tracks.owners()
    rows = np.argsort(hosts[owners], kind="stable")
    parts = tracks.components.chosen(rows)
    weights = parts.weights * (tracks.existence / totals[hosts])[owners[rows]]
    counts = np.bincount(hosts[owners], minlength=n)[kept]
    union = Tracks(
        tracks.labels[kept],
        totals[kept],
        np.append(0, np.cumsum(counts)),
        Components(weights, parts.means, parts.covariances),
    )
    return reduced(union, reduction)


@kernel
def _find_hosts(
    order: IntArray,
    existence: FloatArray,
    means: FloatArray,
    covariances: FloatArray,
    threshold: float,
    hosts: IntArray,
) -> bool:
    """Fills in which track each becomes part of, itself if none; whether any does of another."""
    n, size = means.shape
    limit = threshold * threshold
    factors, regular = np.empty(covariances.shape), np.empty(n, np.bool_)
    for i in range(n):
        regular[i] = factorise(covariances[i], factors[i])
    step = np.empty(size)
    any_found = False
    for t in range(n):
        a = order[t]
        if hosts[a] != a or not regular[a]:
            continue
        total = existence[a]
        for u in range(t + 1, n):
            b = order[u]
            if hosts[b] != b or total + existence[b] > 1.0 or not regular[b]:
                continue
            ahead = means[b, 0] - means[a, 0]
            if ahead * ahead > limit * min(covariances[a, 0, 0], covariances[b, 0, 0]):
                continue  # the whole distance is at least this
            apart = 0.0
            for i in (a, b):
                square = 0.0
                for c in range(size):
                    value = means[b, c] - means[a, c]
                    for e in range(c):
                        value -= factors[i, c, e] * step[e]
                    step[c] = value / factors[i, c, c]
                    square += step[c] * step[c]
                apart = max(apart, square)
            if apart <= limit:
                hosts[b] = a
                total += existence[b]
                any_found = True
    return any_found
