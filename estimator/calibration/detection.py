"""p_D from who was seen and who was not: a table over the range, and the opening of the field of view."""

import numpy as np

from estimator.arrays import FloatArray

_ROUNDS = 400
DEGREE = np.pi / 180.0


def hats(ranges: FloatArray, breaks: FloatArray) -> FloatArray:
    """(k, b) how much each break counts in a piecewise linear table at ranges (k,); rows sum to 1."""
    clipped = np.clip(ranges, breaks[0], breaks[-1])
    after = np.clip(np.searchsorted(breaks, clipped, side="right"), 1, len(breaks) - 1)
    share = (clipped - breaks[after - 1]) / (breaks[after] - breaks[after - 1])
    out = np.zeros((len(ranges), len(breaks)))
    rows = np.arange(len(ranges))
    out[rows, after - 1] = 1.0 - share
    out[rows, after] = share
    return out


def fit_table(trials: FloatArray, hits: FloatArray, basis: FloatArray) -> FloatArray:
    """Gains (..., b) of a piecewise linear p_D from trials and hits (..., k) in k bins, basis (k, b).

    p = sum_b h_b g_b is the probability of a hit if first a break b is drawn with probability h_b and then a
    coin that shows a hit with g_b. Which break was drawn is unknown, so that expectation-maximisation gives
    the maximum-likelihood gains; they stay within 0..1. Where nothing was tried a gain is NaN.
    """
    misses = trials - hits
    gains = np.full((*trials.shape[:-1], basis.shape[1]), 0.5)
    for _ in range(_ROUNDS):
        p = gains @ basis.T
        hit = gains * ((hits / np.maximum(p, 1e-300)) @ basis)
        miss = (1.0 - gains) * ((misses / np.maximum(1.0 - p, 1e-300)) @ basis)
        total = hit + miss
        gains = np.where(total > 0.0, hit / np.where(total > 0.0, total, 1.0), 0.5)
    return np.where(trials @ basis > 0.5, gains, np.nan)


def fit_opening(
    trials: FloatArray, hits: FloatArray, near: tuple[float, float] | None = None
) -> tuple[float, float]:
    """The edges (radians from the heading) of the bearings in which targets are seen, by maximum likelihood.

    trials and hits (360,) count in bins of one degree from -180 on. The probability of a hit is one number
    within the edges and another, smaller one, outside. (-pi, pi) if that explains little more than one
    probability all around does. With `near` only edges within 12 degrees of these are tried.
    """
    lows, highs = (slice(None),) * 2 if near is None else (_around(edge) for edge in near)
    n = np.concatenate([[0.0], np.cumsum(trials)])
    k = np.concatenate([[0.0], np.cumsum(hits)])
    inner_n, inner_k = n[highs] - n[lows, None], k[highs] - k[lows, None]  # [low, high]
    outer_n, outer_k = n[-1] - inner_n, k[-1] - inner_k
    gain = _binomial(inner_n, inner_k) + _binomial(outer_n, outer_k)
    better = (inner_k * outer_n > outer_k * inner_n) & (inner_n > 0.0) & (outer_n > 0.0)
    gain = np.where(better, gain, -np.inf)
    low, high = np.unravel_index(np.argmax(gain), gain.shape)
    if not gain[low, high] > _binomial(n[-1:], k[-1:])[0] + 20.0:
        return -np.pi, np.pi
    low, high = low + (lows.start or 0), high + (highs.start or 0)
    return float(low - 180) * DEGREE, float(high - 180) * DEGREE


def fit_reach(trials: FloatArray, hits: FloatArray) -> int:
    """In how many of the first bins (k,) over the range targets are seen; beyond, hits are accidents.

    Each bin within reach has a probability of its own, all beyond it share one. By the Bayesian information
    criterion (Schwarz 1978).
    """
    free = np.concatenate([[0.0], np.cumsum(_binomial(trials, hits))])
    beyond_n = np.concatenate([np.cumsum(trials[::-1])[::-1], [0.0]])
    beyond_k = np.concatenate([np.cumsum(hits[::-1])[::-1], [0.0]])
    price = 0.5 * np.log(max(float(trials.sum()), 1.0)) * np.arange(len(trials) + 1)
    return int(np.argmax(free + _binomial(beyond_n, beyond_k) - price))


def _around(edge: float) -> slice:
    middle = round(edge / DEGREE) + 180
    return slice(max(0, middle - 12), min(361, middle + 13))


def _binomial(n: FloatArray, k: FloatArray) -> FloatArray:
    """The greatest log-likelihood of k hits in n trials."""
    with np.errstate(divide="ignore", invalid="ignore"):
        p = k / n
        value = k * np.log(p) + (n - k) * np.log1p(-p)
    return np.where((k > 0.0) & (k < n), value, 0.0)
