"""Systematic resampling that keeps the mass, and the jitter that keeps static particles from running out.

Jitter: Liu & West, "Combined parameter and state estimation in simulation-based filtering" (2001), applied
to each cluster on its own: particles shrink towards their cluster's mean by sqrt(1 - h^2) and get normal
noise of h^2 times its covariance, so that mean and covariance stay what they were however often it is done.
The bandwidth h is the normal rule of Silverman (1986, eq. 4.14) for the effective number of particles, times
a factor.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel


@kernel
def systematic(weights: FloatArray, count: int, offset: float) -> IntArray:
    """Ascending indices (count,) of particles; i occurs floor or ceil of count w_i / sum w times.

    `offset` in 0..1 is the only random number. The sum of the weights must be positive.
    """
    total = 0.0
    for i in range(weights.size):
        total += weights[i]
    step = total / count
    chosen = np.empty(count, np.int64)
    i, last = 0, weights.size - 1
    reached = weights[0]
    for k in range(count):
        mark = (k + offset) * step
        while reached <= mark and i < last:
            i += 1
            reached += weights[i]
        while weights[i] == 0.0 and i > 0:  # rounding at the end of the sum
            i -= 1
        chosen[k] = i
    return chosen


@kernel
def effective_size(weights: FloatArray) -> float:
    """(sum w)^2 / sum w^2, Kong, Liu & Wong (1994); 0 without mass."""
    total, squares = 0.0, 0.0
    for i in range(weights.size):
        total += weights[i]
        squares += weights[i] * weights[i]
    return total * total / squares if squares > 0.0 else 0.0


@kernel
def effective_sizes(weights: FloatArray, labels: IntArray, clusters: int) -> FloatArray:
    """`effective_size` of each cluster's particles, (clusters,)."""
    totals, squares = np.zeros(clusters), np.zeros(clusters)
    for i in range(weights.size):
        if labels[i] >= 0:
            totals[labels[i]] += weights[i]
            squares[labels[i]] += weights[i] * weights[i]
    for c in range(clusters):
        totals[c] = totals[c] * totals[c] / squares[c] if squares[c] > 0.0 else 0.0
    return totals


@kernel
def gathered(positions: FloatArray, chosen: IntArray) -> FloatArray:
    """Columns `chosen` of positions (d, n)."""
    out = np.empty((positions.shape[0], chosen.size))
    for a in range(positions.shape[0]):
        for k in range(chosen.size):
            out[a, k] = positions[a, chosen[k]]
    return out


@kernel
def jittered(
    positions: FloatArray,
    labels: IntArray,
    effective: FloatArray,
    factor: float,
    noise: FloatArray,
    low: FloatArray,
    high: FloatArray,
) -> None:
    """Move resampled positions (d, n), in place, by standard normal `noise` (d, n) within their clusters.

    labels (n,) gives each particle's cluster, -1 those of none, which stay; effective (c,) is each cluster's
    effective number of particles before resampling. A particle that would leave low..high stays.
    """
    d, n = positions.shape
    c = effective.size
    counts = np.zeros(c)
    means = np.zeros((c, d))
    for i in range(n):
        label = labels[i]
        if label >= 0:
            counts[label] += 1.0
            for a in range(d):
                means[label, a] += positions[a, i]
    for label in range(c):
        for a in range(d):
            means[label, a] /= max(counts[label], 1.0)
    spreads = np.zeros((c, d, d))
    for i in range(n):
        label = labels[i]
        if label >= 0:
            for a in range(d):
                for b in range(a + 1):
                    spreads[label, a, b] += (positions[a, i] - means[label, a]) * (
                        positions[b, i] - means[label, b]
                    )
    shrink = np.ones(c)
    for label in range(c):
        if counts[label] <= d or effective[label] <= 0.0:
            continue
        h = factor * (4.0 / ((d + 2.0) * effective[label])) ** (1.0 / (d + 4.0))
        h = min(h, 0.9)
        shrink[label] = np.sqrt(1.0 - h * h)
        scale = h * h / counts[label]
        for a in range(d):  # Cholesky factor in place; a flat direction gets no noise
            for b in range(a + 1):
                value = spreads[label, a, b] * scale
                for k in range(b):
                    value -= spreads[label, a, k] * spreads[label, b, k]
                if a == b:
                    spreads[label, a, a] = np.sqrt(value) if value > 0.0 else 0.0
                else:
                    pivot = spreads[label, b, b]
                    spreads[label, a, b] = value / pivot if pivot > 0.0 else 0.0
    moved = np.empty(d)
    for i in range(n):
        label = labels[i]
        if label < 0 or shrink[label] == 1.0:
            continue
        inside = True
        for a in range(d):
            x = means[label, a] + shrink[label] * (positions[a, i] - means[label, a])
            for b in range(a + 1):
                x += spreads[label, a, b] * noise[b, i]
            moved[a] = x
            inside = inside and low[a] <= x <= high[a]
        if inside:
            for a in range(d):
                positions[a, i] = moved[a]
