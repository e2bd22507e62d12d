"""Random numbers inside kernels: a stream for every path, whichever thread makes it."""

import numpy as np

from estimator.kernels import exact_kernel


@exact_kernel
def scrambled(seed: np.uint64) -> np.uint64:
    """SplitMix64 of a seed: streams of neighbouring seeds have nothing in common. Never 0."""
    z = seed + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return z if z != np.uint64(0) else np.uint64(1)


@exact_kernel
def shifted(x: np.uint64) -> np.uint64:
    """The next state of xorshift64 (Marsaglia 2003)."""
    x ^= x << np.uint64(13)
    x ^= x >> np.uint64(7)
    x ^= x << np.uint64(17)
    return x


@exact_kernel
def below(x: np.uint64, n: int) -> int:
    """A number 0..n-1 from the upper half of a state."""
    return int(np.int64(((x >> np.uint64(32)) * np.uint64(n)) >> np.uint64(32)))
