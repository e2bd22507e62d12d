"""The Gaussian nearest to a Gaussian prior times one softmax sub-class, by Bouchard's bound.

Ahmed, Sample & Campbell, IEEE Transactions on Robotics, 2013, use it as the proposal of importance sampling
where an observation contradicts the prior; Ponda et al. 2012, Algorithm 3, cites it without equations.
Derived: with y_k = w_k . x + b_k, any alpha and any xi_k,

    log sum_k exp(y_k) <= alpha + sum_k log(1 + exp(y_k - alpha))                        (Bouchard 2007)
    log(1 + exp(t)) <= lambda(xi) (t^2 - xi^2) + (t - xi) / 2 + log(1 + exp(xi))         (Jaakkola & Jordan)

with lambda(xi) = tanh(xi / 2) / (4 xi). So log p(s | x) = y_s - log sum_k exp(y_k) is at least
g + h . x - x . K x / 2 with K = 2 sum_k lambda_k w_k w_k' and
h = w_s - sum_k w_k / 2 + 2 sum_k lambda_k (alpha - b_k) w_k. Times the prior N(mu, P) this is a Gaussian of
precision P^-1 + K. Under it the bound is tightest for xi_k^2 = E[(y_k - alpha)^2] and
alpha = ((c - 2) / 4 + sum_k lambda_k E[y_k]) / sum_k lambda_k, c the number of sub-classes. The three steps
are taken in turn; each makes the bound tighter. The sub-classes of one category are bounded one by one.

The bound's covariance is far too small to sample from (its samples miss most of the posterior), so only its
mean is used, with the prior's covariance: as the posterior is the prior times a log-concave function, its
covariance is never greater than that (Brascamp & Lieb 1976), and the importance weights have no heavy tail.
"""

import numpy as np

from estimator.arrays import FloatArray
from estimator.gaussian.components import factorise
from estimator.kernels import exp_negative, kernel

_STEPS = 60  # at most; a proposal needs no more
_LEAP = 10.0
_SETTLED = 0.05  # standard deviations of the prior that the mean still moves


@kernel
def inverse(lower: FloatArray, out: FloatArray) -> None:
    """The inverse (d, d) of a matrix with Cholesky factor `lower`, into out."""
    d = lower.shape[0]
    for c in range(d):
        for i in range(d):  # lower y = e_c
            value = 1.0 if i == c else 0.0
            for k in range(i):
                value -= lower[i, k] * out[k, c]
            out[i, c] = value / lower[i, i]
        for i in range(d - 1, -1, -1):  # lower' x = y
            value = out[i, c]
            for k in range(i + 1, d):
                value -= lower[k, i] * out[k, c]
            out[i, c] = value / lower[i, i]


@kernel
def products(weights: FloatArray) -> FloatArray:
    """w_a w_b of every sub-class, (d, d, k), for weights (k, d)."""
    k, d = weights.shape
    out = np.empty((d, d, k))
    for a in range(d):
        for b in range(d):
            for r in range(k):
                out[a, b, r] = weights[r, a] * weights[r, b]
    return out


@kernel
def variational(
    mean: FloatArray,
    precision: FloatArray,
    weights: FloatArray,
    squares: FloatArray,
    biases: FloatArray,
    s: int,
    posterior: FloatArray,
    covariance: FloatArray,
) -> int:
    """Mean (d,) and covariance (d, d) of the bound's Gaussian, into `posterior` and `covariance`.

    For a prior of `mean` (d,) and `precision` (d, d), and sub-class s of a softmax with weights (d, k), their
    `products` (d, d, k), and biases (k,). On entry `posterior` is
    where to start and `covariance` the prior's. Gives the number of steps.
    """
    d, k = weights.shape
    lower, total = np.empty((d, d)), np.empty((d, d))
    start, h, reach = np.zeros(d), np.empty(d), np.empty(d)
    for a in range(d):
        reach[a] = _SETTLED * np.sqrt(covariance[a, a])
        start[a] = weights[a, s]
        for b in range(d):
            start[a] += precision[a, b] * mean[b]
    older, newer = np.zeros(d), np.zeros(d)
    rates, expected, xi = np.full(k, 0.125), np.empty(k), np.empty(k)
    for step in range(1, _STEPS + 1):
        for r in range(k):
            expected[r] = biases[r]
        for a in range(d):
            row, x = weights[a], posterior[a]
            for r in range(k):
                expected[r] += row[r] * x
        top = 0.0
        bottom = 0.0
        for r in range(k):
            top += rates[r] * expected[r]
            bottom += rates[r]
        alpha = (0.25 * (k - 2) + top) / bottom
        for r in range(k):
            xi[r] = (expected[r] - alpha) ** 2
        for a in range(d):
            for b in range(d):
                row, c = squares[a, b], covariance[a, b]
                for r in range(k):
                    xi[r] += row[r] * c
        for r in range(k):
            xi[r] = np.sqrt(max(xi[r], 1e-8))
        for r in range(k):
            e = exp_negative(-xi[r])
            rates[r] = (1.0 - e) / ((1.0 + e) * 4.0 * xi[r])
        for r in range(k):
            expected[r] = 2.0 * rates[r] * (alpha - biases[r]) - 0.5
        for a in range(d):
            row = weights[a]
            pull = 0.0
            for r in range(k):
                pull += expected[r] * row[r]
            h[a] = start[a] + pull
            for b in range(d):
                row = squares[a, b]
                value = 0.0
                for r in range(k):
                    value += rates[r] * row[r]
                total[a, b] = precision[a, b] + 2.0 * value
        factorise(total, lower)
        inverse(lower, covariance)
        still = True
        for a in range(d):
            value = 0.0
            for b in range(d):
                value += covariance[a, b] * h[b]
            moved = value - posterior[a]
            still = still and abs(moved) < reach[a]
            older[a], newer[a] = newer[a], moved
            posterior[a] = value
        if still:
            return step
        if step % 2 == 0:
            along = 0.0
            across = 0.0
            for a in range(d):
                along += older[a] * older[a]
                across += (newer[a] - older[a]) ** 2
            if across > 0.0:
                leap = min(np.sqrt(along / across), _LEAP)
                if leap > 1.0:
                    for a in range(d):  # x0 + 2 leap r + leap^2 v, x2 = x0 + 2 r + v
                        bend = newer[a] - older[a]
                        posterior[a] += 2.0 * (leap - 1.0) * older[a] + (leap * leap - 1.0) * bend
    return _STEPS
