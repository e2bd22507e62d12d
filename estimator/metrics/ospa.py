"""OSPA of two sets and OSPA(2) of two sets of tracks: errors per target, missed and false ones included."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from estimator.metrics.assignment import assigned, cut_off_gains, nearest_pairs
from estimator.metrics.gospa import check_order, checked_sets


@dataclass(frozen=True, slots=True)
class Ospa:
    """The OSPA metric and its parts; total^p = localisation^p + cardinality^p."""

    total: float  # metres, at most the cut-off
    localisation: float
    cardinality: float


def ospa(truth: FloatArray, estimates: FloatArray, *, c: float, p: float = 2.0) -> Ospa:
    """OSPA of estimates (d, k) for truth (d, n) with cut-off c (metres) and order p; 0 for two empty sets.

    Schuhmacher, Vo & Vo, "A consistent metric for performance evaluation of multi-object filters", IEEE
    Transactions on Signal Processing, 2008, eq. 3-4.

    Raises:
        ValueError: if c <= 0, p < 1, a number is not finite, or the dimensions differ.
    """
    check_order(c, p)
    truth, estimates = checked_sets(truth, estimates)
    finite, partners, distances = nearest_pairs(truth, estimates, c, p)
    if not finite:
        raise ValueError("truth, estimates: every number must be finite")
    saved = float(np.sum(c**p - distances[partners >= 0] ** p))
    return _of_saved(saved, truth.shape[1], estimates.shape[1], c, p)


def ospa2(truth: FloatArray, estimates: FloatArray, *, c: float, p: float = 1.0, q: float = 1.0) -> Ospa:
    """OSPA(2) of estimated tracks (k, d, t) for true tracks (n, d, t) over the t instants of a window.

    The distance of two tracks is the mean over the instants at which at least one of them exists: of
    min(c, distance)^q where both do, of c^q where one does, to the power 1/q; between such tracks, OSPA with
    the same cut-off. So a label that changes costs, as does a track that is lost for a while. NaN in every
    coordinate says that a track does not exist at an instant; one that never does in the window is no
    element of its set. Weights of the instants are equal.

    Beard, Vo & Vo, "OSPA(2): using the OSPA metric to evaluate multi-target tracking performance", 2017; "A
    solution for large-scale multi-object tracking", IEEE Transactions on Signal Processing, 2020, section V.

    Raises:
        ValueError: if c <= 0, p or q < 1, shapes differ, or a track has infinities or NaN in some coordinates
            of an instant only.
    """
    check_order(c, p)
    check_order(c, q)
    truth, estimates = _existing("truth", truth), _existing("estimates", estimates)
    if truth.shape[1:] != estimates.shape[1:]:
        raise ValueError(
            f"estimates: expected (k, d, t) with (d, t) {truth.shape[1:]}, got {estimates.shape}"
        )
    distances = track_distances(truth, estimates, c, q)
    gains = cut_off_gains(distances, c, p)
    rows, columns = assigned(gains)
    return _of_saved(float(gains[rows, columns].sum()), truth.shape[0], estimates.shape[0], c, p)


def track_distances(truth: FloatArray, estimates: FloatArray, c: float, q: float) -> FloatArray:
    """The distances (n, k) of tracks (n, d, t) and (k, d, t) that `ospa2` compares, each at most c."""
    here, there = ~np.isnan(truth[:, 0]), ~np.isnan(estimates[:, 0])
    out = np.zeros((len(truth), len(estimates)))
    for i, track in enumerate(truth):
        both, either = here[i] & there, here[i] | there  # (k, t)
        apart = np.sqrt(((estimates - track) ** 2).sum(axis=1))
        errors = np.where(both, np.minimum(apart, c) ** q, np.where(either, c**q, 0.0))
        out[i] = (errors.sum(axis=1) / np.maximum(either.sum(axis=1), 1)) ** (1 / q)
    return out


def _existing(name: str, tracks: FloatArray) -> FloatArray:
    """The tracks that exist at some instant."""
    tracks = np.asarray(tracks, dtype=np.float64)
    if tracks.ndim != 3 or tracks.shape[1] == 0:
        raise ValueError(f"{name}: expected tracks (n, d, t), got shape {tracks.shape}")
    absent = np.isnan(tracks)
    if np.isinf(tracks).any() or (absent.any(axis=1) != absent.all(axis=1)).any():
        raise ValueError(f"{name}: at an instant a track has finite coordinates or is NaN in all of them")
    kept = ~absent.all(axis=(1, 2)) if tracks.shape[2] else np.zeros(len(tracks), dtype=np.bool_)
    return tracks[kept]


def _of_saved(saved: float, n: int, k: int, c: float, p: float) -> Ospa:
    """OSPA of sets of n and k, where pairing has saved `saved` of c^p for each of the fewer."""
    larger, smaller = max(n, k), min(n, k)
    if larger == 0:
        return Ospa(0.0, 0.0, 0.0)
    near = max(c**p * smaller - saved, 0.0) / larger
    alone = c**p * (larger - smaller) / larger
    return Ospa((near + alone) ** (1 / p), near ** (1 / p), alone ** (1 / p))
