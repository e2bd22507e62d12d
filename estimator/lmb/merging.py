"""Tracks that can only be one target become one.

Two tracks at the same place that share one target's measurements end with half a target each, and stay so:
independent tracks cannot say "one of us, not both". Where they lie on each other and are together at most one
target, one track with the sum of their intensities says just that.

Where targets are known never to be nearer to each other than a `spacing`, two tracks nearer than that cannot
both exist: given this, either one does or none. Measurements whose errors repeat (poses, calibration)
otherwise leave a second track beside each target, for as long as the error lasts.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.gaussian.components import Components, factorise
from estimator.kernels import kernel
from estimator.lmb.correction import Reduction, reduced
from estimator.lmb.tracks import Tracks


def apart(tracks: Tracks, dimension: int, spacing: float, reduction: Reduction) -> Tracks:
    """The tracks, those that lie within `spacing` (m) of a likelier one joined to it.

    Only tracks narrower than `spacing` are looked at: of wider ones nobody knows how near they are. Of tracks
    with odds o = r / (1 - r), of which at most one exists, one does with odds sum o; its density is their
    mixture by o.
    """
    means, covariances = tracks.moments(dimension)
    narrow = np.sqrt(np.trace(covariances, axis1=1, axis2=2) / dimension) < spacing
    hosts = np.arange(tracks.count)
    order = np.argsort(-tracks.existence, kind="stable")
    if not _find_near(order[narrow[order]], means, spacing, hosts):
        return tracks
    odds = tracks.existence / (1.0 - tracks.existence)
    totals = np.asarray(np.bincount(hosts, odds, tracks.count), np.float64)
    # whom nobody joins keeps its very number
    alone = np.bincount(hosts, minlength=tracks.count) == 1
    existence = np.where(alone, tracks.existence, totals / (1.0 + totals))
    return reduced(_union(tracks, hosts, odds / totals[hosts], existence), reduction)


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
    return reduced(_union(tracks, hosts, tracks.existence / totals[hosts], totals), reduction)


def _union(tracks: Tracks, hosts: IntArray, shares: FloatArray, existence: FloatArray) -> Tracks:
    """The hosts with the components of all that join them: shares (n,) of each in its host's mixture."""
    n, owners = tracks.count, tracks.owners()
    kept = np.flatnonzero(hosts == np.arange(n))
    rows = np.argsort(hosts[owners], kind="stable")
    parts = tracks.components.chosen(rows)
    counts = np.bincount(hosts[owners], minlength=n)[kept]
    components = Components(parts.weights * shares[owners[rows]], parts.means, parts.covariances)
    return Tracks(tracks.labels[kept], existence[kept], np.append(0, np.cumsum(counts)), components)


@kernel
def _find_near(order: IntArray, means: FloatArray, spacing: float, hosts: IntArray) -> bool:
    """As `_find_hosts`, for tracks whose means (n, d) are nearer than `spacing`."""
    any_found = False
    for t in range(order.size):
        a = order[t]
        if hosts[a] != a:
            continue
        for u in range(t + 1, order.size):
            b = order[u]
            square = 0.0
            for c in range(means.shape[1]):
                square += (means[a, c] - means[b, c]) ** 2
            if hosts[b] == b and square < spacing * spacing:
                hosts[b] = a
                any_found = True
    return any_found


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
