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
from estimator.gaussian.components import factorise
from estimator.kernels import exp_negative, kernel
from estimator.soft.variational import inverse, products, variational

Work = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]

_ENOUGH = 0.25  # effective share of the samples that needs no better proposal
_LIKELY = -1.6  # log of the bound of l(m, s) below which the component itself is not even tried
_LEAST = 3.0  # effective samples per dimension below which a sampled covariance is none
_ROUNDS = 2  # of proposals from the moments found so far
_WIDER = 2.0  # their covariance, times the one found
_NOTHING = -20.0  # log of a share that does not count
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
    _bounds(weights, means, covariances, slopes, biases, own, bounds)
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
        log, share = _pair(
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


@kernel
def _bounds(
    weights: FloatArray,
    means: FloatArray,
    covariances: FloatArray,
    slopes: FloatArray,
    biases: FloatArray,
    own: IntArray,
    out: FloatArray,
) -> None:
    """Upper bounds (n * s,) of log w_m + log l(m, s)."""
    centre = np.empty(means.shape[1])
    for m in range(means.shape[0]):
        for i in range(own.size):
            if weights[m] > 0.0:
                bound = _tilted(means[m], covariances[m], slopes, biases, own[i], centre)
                out[m * own.size + i] = np.log(weights[m]) + bound
            else:
                out[m * own.size + i] = -np.inf


@kernel
def _tilted(
    mean: FloatArray,
    covariance: FloatArray,
    slopes: FloatArray,
    biases: FloatArray,
    s: int,
    centre: FloatArray,
) -> float:
    """The upper bound of log l(m, s), and where the tilted Gaussian that attains it has its mean.

    log E[exp(t (y_s - y_r))] = t e + t^2 v / 2 is least at t = -e / v within 0..1; e and v are mean and
    variance of y_s - y_r. exp(t (y_s - y_r)) times the component is a Gaussian of mean + t P (w_s - w_r).
    """
    d = mean.size
    step, chosen = np.empty(d), 0
    least = 0.0
    tilt = 0.0
    for r in range(slopes.shape[0]):
        rise = biases[s] - biases[r]
        for a in range(d):
            step[a] = slopes[s, a] - slopes[r, a]
            rise += step[a] * mean[a]
        if rise < 0.0:
            variance = 0.0
            for a in range(d):
                for b in range(d):
                    variance += step[a] * covariance[a, b] * step[b]
            t = 1.0 if -rise >= variance else -rise / variance
            bound = t * (rise + 0.5 * t * variance)
            if bound < least:
                least, tilt, chosen = bound, t, r
    for a in range(d):
        centre[a] = mean[a]
        for b in range(d):
            centre[a] += tilt * covariance[a, b] * (slopes[s, b] - slopes[chosen, b])
    return least


@kernel
def _pair(
    mean: FloatArray,
    covariance: FloatArray,
    slopes: FloatArray,
    biases: FloatArray,
    s: int,
    units: FloatArray,
    furthest: float,
    columns: FloatArray,
    squares: FloatArray,
    propose: bool,
    likely: bool,
    out_mean: FloatArray,
    out_covariance: FloatArray,
    work: Work,
) -> tuple[float, float]:
    """log l(m, s) and the effective share of the samples; the moments into out_mean and out_covariance."""
    d = mean.size
    lower, precision = np.empty((d, d)), np.empty((d, d))
    factorise(covariance, lower)
    centre, spread = mean.copy(), lower.copy()
    if not propose or likely:
        log, share = _sampled(
            mean, lower, centre, spread, slopes, biases, s, units, furthest, out_mean, out_covariance, work
        )
        if not propose or share >= _ENOUGH:
            if share * units.shape[1] < _LEAST * d:
                out_covariance[:] = covariance
            return log, share
    inverse(lower, precision)
    bound = covariance.copy()
    _tilted(mean, covariance, slopes, biases, s, centre)
    variational(mean, precision, columns, squares, biases, s, centre, bound)
    log, share = _sampled(
        mean, lower, centre, spread, slopes, biases, s, units, furthest, out_mean, out_covariance, work
    )
    again_mean, again_covariance, wider = np.empty(d), np.empty((d, d)), np.empty((d, d))
    for _ in range(_ROUNDS):
        if share >= _ENOUGH:
            break
        # Few effective samples make a covariance that is too small: the variational one stands in.
        known = share * units.shape[1] >= _LEAST * d
        for a in range(d):
            centre[a] = out_mean[a]
            for b in range(d):
                wider[a, b] = _WIDER * (out_covariance[a, b] if known else bound[a, b])
        if not factorise(wider, spread):
            break
        again, better = _sampled(
            mean,
            lower,
            centre,
            spread,
            slopes,
            biases,
            s,
            units,
            furthest,
            again_mean,
            again_covariance,
            work,
        )
        if better <= share:
            break
        log, share = again, better
        out_mean[:], out_covariance[:] = again_mean, again_covariance
    if share * units.shape[1] < _LEAST * d:
        out_covariance[:] = bound
    return log, share


@kernel
def _sampled(
    mean: FloatArray,
    lower: FloatArray,
    centre: FloatArray,
    spread: FloatArray,
    slopes: FloatArray,
    biases: FloatArray,
    s: int,
    units: FloatArray,
    furthest: float,
    out_mean: FloatArray,
    out_covariance: FloatArray,
    work: Work,
) -> tuple[float, float]:
    """One round: samples x = centre + spread u, weights p(s | x) N(x) / q(x), their moments.

    N has `mean` and Cholesky factor `lower`; q has `centre` and `spread`. With z = lower^-1 (x - mean),
    log N / q = (|u|^2 - |z|^2) / 2 + log |spread| - log |lower|.
    """
    d, count = units.shape
    k = slopes.shape[0]
    base, tilt = np.empty(k), np.empty((k, d))
    for r in range(k):
        value = biases[r]
        for a in range(d):
            value += slopes[r, a] * centre[a]
            turn = 0.0
            for b in range(a, d):
                turn += slopes[r, b] * spread[b, a]
            tilt[r, a] = turn
        base[r] = value
    shift, twist = np.empty(d), np.empty((d, d))
    scale = 0.0
    for a in range(d):
        shift[a] = centre[a] - mean[a]
        for b in range(d):
            twist[a, b] = spread[a, b]
        for c in range(a):
            shift[a] -= lower[a, c] * shift[c]
            for b in range(d):
                twist[a, b] -= lower[a, c] * twist[c, b]
        shift[a] /= lower[a, a]
        for b in range(d):
            twist[a, b] /= lower[a, a]
        scale += np.log(spread[a, a] / lower[a, a])
    lines, top, total, value, row = work
    for i in range(count):
        value[i] = scale
        total[i] = 0.0
    for a in range(d):
        unit = units[a]
        for i in range(count):
            value[i] += 0.5 * unit[i] * unit[i]
            row[i] = shift[a]
        for b in range(d):
            t, other = twist[a, b], units[b]
            for i in range(count):
                row[i] += t * other[i]
        for i in range(count):
            value[i] -= 0.5 * row[i] * row[i]
    # Only sub-classes that come near the strongest somewhere among the samples count in the sum over all.
    best = np.argmax(base)
    active = 0
    for r in range(k):
        apart = 0.0
        for a in range(d):
            apart += (tilt[r, a] - tilt[best, a]) ** 2
        if r == s or base[r] - base[best] + np.sqrt(apart) * furthest > _NOTHING:
            line = lines[active]
            for i in range(count):
                line[i] = base[r]
            for a in range(d):
                t, unit = tilt[r, a], units[a]
                for i in range(count):
                    line[i] += t * unit[i]
            if r == s:
                for i in range(count):
                    value[i] += line[i]
            if active == 0:
                top[:] = line
            else:
                for i in range(count):
                    top[i] = max(top[i], line[i])
            active += 1
    for j in range(active):
        line = lines[j]
        for i in range(count):
            line[i] = exp_negative(line[i] - top[i])
        for i in range(count):
            total[i] += line[i]
    greatest = -np.inf
    for i in range(count):
        value[i] -= top[i]
        greatest = max(greatest, value[i])
    mass = 0.0
    square = 0.0
    for i in range(count):
        value[i] = exp_negative(value[i] - greatest) / total[i]
    for i in range(count):
        mass += value[i]
        square += value[i] * value[i]
    # Moments of u first, then of x = centre + spread u.
    first, second = np.empty(d), np.empty((d, d))
    for a in range(d):
        value_a = units[a]
        moment = 0.0
        for i in range(count):
            moment += value[i] * value_a[i]
        first[a] = moment / mass
        for b in range(a + 1):
            value_b = units[b]
            moment = 0.0
            for i in range(count):
                moment += value[i] * value_a[i] * value_b[i]
            second[a, b] = moment / mass
    for a in range(d):
        for b in range(a + 1):
            second[a, b] -= first[a] * first[b]
            second[b, a] = second[a, b]
    for a in range(d):
        place = centre[a]
        for b in range(a + 1):
            place += spread[a, b] * first[b]
        out_mean[a] = place
        for b in range(a + 1):
            moment = 0.0
            for e in range(a + 1):
                for f in range(b + 1):
                    moment += spread[a, e] * second[e, f] * spread[b, f]
            out_covariance[a, b] = moment
            out_covariance[b, a] = moment
    return greatest + np.log(mass / count), mass * mass / (square * count)
