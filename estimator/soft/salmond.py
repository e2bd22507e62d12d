"""Salmond's merging of a Gaussian mixture, which keeps its mean and covariance.

Salmond, "Mixture reduction algorithms for target tracking in clutter", SPIE 1305, 1990; Ponda et al. 2012,
section III-C 3. Again and again the two components are joined that add least to the spread between
components, w_i w_j / (w_i + w_j) (m_i - m_j)' P^-1 (m_i - m_j) with P the covariance of the whole mixture,
until no more than M_max are left.
"""

import numpy as np

from estimator.arrays import BoolArray, FloatArray
from estimator.gaussian.components import factorise
from estimator.kernels import kernel


@kernel
def merged(
    weights: FloatArray, means: FloatArray, covariances: FloatArray, most: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """At most `most` components for a mixture of weights (n,), means (n, d), covariances (n, d, d).

    Weights have sum 1. Each component keeps the nearest one with a higher number, so that a step costs
    about n and not n^2.
    """
    n, d = means.shape
    if n <= most:
        return weights.copy(), means.copy(), covariances.copy()
    w, p = weights.copy(), covariances.copy()
    x = means.copy()
    white = _whitened(weights, means, covariances)
    alive = np.ones(n, np.bool_)
    nearest, cost = np.empty(n, np.int64), np.empty(n)
    for i in range(n):
        nearest[i], cost[i] = _nearest(i, w, white, alive)
    for _ in range(n - most):
        i = -1
        for k in range(n):
            if alive[k] and nearest[k] >= 0 and (i < 0 or cost[k] < cost[i]):
                i = k
        j = nearest[i]
        _join(i, j, w, x, white, p)
        alive[j] = False
        nearest[i], cost[i] = _nearest(i, w, white, alive)
        for k in range(n):
            if alive[k] and k != i:
                if nearest[k] == i or nearest[k] == j:
                    nearest[k], cost[k] = _nearest(k, w, white, alive)
                elif k < i:
                    moved = _cost(k, i, w, white)
                    if moved < cost[k]:
                        nearest[k], cost[k] = i, moved
    out_w, out_x, out_p = np.empty(most), np.empty((most, d)), np.empty((most, d, d))
    c = 0
    for i in range(n):
        if alive[i]:
            out_w[c] = w[i]
            out_x[c] = x[i]
            out_p[c] = p[i]
            c += 1
    return out_w, out_x, out_p


@kernel
def _whitened(weights: FloatArray, means: FloatArray, covariances: FloatArray) -> FloatArray:
    """Means (n, d) in coordinates in which the mixture's covariance is 1."""
    n, d = means.shape
    centre, total, lower = np.zeros(d), np.zeros((d, d)), np.empty((d, d))
    for i in range(n):
        for a in range(d):
            centre[a] += weights[i] * means[i, a]
    for i in range(n):
        for a in range(d):
            for b in range(d):
                step = (means[i, a] - centre[a]) * (means[i, b] - centre[b])
                total[a, b] += weights[i] * (covariances[i, a, b] + step)
    factorise(total, lower)
    white = np.empty((n, d))
    for i in range(n):
        for a in range(d):
            value = means[i, a] - centre[a]
            for b in range(a):
                value -= lower[a, b] * white[i, b]
            white[i, a] = value / lower[a, a]
    return white


@kernel
def _cost(i: int, j: int, w: FloatArray, white: FloatArray) -> float:
    square = 0.0
    for a in range(white.shape[1]):
        square += (white[i, a] - white[j, a]) ** 2
    total = w[i] + w[j]
    return square * w[i] * w[j] / total if total > 0.0 else 0.0


@kernel
def _nearest(i: int, w: FloatArray, white: FloatArray, alive: BoolArray) -> tuple[int, float]:
    """The cheapest to join with i among those of higher number, -1 if there is none; and its cost."""
    best = -1
    least = np.inf
    for j in range(i + 1, w.size):
        if alive[j]:
            cost = _cost(i, j, w, white)
            if cost < least:
                best, least = j, cost
    return best, least


@kernel
def _join(i: int, j: int, w: FloatArray, x: FloatArray, white: FloatArray, p: FloatArray) -> None:
    """Component j into i, with the moments of both."""
    d = x.shape[1]
    total = w[i] + w[j]
    share = w[j] / total if total > 0.0 else 0.5
    for a in range(d):
        for b in range(d):
            apart = (x[j, a] - x[i, a]) * (x[j, b] - x[i, b])
            p[i, a, b] = (1.0 - share) * p[i, a, b] + share * p[j, a, b] + share * (1.0 - share) * apart
    for a in range(d):
        x[i, a] += share * (x[j, a] - x[i, a])
        white[i, a] += share * (white[j, a] - white[i, a])
    w[i] = total
