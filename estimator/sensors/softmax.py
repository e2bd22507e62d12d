"""Multimodal softmax: which of a few categories a place gives rise to, Ponda et al. 2012 (22).

p(category c | x) = sum_{s in c} exp(w_s . x + b_s) / sum_r exp(w_r . x + b_r). A category may have several
sub-classes; borders between sub-classes are straight, so a category can be any union of convex regions with
soft edges. Used for detectors that only say "seen" or "not seen", and for people's soft observations.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import exp_negative, kernel

_BLOCK = 256  # points worked on at once, so that their activations stay in the fastest cache


@dataclass(frozen=True, slots=True, eq=False)
class Softmax:
    """A softmax model of k sub-classes in c categories over points in d dimensions.

    Raises:
        ValueError: if shapes do not fit, a number is not finite, or a category has no sub-class.
    """

    weights: FloatArray  # (k, d) per metre
    biases: FloatArray  # (k,)
    class_of: IntArray  # (k,) category of each sub-class, 0..c-1

    def __post_init__(self) -> None:
        weights = np.ascontiguousarray(self.weights, dtype=np.float64)
        biases = np.ascontiguousarray(self.biases, dtype=np.float64)
        class_of = np.ascontiguousarray(self.class_of, dtype=np.int64)
        if weights.ndim != 2 or weights.size == 0:
            raise ValueError(f"weights: expected shape (k, d) with k, d >= 1, got {weights.shape}")
        if not np.isfinite(weights).all():
            raise ValueError("weights: every number must be finite")
        if biases.shape != weights.shape[:1]:
            raise ValueError(f"biases: expected shape ({len(weights)},), got {biases.shape}")
        if not np.isfinite(biases).all():
            raise ValueError("biases: every number must be finite")
        if class_of.shape != weights.shape[:1]:
            raise ValueError(f"class_of: expected shape ({len(weights)},), got {class_of.shape}")
        if not np.array_equal(np.unique(class_of), np.arange(class_of.max() + 1)):
            raise ValueError("class_of: expected categories 0..c-1, each with a sub-class")
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "biases", biases)
        object.__setattr__(self, "class_of", class_of)

    @staticmethod
    def polytope(normals: FloatArray, offsets: FloatArray, steepness: float) -> "Softmax":
        """Category 1 inside {x: normals . x <= offsets}, category 0 outside, with one sub-class per face.

        normals (k, d) point outwards and have length 1, offsets (k,) are in metres. At a face, far from the
        others, both categories have probability 1/2; steepness is the slope of the log-odds there, 1/m.

        Raises:
            ValueError: if a shape does not fit, or steepness is not a finite number above 0.
        """
        if not 0.0 < steepness < np.inf:
            raise ValueError(f"steepness: expected a finite number above 0, got {steepness}")
        normals, offsets = np.atleast_2d(normals), np.atleast_1d(offsets)
        if offsets.shape != normals.shape[:1]:
            raise ValueError(f"offsets: expected shape ({len(normals)},), got {offsets.shape}")
        weights = np.vstack([steepness * normals, np.zeros((1, normals.shape[1]))])
        biases = np.append(-steepness * offsets, 0.0)
        return Softmax(weights, biases, np.append(np.zeros(len(normals), np.int64), 1))

    @property
    def dimension(self) -> int:
        """d."""
        return int(self.weights.shape[1])

    @property
    def categories(self) -> int:
        """c."""
        return int(self.class_of.max()) + 1

    def placed(self, pose: FloatArray) -> "Softmax":
        """The model, given in a robot's axes (x ahead, y left(, z up)), in the world's for pose (4,).

        Raises:
            ValueError: if points have neither 2 nor 3 dimensions.
        """
        d = self.dimension
        if d not in (2, 3):
            raise ValueError(f"weights: a model in {d} dimensions has no pose")
        turn = np.eye(d)
        c, s = np.cos(pose[3]), np.sin(pose[3])
        turn[:2, :2] = [[c, -s], [s, c]]
        weights = self.weights @ turn.T
        return Softmax(weights, self.biases - weights @ pose[:d], self.class_of)

    def probabilities(self, points: FloatArray) -> FloatArray:
        """p(c | x) of every category (c, n) at points (d, n).

        Raises:
            ValueError: if the shape is another or a number is not finite.
        """
        points = self._checked(points)
        out = np.empty((self.categories, points.shape[1]))
        evaluate(points, self.weights, self.biases, self.class_of, out)
        return out

    def log_probability(self, points: FloatArray, category: int) -> FloatArray:
        """log p(category | x) (n,) at points (d, n); finite also where the probability underflows.

        Raises:
            ValueError: as `probabilities`, and if there is no such category.
        """
        points, own = self._checked(points), self._own(category)
        out = np.empty(points.shape[1])
        _log_probability(points, self.weights, self.biases, own, out)
        return out

    def log_gradient(self, points: FloatArray, category: int) -> FloatArray:
        """d log p(category | x) / dx (d, n): the category's mean weight less the mean weight of all.

        Raises:
            ValueError: as `log_probability`.
        """
        within, overall = self._shares(points, category)
        return np.asarray(self.weights.T @ (within - overall))

    def log_hessian(self, points: FloatArray, category: int) -> FloatArray:
        """Second derivatives (n, d, d): covariance of the category's weights less that of all weights.

        Raises:
            ValueError: as `log_probability`.
        """
        within, overall = self._shares(points, category)
        return np.asarray(_spread(self.weights, within) - _spread(self.weights, overall))

    def _shares(self, points: FloatArray, category: int) -> tuple[FloatArray, FloatArray]:
        """Each sub-class's share (k, n) in its category (0 in others), and in everything."""
        points, own = self._checked(points), self._own(category)
        activation = self.weights @ points + self.biases[:, None]
        overall = np.exp(activation - activation.max(axis=0))
        within = np.zeros_like(overall)
        within[own] = np.exp(activation[own] - activation[own].max(axis=0))
        return within / within.sum(axis=0), overall / overall.sum(axis=0)

    def _own(self, category: int) -> IntArray:
        own = np.flatnonzero(self.class_of == category)
        if own.size == 0:
            raise ValueError(f"category: expected 0..{self.categories - 1}, got {category}")
        return own

    def _checked(self, points: FloatArray) -> FloatArray:
        array = np.ascontiguousarray(points, dtype=np.float64)
        if array.ndim != 2 or array.shape[0] != self.dimension:
            raise ValueError(f"points: expected shape ({self.dimension}, n), got {array.shape}")
        if not np.isfinite(array).all():
            raise ValueError("points: every number must be finite")
        return array


def _spread(weights: FloatArray, shares: FloatArray) -> FloatArray:
    """Covariance (n, d, d) of weights (k, d) under shares (k, n)."""
    mean = shares.T @ weights
    second = np.einsum("kn,ka,kb->nab", shares, weights, weights, optimize=True)
    return np.asarray(second - mean[:, :, None] * mean[:, None, :])


@kernel
def _activate(
    points: FloatArray, begin: int, size: int, weights: FloatArray, biases: FloatArray, out: FloatArray
) -> None:
    """w_s . x + b_s of `size` points from `begin` on, out (k, _BLOCK)."""
    for s in range(weights.shape[0]):
        row, bias = out[s], biases[s]
        for i in range(size):
            row[i] = bias
        for a in range(weights.shape[1]):
            w, x = weights[s, a], points[a, begin : begin + size]
            for i in range(size):
                row[i] += w * x[i]


@kernel
def evaluate(
    points: FloatArray, weights: FloatArray, biases: FloatArray, class_of: IntArray, out: FloatArray
) -> None:
    """p(c | x) of points (d, n) into out (c, n)."""
    k = weights.shape[0]
    activation, top, total = np.empty((k, _BLOCK)), np.empty(_BLOCK), np.empty(_BLOCK)
    for begin in range(0, points.shape[1], _BLOCK):
        size = min(_BLOCK, points.shape[1] - begin)
        _activate(points, begin, size, weights, biases, activation)
        top[:size] = activation[0, :size]
        for s in range(1, k):
            row = activation[s]
            for i in range(size):
                top[i] = max(top[i], row[i])
        block = out[:, begin : begin + size]
        block[:] = 0.0
        total[:size] = 0.0
        for s in range(k):
            row, own = activation[s], block[class_of[s]]
            for i in range(size):
                row[i] = exp_negative(row[i] - top[i])
            for i in range(size):
                own[i] += row[i]
            for i in range(size):
                total[i] += row[i]
        for c in range(block.shape[0]):
            own = block[c]
            for i in range(size):
                own[i] /= total[i]


@kernel
def _log_probability(
    points: FloatArray, weights: FloatArray, biases: FloatArray, own: IntArray, out: FloatArray
) -> None:
    """Both sums are scaled by their own greatest term, so that neither vanishes."""
    k = weights.shape[0]
    activation = np.empty((k, _BLOCK))
    top, peak = np.empty(_BLOCK), np.empty(_BLOCK)
    total, part = np.empty(_BLOCK), np.empty(_BLOCK)
    for begin in range(0, points.shape[1], _BLOCK):
        size = min(_BLOCK, points.shape[1] - begin)
        _activate(points, begin, size, weights, biases, activation)
        top[:size], peak[:size] = activation[0, :size], activation[own[0], :size]
        for s in range(1, k):
            row = activation[s]
            for i in range(size):
                top[i] = max(top[i], row[i])
        for o in range(1, own.size):
            row = activation[own[o]]
            for i in range(size):
                peak[i] = max(peak[i], row[i])
        total[:size], part[:size] = 0.0, 0.0
        for s in range(k):
            row = activation[s]
            for i in range(size):
                total[i] += exp_negative(row[i] - top[i])
        for o in range(own.size):
            row = activation[own[o]]
            for i in range(size):
                part[i] += exp_negative(row[i] - peak[i])
        for i in range(size):
            out[begin + i] = peak[i] - top[i] + np.log(part[i] / total[i])
