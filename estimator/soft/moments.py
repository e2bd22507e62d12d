"""One component times one sub-class of a softmax: mass, mean and covariance by importance sampling.

`estimator.soft.importance` says when which proposal is taken.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.gaussian.components import factorise
from estimator.kernels import exp_negative, kernel
from estimator.soft.variational import inverse, variational

Work = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]

_ENOUGH = 0.25  # effective share of the samples that needs no better proposal
_LEAST = 3.0  # effective samples per dimension below which a sampled covariance is none
_ROUNDS = 2  # of proposals from the moments found so far
_WIDER = 2.0  # their covariance, times the one found
_NOTHING = -20.0  # log of a share that does not count


@kernel
def bounds_of(
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
def pair(
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
