"""Beliefs to average, and what they say at a place."""

import numpy as np

from estimator.arrays import FloatArray
from estimator.averaging.attention import Attention
from estimator.averaging.belief import Belief, Size
from estimator.filter import Area
from estimator.undetected import Undetected

AREA = Area(np.zeros(2), np.full(2, 20.0))
ALL = Size(prune=0.0, merge_sigmas=0.0, most=10**6, points=10**6)  # nothing is lost


def belief(seed: int, components: int = 6, points: bool = False) -> Belief:
    """A random one: attention, undetected intensity and components have nothing to do with each other."""
    rng = np.random.default_rng(seed)
    factors = rng.normal(0.0, 0.7, (components, 2, 2))
    return Belief(
        weights=rng.uniform(0.05, 1.0, components),
        means=rng.uniform(1.0, 19.0, (components, 2)),
        covariances=None if points else factors @ factors.transpose(0, 2, 1) + 0.05 * np.eye(2),
        undetected=Undetected(rng.uniform(0.0, 0.05, (9, 9)), AREA),
        attention=Attention(rng.uniform(0.0, 5.0, (11, 11)) ** 2 + 1e-6, AREA),
    )


def intensity(belief: Belief, places: FloatArray) -> FloatArray:
    """v (n,) of a mixture at places (2, n), with the undetected part."""
    assert belief.covariances is not None
    out = belief.undetected.at(places)
    for w, m, p in zip(belief.weights, belief.means, belief.covariances, strict=True):
        away = places - m[:, None]
        square = np.sum(away * np.linalg.solve(p, away), axis=0)
        out += w * np.exp(-0.5 * square) / (2 * np.pi * np.sqrt(np.linalg.det(p)))
    return out


def moments(belief: Belief) -> tuple[float, FloatArray, FloatArray]:
    """Mass, mean and covariance of the detected part."""
    mass = float(belief.weights.sum())
    mean = belief.weights @ belief.means / mass
    away = belief.means - mean
    spread = np.einsum("k,ka,kb->ab", belief.weights, away, away) / mass
    if belief.covariances is not None:
        spread += np.einsum("k,kab->ab", belief.weights, belief.covariances) / mass
    return mass, mean, spread
