"""The components of a Gaussian mixture as plain arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """k weighted Gaussians over states of n_x numbers, positions first."""

    weights: FloatArray  # (k,) expected targets each, or probabilities
    means: FloatArray  # (k, n_x)
    covariances: FloatArray  # (k, n_x, n_x) symmetric, positive definite

    @staticmethod
    def none(state_size: int) -> "Components":
        """No component."""
        return Components(np.zeros(0), np.zeros((0, state_size)), np.zeros((0, state_size, state_size)))

    @property
    def count(self) -> int:
        return int(self.weights.size)

    @property
    def state_size(self) -> int:
        """n_x."""
        return int(self.means.shape[1])

    def positions(self, dimension: int) -> FloatArray:
        """The means' positions (d, k), contiguous, as sensors take points."""
        return np.ascontiguousarray(self.means[:, :dimension].T)

    def chosen(self, which: BoolArray | IntArray) -> "Components":
        """Some of the components, by flags (k,) or indices."""
        return Components(self.weights[which], self.means[which], self.covariances[which])

    def joined(self, other: "Components") -> "Components":
        """These components, then the other ones."""
        return Components(
            np.concatenate([self.weights, other.weights]),
            np.concatenate([self.means, other.means]),
            np.concatenate([self.covariances, other.covariances]),
        )

    def scaled(self, factor: float | FloatArray) -> "Components":
        """The same components with weights times a factor, or times one each."""
        return Components(self.weights * factor, self.means, self.covariances)


def checked(weights: FloatArray, means: FloatArray, covariances: FloatArray) -> Components:
    """Components of arrays that come from outside.

    Raises:
        ValueError: if shapes do not fit, a number is not finite, a weight is negative, or a covariance is not
            symmetric and positive definite; names the argument.
    """
    w = np.ascontiguousarray(weights, dtype=np.float64)
    x = np.ascontiguousarray(means, dtype=np.float64)
    p = np.ascontiguousarray(covariances, dtype=np.float64)
    if w.ndim != 1 or not np.isfinite(w).all() or (w < 0.0).any():
        raise ValueError("weights: expected finite numbers from 0 up, shape (k,)")
    if x.ndim != 2 or len(x) != w.size or not np.isfinite(x).all():
        raise ValueError(f"means: expected finite numbers, shape ({w.size}, n_x), got shape {x.shape}")
    if p.shape != (w.size, x.shape[1], x.shape[1]) or not np.isfinite(p).all():
        raise ValueError(
            f"covariances: expected finite numbers, shape {(w.size, x.shape[1], x.shape[1])}, "
            f"got shape {p.shape}"
        )
    if not np.allclose(p, np.swapaxes(p, 1, 2), rtol=1e-9, atol=0.0):
        raise ValueError("covariances: expected symmetric matrices")
    wrong = first_indefinite(p)
    if wrong >= 0:
        raise ValueError(f"covariances: number {wrong} is not positive definite")
    return Components(w, x, p)


def moments_of(mixture: Components) -> tuple[FloatArray, FloatArray]:
    """Mean (2) and covariance (3) of a mixture of weights of sum 1."""
    mean = mixture.weights @ mixture.means
    off = mixture.means - mean
    covariance = np.einsum("k,kab->ab", mixture.weights, mixture.covariances)
    return mean, covariance + (off * mixture.weights[:, None]).T @ off


def stacked(mixtures: Sequence[Components]) -> Components:
    """All components of several mixtures, one mixture after the other."""
    return Components(
        np.concatenate([m.weights for m in mixtures]),
        np.concatenate([m.means for m in mixtures]),
        np.concatenate([m.covariances for m in mixtures]),
    )


@kernel
def factorise(matrix: FloatArray, factor: FloatArray) -> bool:
    """The lower Cholesky factor (n, n) of a matrix (n, n); False if it is not positive definite."""
    n = matrix.shape[0]
    for a in range(n):
        for b in range(a + 1):
            value = matrix[a, b]
            for c in range(b):
                value -= factor[a, c] * factor[b, c]
            if a == b:
                if not value > 0.0 or value == np.inf:
                    return False
                factor[a, a] = np.sqrt(value)
            else:
                factor[a, b] = value / factor[b, b]
                factor[b, a] = 0.0
    return True


@kernel
def first_indefinite(matrices: FloatArray) -> int:
    """Index of the first of the matrices (k, n, n) that is not positive definite; -1 if all are."""
    factor = np.empty((matrices.shape[1], matrices.shape[2]))
    for i in range(matrices.shape[0]):
        if not factorise(matrices[i], factor):
            return i
    return -1


@kernel
def sigma_points(means: FloatArray, covariances: FloatArray, owners: IntArray, points: FloatArray) -> int:
    """Fills points (d, k (2 d + 1)): of each Gaussian its mean, then mean +- sqrt(3) L e_b for each axis b.

    Its covariance is `covariances[owners[i]]`. With weights 1 - d / 3 and 1 / 6, means of polynomials up to
    the third degree are exact. Returns the index of a covariance that is not positive definite, or -1.
    """
    d, each = points.shape[0], 2 * points.shape[0] + 1
    factor = np.empty((d, d))
    reach, last = np.sqrt(3.0), -1
    for i in range(means.shape[0]):
        if owners[i] != last:  # those of one owner lie together
            last = owners[i]
            if not factorise(covariances[last, :d, :d], factor):
                return int(last)
        for a in range(d):
            points[a, i * each] = means[i, a]
            for b in range(d):
                points[a, i * each + 1 + 2 * b] = means[i, a] + reach * factor[a, b]
                points[a, i * each + 2 + 2 * b] = means[i, a] - reach * factor[a, b]
    return -1
