"""Clutter from the measurements that came from nothing: how many a set, and where they crowd."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from estimator.calibration.resampling import Interval
from estimator.sensors.range_bearing import wrapped

_BINS = 360
_WIDEST = 92  # degrees
_AT_MOST = 4


@dataclass(frozen=True, slots=True)
class Peak:
    """A window of bearings in which clutter is denser than around it."""

    centre: float  # radians from the heading
    width: float  # radians
    share: float  # of all clutter, beyond what lies there evenly


def poisson_interval(count: float, exposure: float) -> Interval:
    """95% interval of a rate of which `count` events were seen in `exposure` sets (Garwood 1936)."""
    from scipy.stats import gamma  # noqa: PLC0415 - slow to import

    low = float(gamma.ppf(0.025, count)) if count > 0.0 else 0.0
    return low / exposure, float(gamma.ppf(0.975, count + 1.0)) / exposure


def fit_symmetric_peaks(counts: FloatArray, opening: float) -> tuple[float, float]:
    """Share of the uniform part, and width (radians) of two equal peaks at +-90 degrees, of clutter `counts`.

    Dames & Kumar (31), by maximum likelihood over the width. counts (360,) are by degree from -180 on, of
    which those within the opening (radians, about the heading) are looked at. (1, nan) where two peaks do
    not explain the clutter by 6 nats better than none.
    """
    off = np.abs(np.arange(_BINS) - 179.5)
    within = off <= np.degrees(opening) / 2
    total, span = float(counts[within].sum()), float(np.count_nonzero(within))
    even = float(_log(np.array(total), total, span))
    best, found = even + 6.0, (1.0, float("nan"))
    for half in range(1, 91):
        box = within & (np.abs(off - 90.0) < half)
        size, inside = float(np.count_nonzero(box)), counts[box].sum()
        if size >= span or size < 4 * half or inside * span <= total * size:
            continue
        value = float(_log(inside, total, size) + _log(total - inside, total, span - size))
        if value > best:
            best, found = value, ((total - inside) / (span - size) * span / total, np.radians(2.0 * half))
    return found


def find_peaks(counts: FloatArray, opening: float) -> tuple[Peak, ...]:
    """Where clutter crowds over the bearing: counts (360,) by degree from -180 on; at most four windows.

    Only bearings within the opening (radians, about the heading) are looked at.
    A scan of windows of several widths by their likelihood ratio against evenness (Kulldorff, "A spatial scan
    statistic", 1997), the best first. 12 nats or more are taken: about one in 10^4 even recordings has them.
    """
    peaks: list[Peak] = []
    taken = np.abs(np.arange(_BINS) - 179.5) > np.degrees(opening) / 2
    for _ in range(_AT_MOST):
        total, span = float(counts[~taken].sum()), float(np.count_nonzero(~taken))
        best, window = 12.0, None
        for width in range(3, min(_WIDEST, int(span)), 2):
            inside = _windows(np.where(taken, 0.0, counts), width)
            usable = (_windows(taken.astype(np.float64), width) == 0.0) & (inside * span > total * width)
            value = _log(inside, total, width) + _log(total - inside, total, span - width)
            value = np.where(usable, value - _log(np.array(total), total, span), -np.inf)
            if value.max() > best:
                best, window = float(value.max()), (int(value.argmax()), width)
        if window is None:
            break
        centre, width = window
        at = (centre + np.arange(width) - width // 2) % _BINS
        extra = counts[at].sum() - (total - counts[at].sum()) / (span - width) * width
        angle = float(wrapped(np.radians(np.array(centre - 179.5))))
        peaks.append(Peak(angle, float(np.radians(width)), float(extra / counts.sum())))
        taken[at] = True
    return tuple(peaks)


def _windows(values: FloatArray, width: int) -> FloatArray:
    """(360,) sums over `width` (odd) bins around each, all the way round."""
    half = width // 2
    sums = np.cumsum(np.concatenate([[0.0], values[-half:], values, values[:half]]))
    return np.asarray(sums[width:] - sums[:-width])


def _log(inside: FloatArray, total: float, size: float) -> FloatArray:
    """inside log(density), the density being inside / (total size)."""
    some = np.maximum(inside, 1e-300)
    return np.where(inside > 0.0, some * np.log(some / (max(total, 1e-300) * size)), 0.0)
