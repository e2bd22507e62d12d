"""Components a while later: the Kalman prediction, Bar-Shalom, Li & Kirubarajan (2001), section 5.2."""

import numpy as np

from estimator.arrays import FloatArray
from estimator.gaussian.components import Components
from estimator.kernels import kernel
from estimator.motion import Motion


def predicted(components: Components, motion: Motion, duration: float) -> Components:
    """The components `duration` seconds later: means F x, covariances F P F' + Q.

    Raises:
        ValueError: if duration is negative or not finite.
    """
    f, q = motion.transition(duration)
    if motion.is_static or duration == 0.0:
        return components
    means, covariances = np.empty_like(components.means), np.empty_like(components.covariances)
    _predict(components.means, components.covariances, f, q, means, covariances)
    return Components(components.weights, means, covariances)


@kernel
def _predict(
    means: FloatArray,
    covariances: FloatArray,
    f: FloatArray,
    q: FloatArray,
    out_means: FloatArray,
    out_covariances: FloatArray,
) -> None:
    k, n = means.shape
    half = np.empty((n, n))
    for i in range(k):
        for a in range(n):
            total = 0.0
            for b in range(n):
                total += f[a, b] * means[i, b]
            out_means[i, a] = total
        for a in range(n):
            for b in range(n):
                total = 0.0
                for c in range(n):
                    total += f[a, c] * covariances[i, c, b]
                half[a, b] = total
        for a in range(n):
            for b in range(a + 1):
                total = q[a, b]
                for c in range(n):
                    total += half[a, c] * f[b, c]
                out_covariances[i, a, b] = total
                out_covariances[i, b, a] = total
