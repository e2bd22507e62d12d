"""A Gaussian mixture times a softmax category, as a Gaussian mixture again: Ponda et al. 2012, Algorithm 3.

Each pair of a component m and a sub-class s of the category becomes one component of (23), with weight
w_m l(m, s), l(m, s) = E_m[p(s | x)], and the mean and covariance of N_m(x) p(s | x), by importance sampling.

What is added to the paper. The samples are one fixed set of normal points with mean 0 and covariance exactly
1, turned by a random rotation: less noise than independent draws, and a flat likelihood changes nothing. The
proposal is the component itself where that is good enough: its effective sample is at least l(m, s) of the
samples. Otherwise it is the variational one, and if this is poor too, the moments found so far, widened.
Pairs are worked on by falling upper bound of their weight, until all others together cannot matter:
E[p(s | x)] <= E[exp(t (y_s - y_r))] for every r and every t in 0..1, which is known in closed form.
"""

from functools import lru_cache
from statistics import NormalDist

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel
from estimator.soft.moments import bounds_of, pair
from estimator.soft.variational import products

_LIKELY = -1.6  # log of the bound of l(m, s) below which the component itself is not even tried
_LEFT_OUT = 1e-3  # of the evidence: what the pairs that are left out may have together


@lru_cache(maxsize=16)
def unit_points(dimension: int, count: int) -> FloatArray:
    """Fixed normal points (d, count), evenly spread, symmetric, of covariance exactly 1. Read-only, shared.

    Half of them lie on a Kronecker lattice (Roberts 2018: powers of the root of g^(d + 1) = g + 1), the
    others opposite to these.
    """
    g = 2.0
    for _ in range(60):
        g = (1.0 + g) ** (1.0 / (dimension + 1))
    half = max((count + 1) // 2, 2 * dimension)
    steps = np.outer(g ** -np.arange(1.0, dimension + 1), np.arange(1, half + 1))
    quantile = NormalDist().inv_cdf
    uniform = (0.5 + steps) % 1.0
    normal = np.array([quantile(float(u)) for u in uniform.ravel()]).reshape(uniform.shape)
    points = np.concatenate([normal, -normal], axis=1)
    points = np.linalg.solve(np.linalg.cholesky(points @ points.T / points.shape[1]), points)
    points = np.ascontiguousarray(points)
    points.flags.writeable = False
    return points


def turned(points: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Points (d, n) after a random rotation or reflection (of the Haar measure, Mezzadri 2007)."""
    q, r = np.linalg.qr(rng.standard_normal((len(points), len(points))))
    return np.ascontiguousarray((q * np.sign(np.diag(r))) @ points)


@kernel
def reweighted(
    weights: FloatArray,
    means: FloatArray,
    covariances: FloatArray,
    slopes: FloatArray,
    biases: FloatArray,
    own: IntArray,
    units: FloatArray,
    propose: bool,
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, FloatArray, float]:
    """The mixture weights (n,), means (n, d), covariances (n, d, d) times the sub-classes `own` of a softmax.

    The softmax has slopes (k, d) and biases (k,); units (d, b) are normal points. With `propose` false, every
    proposal is the component itself. Gives weights (c,) of sum 1, means (c, d), covariances (c, d, d), the
    component each came from (c,), its effective share of the samples (c,), and the logarithm of the evidence
    sum_m w_m E_m[p(own | x)], which is -inf if the mixture has no weight.
    """
    n, d = means.shape
    count = n * own.size
    bounds = np.empty(count)
    bounds_of(weights, means, covariances, slopes, biases, own, bounds)
    order = np.argsort(-bounds)
    rest = np.zeros(count + 1)  # what the pairs from here on may have, relative to the first
    first = bounds[order[0]] if count else -np.inf
    for i in range(count - 1, -1, -1):
        rest[i] = rest[i + 1] + np.exp(bounds[order[i]] - first)
    logs = np.empty(count)
    out_means, out_covariances = np.empty((count, d)), np.empty((count, d, d))
    sources, shares = np.empty(count, np.int64), np.empty(count)
    lines = np.empty((slopes.shape[0], units.shape[1]))
    # Rows of one array might overlap for all the compiler knows, and it would do one number at a time.
    top_row, total_row = np.empty(units.shape[1]), np.empty(units.shape[1])
    value_row, step_row = np.empty(units.shape[1]), np.empty(units.shape[1])
    work = (lines, top_row, total_row, value_row, step_row)
    furthest = 0.0
    for i in range(units.shape[1]):
        square = 0.0
        for a in range(d):
            square += units[a, i] * units[a, i]
        furthest = max(furthest, square)
    furthest = np.sqrt(furthest)
    columns, squares = slopes.T.copy(), products(slopes)
    top = -np.inf
    total = 0.0
    kept = 0
    for i in range(count):
        if bounds[order[i]] == -np.inf:
            break
        if kept and rest[i] * np.exp(min(first - top, 700.0)) < _LEFT_OUT * total:
            break
        m, s = order[i] // own.size, own[order[i] % own.size]
        log, share = pair(
            means[m],
            covariances[m],
            slopes,
            biases,
            s,
            units,
            furthest,
            columns,
            squares,
            propose,
            bounds[order[i]] - np.log(weights[m]) > _LIKELY,
            out_means[kept],
            out_covariances[kept],
            work,
        )
        logs[kept] = log + np.log(weights[m])
        sources[kept], shares[kept] = m, share
        if logs[kept] > top:
            total = total * np.exp(top - logs[kept]) + 1.0 if kept else 1.0
            top = logs[kept]
        else:
            total += np.exp(logs[kept] - top)
        kept += 1
    out = np.empty(kept)
    for i in range(kept):
        out[i] = np.exp(logs[i] - top) / total
    evidence = top + np.log(total) if kept else -np.inf
    return out, out_means[:kept], out_covariances[:kept], sources[:kept], shares[:kept], evidence
