"""Kullback-Leibler divergence of Gaussian mixtures, and the information gained of a team's targets.

Ponda et al. 2012, (24): KL(p(x | Z_k+1) || p(x | Z_k)), in nats. The paper has it by discretisation, which
limits the space; between mixtures there is no closed form. Here it is sampled, with its standard error, or
bounded and approximated in closed form (Goldberger, Gordon & Greenspan 2003; Hershey & Olsen 2007).
"""

from collections.abc import Sequence

import numpy as np

from estimator.arrays import FloatArray
from estimator.gaussian.components import Components


def kl_gaussian(mean: FloatArray, covariance: FloatArray, other_mean: FloatArray, other: FloatArray) -> float:
    """KL(N(mean, covariance) || N(other_mean, other)) in nats, of (d,) and (d, d); closed form.

    Raises:
        ValueError: if a shape does not fit, a number is not finite or a covariance is not positive definite.
    """
    p, q = _factor(covariance, "covariance"), _factor(other, "other")
    d = len(p)
    step = np.asarray(other_mean, dtype=np.float64) - np.asarray(mean, dtype=np.float64)
    if step.shape != (d,) or q.shape != p.shape or not np.isfinite(step).all():
        raise ValueError(f"mean, other_mean: expected finite numbers, shape ({d},), got {step.shape}")
    ratio, off = np.linalg.solve(q, p), np.linalg.solve(q, step)
    logs = np.log(np.diag(q)).sum() - np.log(np.diag(p)).sum()
    return float(0.5 * (np.sum(ratio**2) + off @ off - d) + logs)


def kl_sampled(
    mixture: Components, other: Components, samples: int, rng: np.random.Generator
) -> tuple[float, float]:
    """KL(mixture || other) in nats and its standard error, by Monte Carlo with `samples` draws.

    Draws are stratified: each component gets its share of them, so the stated error is an upper bound. The
    value may be below 0 by that error.

    Raises:
        ValueError: if a mixture has no weight, the state sizes differ, or samples is less than 2.
    """
    weights, others = _weights(mixture, "mixture"), _weights(other, "other")
    if mixture.state_size != other.state_size:
        raise ValueError(f"other: expected states of {mixture.state_size} numbers, got {other.state_size}")
    if samples < 2:
        raise ValueError(f"samples: expected at least 2, got {samples}")
    edges = np.cumsum(weights)
    edges[-1] = 1.0
    which = np.searchsorted(edges, (np.arange(samples) + rng.random()) / samples, side="left")
    lower = np.linalg.cholesky(mixture.covariances)
    units = rng.standard_normal((samples, mixture.state_size))
    points = mixture.means[which] + np.einsum("nab,nb->na", lower[which], units)
    values = _log_density(mixture, weights, points) - _log_density(other, others, points)
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(samples))


def kl_variational(mixture: Components, other: Components) -> float:
    """KL(mixture || other) in nats, Hershey & Olsen's (2007) variational approximation: closed form.

    Exact for single Gaussians and for equal mixtures; otherwise neither a bound nor exact: where the
    components of one mixture overlap it was off by some tenths of a nat (tests).

    Raises:
        ValueError: as `kl_sampled`.
    """
    weights, others = _weights(mixture, "mixture"), _weights(other, "other")
    same, across = _pairwise(mixture, mixture), _pairwise(mixture, other)
    top = _log_sum(np.log(np.maximum(weights, 1e-300))[None, :] - same)
    bottom = _log_sum(np.log(np.maximum(others, 1e-300))[None, :] - across)
    return float(weights @ (top - bottom))


def kl_matched(mixture: Components, other: Components) -> float:
    """Goldberger's (2003) matched approximation of KL(mixture || other), in nats.

    sum_a w_a min_b (KL(a || b) + log w_a / w_b): each component against the one that explains it best. It is
    an upper bound where the mixtures have the same weights and the matching is one to one.

    Raises:
        ValueError: as `kl_sampled`.
    """
    weights, others = _weights(mixture, "mixture"), _weights(other, "other")
    across = _pairwise(mixture, other)
    cost = across + np.log(np.maximum(weights, 1e-300))[:, None] - np.log(np.maximum(others, 1e-300))
    return float(weights @ cost.min(axis=1))


def information_gain(
    after: Sequence[Components], before: Sequence[Components], samples: int, rng: np.random.Generator
) -> tuple[float, float]:
    """(24) of independent targets (4) in nats, and its standard error: the sum over the targets.

    Raises:
        ValueError: if the numbers of targets differ, or as `kl_sampled`.
    """
    if len(after) != len(before):
        raise ValueError(f"after, before: {len(after)} and {len(before)} targets")
    values = [kl_sampled(a, b, samples, rng) for a, b in zip(after, before, strict=True) if a is not b]
    return sum(v for v, _ in values), float(np.sqrt(sum(e**2 for _, e in values)))


def _pairwise(mixture: Components, other: Components) -> FloatArray:
    """KL between every component of one and every one of the other, (n, m)."""
    if mixture.state_size != other.state_size:
        raise ValueError(f"other: expected states of {mixture.state_size} numbers, got {other.state_size}")
    out = np.empty((mixture.count, other.count))
    for i in range(mixture.count):
        for j in range(other.count):
            out[i, j] = kl_gaussian(
                mixture.means[i], mixture.covariances[i], other.means[j], other.covariances[j]
            )
    return out


def _log_density(mixture: Components, weights: FloatArray, points: FloatArray) -> FloatArray:
    """log of the mixture's density (n,) at points (n, n_x)."""
    logs = np.empty((len(points), mixture.count))
    for k in range(mixture.count):
        lower = np.linalg.cholesky(mixture.covariances[k])
        white = np.linalg.solve(lower, (points - mixture.means[k]).T)
        logs[:, k] = -0.5 * np.sum(white**2, axis=0) - np.log(np.diag(lower)).sum()
    logs += np.log(np.maximum(weights, 1e-300)) - 0.5 * mixture.state_size * np.log(2.0 * np.pi)
    return _log_sum(logs)


def _log_sum(logs: FloatArray) -> FloatArray:
    top = logs.max(axis=1)
    return np.asarray(top + np.log(np.exp(logs - top[:, None]).sum(axis=1)))


def _weights(mixture: Components, name: str) -> FloatArray:
    total = float(mixture.weights.sum())
    if not 0.0 < total < np.inf:
        raise ValueError(f"{name}: expected a finite weight above 0, got {total}")
    return np.asarray(mixture.weights / total)


def _factor(covariance: FloatArray, name: str) -> FloatArray:
    array = np.asarray(covariance, dtype=np.float64)
    try:
        if not np.isfinite(array).all():
            raise np.linalg.LinAlgError
        return np.asarray(np.linalg.cholesky(array))
    except np.linalg.LinAlgError:
        raise ValueError(f"{name}: expected a positive definite matrix") from None
