"""What one measurement set makes of tracks, given the association probabilities."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.gaussian.components import Components, factorise
from estimator.gaussian.pairs import Pairs as KalmanPairs
from estimator.kernels import kernel
from estimator.lmb.association import Marginals
from estimator.lmb.tracks import Tracks


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Which track may have made which measurement, from the components' pairs."""

    offsets: IntArray  # (n + 1,) rows of tracks
    columns: IntArray  # (t,) measurements, each at most once in a row
    weights: FloatArray  # (t,) sum over the track's components of w p_D g(z_j | x)
    links: IntArray  # (p,) which of these each component pair belongs to, -1 if its share is 0
    shares: FloatArray  # (p,) w p_D g(z_j | x) of each component pair


def sightings(tracks: Tracks, pairs: KalmanPairs, detection: FloatArray, measurements: int) -> Sightings:
    """Sums the component pairs by track; detection (p,) is p_D at each pair's posterior mean."""
    offsets = np.zeros(tracks.count + 1, np.int64)
    columns, weights, links, shares = _sum_by_track(
        tracks.offsets,
        tracks.components.weights,
        pairs.offsets,
        pairs.measurements,
        pairs.log_likelihood,
        detection,
        measurements,
        offsets,
    )
    return Sightings(offsets, columns, weights, links, shares)


@dataclass(frozen=True, slots=True)
class Reduction:
    """How a track's mixture is kept small."""

    least: float  # components lighter than this share of their track's heaviest go
    merging: float  # components nearer than this to a heavier one become one with it, standard deviations
    most: int  # components of a track


def corrected(
    tracks: Tracks,
    missed: FloatArray,
    pairs: KalmanPairs,
    seen: Sightings,
    marginals: Marginals,
    reduction: Reduction,
) -> Tracks:
    """The tracks after a measurement set: r' and mixtures of every association's part, kept small.

    missed (k,) is 1 - p_D of each component. A track is unseen with weight w_0 = 1 - r + r sum w_k missed_k,
    of which all but 1 - r is a target that is there; with w_0 = 0 it cannot have gone unseen and is gone.
    These are the sums over hypotheses of Reuter, Vo, Vo & Dietmayer 2014, section IV, with those over joint
    associations in `marginals`.
    """
    parts = tracks.components
    existence, offsets = np.empty(tracks.count), np.zeros(tracks.count + 1, np.int64)
    weights, means, covariances = _posterior(
        tracks.offsets,
        tracks.existence,
        parts.weights,
        parts.means,
        parts.covariances,
        missed,
        pairs.offsets,
        pairs.means,
        pairs.covariances,
        seen.weights,
        seen.links,
        seen.shares,
        marginals.pairs,
        marginals.unseen,
        reduction.least,
        reduction.merging,
        reduction.most,
        existence,
        offsets,
    )
    return Tracks(tracks.labels, existence, offsets, Components(weights, means, covariances))


def reduced(tracks: Tracks, reduction: Reduction) -> Tracks:
    """The tracks with fewer components, as after an update in which nothing could be seen."""
    parts = tracks.components
    n, k = tracks.count, parts.count
    none = KalmanPairs(
        np.zeros(k + 1, np.int64),
        np.zeros(0, np.int64),
        np.zeros(0),
        np.zeros((0, parts.state_size)),
        parts.covariances,
    )
    nothing = Sightings(
        np.zeros(n + 1, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64), np.zeros(0)
    )
    alone = Marginals(np.zeros(0), np.ones(n), np.zeros(0), True)
    return corrected(tracks, np.ones(k), none, nothing, alone, reduction)


def unseen_weights(tracks: Tracks, missed: FloatArray) -> FloatArray:
    """w_0 (n,) of `corrected`."""
    if tracks.count == 0:
        return np.zeros(0)
    alive = np.add.reduceat(tracks.components.weights * missed, tracks.offsets[:-1])
    return np.asarray(np.maximum(1.0 - tracks.existence + tracks.existence * alive, 0.0))


@kernel
def _sum_by_track(
    offsets: IntArray,
    weights: FloatArray,
    rows: IntArray,
    measurements: IntArray,
    log_likelihood: FloatArray,
    detection: FloatArray,
    m: int,
    out: IntArray,
) -> tuple[IntArray, FloatArray, IntArray, FloatArray]:
    p = measurements.size
    columns, totals = np.empty(p, np.int64), np.empty(p)
    links, shares = np.empty(p, np.int64), np.empty(p)
    place = np.full(m, -1)
    count = 0
    for i in range(offsets.size - 1):
        first = count
        for k in range(offsets[i], offsets[i + 1]):
            for q in range(rows[k], rows[k + 1]):
                shares[q] = weights[k] * detection[q] * np.exp(log_likelihood[q])
                links[q] = -1
                if shares[q] > 0.0:
                    j = measurements[q]
                    if place[j] < first:
                        place[j], columns[count], totals[count] = count, j, 0.0
                        count += 1
                    links[q] = place[j]
                    totals[place[j]] += shares[q]
        out[i + 1] = count
    return columns[:count], totals[:count], links, shares


@kernel
def _posterior(
    offsets: IntArray,
    existence: FloatArray,
    weights: FloatArray,
    means: FloatArray,
    covariances: FloatArray,
    missed: FloatArray,
    rows: IntArray,
    pair_means: FloatArray,
    pair_covariances: FloatArray,
    totals: FloatArray,
    links: IntArray,
    shares: FloatArray,
    marginals: FloatArray,
    unseen: FloatArray,
    least: float,
    merging: float,
    most: int,
    out_existence: FloatArray,
    out_offsets: IntArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fills r' (n,) and the offsets; the new components."""
    n, size = offsets.size - 1, means.shape[1]
    room, widest = 0, 0
    for i in range(n):
        here = offsets[i + 1] - offsets[i] + rows[offsets[i + 1]] - rows[offsets[i]]
        room += min(here, most)
        widest = max(widest, here)
    out_weights, out_means = np.empty(room), np.empty((room, size))
    out_covariances = np.empty((room, size, size))
    mass, centres = np.empty(widest), np.empty((widest, size))
    spreads = np.empty((widest, size, size))
    count = 0
    for i in range(n):
        alive = 0.0
        for k in range(offsets[i], offsets[i + 1]):
            alive += weights[k] * missed[k]
        nothing = 1.0 - existence[i] + existence[i] * alive
        factor = unseen[i] * existence[i] / nothing if nothing > 0.0 else 0.0
        r, heaviest, kept = factor * alive, 0.0, 0
        for k in range(offsets[i], offsets[i + 1]):
            heaviest = max(heaviest, factor * weights[k] * missed[k])
        for q in range(rows[offsets[i]], rows[offsets[i + 1]]):
            if links[q] >= 0:
                value = marginals[links[q]] * shares[q] / totals[links[q]]
                heaviest = max(heaviest, value)
                r += value
        for k in range(offsets[i], offsets[i + 1]):
            value = factor * weights[k] * missed[k]
            if value > least * heaviest:
                mass[kept], centres[kept], spreads[kept] = value, means[k], covariances[k]
                kept += 1
            for q in range(rows[k], rows[k + 1]):
                if links[q] < 0:
                    continue
                value = marginals[links[q]] * shares[q] / totals[links[q]]
                if value > least * heaviest:
                    mass[kept], centres[kept], spreads[kept] = value, pair_means[q], pair_covariances[k]
                    kept += 1
        out_existence[i] = min(r, 1.0)
        merged = _merge(
            mass[:kept],
            centres[:kept],
            spreads[:kept],
            merging,
            most,
            out_weights[count:],
            out_means[count:],
            out_covariances[count:],
        )
        count += merged
        out_offsets[i + 1] = count
    return out_weights[:count], out_means[:count], out_covariances[:count]


@kernel
def _merge(
    mass: FloatArray,
    means: FloatArray,
    covariances: FloatArray,
    merging: float,
    most: int,
    out_weights: FloatArray,
    out_means: FloatArray,
    out_covariances: FloatArray,
) -> int:
    """Merge one mixture by moments, heaviest first (Vo & Ma 2006, table II), into at most `most` components
    whose weights sum to 1; how many."""
    count, size = mass.size, means.shape[1]
    if count == 1:
        out_weights[0], out_means[0], out_covariances[0] = 1.0, means[0], covariances[0]
        return 1
    order = np.argsort(-mass)
    factors, regular = np.empty(covariances.shape), np.empty(count, np.bool_)
    for b in range(count):
        regular[b] = factorise(covariances[b], factors[b])
    free = np.ones(count, np.bool_)
    step, members = np.empty(size), np.empty(count, np.int64)
    made, total = 0, 0.0
    limit = merging * merging
    for t in range(count):
        a = order[t]
        if not free[a]:
            continue
        if made == most:
            break
        taken, weight = 0, 0.0
        for u in range(t, count):
            b = order[u]
            if not free[b]:
                continue
            if b != a:
                if not regular[b]:
                    continue
                square = 0.0
                for c in range(size):
                    value = means[b, c] - means[a, c]
                    for e in range(c):
                        value -= factors[b, c, e] * step[e]
                    step[c] = value / factors[b, c, c]
                    square += step[c] * step[c]
                if square > limit:
                    continue
            free[b] = False
            members[taken] = b
            taken += 1
            weight += mass[b]
        out_weights[made] = weight
        total += weight
        for c in range(size):
            value = 0.0
            for u in range(taken):
                value += mass[members[u]] * means[members[u], c]
            out_means[made, c] = value / weight
        for c in range(size):
            for e in range(c + 1):
                value = 0.0
                for u in range(taken):
                    b = members[u]
                    value += mass[b] * (
                        covariances[b, c, e]
                        + (means[b, c] - out_means[made, c]) * (means[b, e] - out_means[made, e])
                    )
                out_covariances[made, c, e] = value / weight
                out_covariances[made, e, c] = value / weight
        made += 1
    for t in range(made):
        out_weights[t] /= total
    return made
