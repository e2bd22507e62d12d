"""Tracks: labelled Bernoulli components with Gaussian mixtures."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.gaussian.components import Components
from estimator.kernels import kernel


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """n targets that may exist; track i has the components `offsets[i]:offsets[i + 1]`."""

    labels: IntArray  # (n,) identities, never given twice
    existence: FloatArray  # (n,) r, the probability that the target is there
    offsets: IntArray  # (n + 1,)
    components: Components  # weights sum to 1 in each track

    @staticmethod
    def none(state_size: int) -> "Tracks":
        """No track."""
        return Tracks(np.zeros(0, np.int64), np.zeros(0), np.zeros(1, np.int64), Components.none(state_size))

    @staticmethod
    def single(labels: IntArray, existence: FloatArray, means: FloatArray, spreads: FloatArray) -> "Tracks":
        """Tracks of one Gaussian each: means (n, n_x), covariances (n, n_x, n_x)."""
        n = labels.size
        return Tracks(labels, existence, np.arange(n + 1), Components(np.ones(n), means, spreads))

    @property
    def count(self) -> int:
        return int(self.labels.size)

    def owners(self) -> IntArray:
        """(k,) the track of each component."""
        return np.repeat(np.arange(self.count), np.diff(self.offsets))

    def chosen(self, which: IntArray) -> "Tracks":
        """Some of the tracks, by index, in that order."""
        counts = np.diff(self.offsets)[which]
        offsets = np.append(0, np.cumsum(counts))
        rows = np.repeat(self.offsets[which] - offsets[:-1], counts) + np.arange(offsets[-1])
        return Tracks(self.labels[which], self.existence[which], offsets, self.components.chosen(rows))

    def joined(self, other: "Tracks") -> "Tracks":
        """These tracks, then the other ones."""
        return Tracks(
            np.concatenate([self.labels, other.labels]),
            np.concatenate([self.existence, other.existence]),
            np.concatenate([self.offsets, self.offsets[-1] + other.offsets[1:]]),
            self.components.joined(other.components),
        )

    def moments(self, size: int) -> tuple[FloatArray, FloatArray]:
        """Mean (n, size) and covariance (n, size, size) of the first `size` numbers of each track's state."""
        means, covariances = np.zeros((self.count, size)), np.zeros((self.count, size, size))
        parts = self.components
        _moments(self.offsets, parts.weights, parts.means, parts.covariances, means, covariances)
        return means, covariances


@kernel
def _moments(
    offsets: IntArray,
    weights: FloatArray,
    means: FloatArray,
    covariances: FloatArray,
    out: FloatArray,
    spreads: FloatArray,
) -> None:
    size = out.shape[1]
    for i in range(offsets.size - 1):
        for k in range(offsets[i], offsets[i + 1]):
            for a in range(size):
                out[i, a] += weights[k] * means[k, a]
        for k in range(offsets[i], offsets[i + 1]):
            for a in range(size):
                for b in range(size):
                    step = (means[k, a] - out[i, a]) * (means[k, b] - out[i, b])
                    spreads[i, a, b] += weights[k] * (covariances[k, a, b] + step)
