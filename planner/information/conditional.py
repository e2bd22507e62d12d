"""Entropy of one no-detection event given the targets, by Taylor terms with a bounded error, (21)-(24).

Dames & Kumar 2015 (see `entropy`), section III-C2. Given the targets, events are independent, so their
conditional entropies add up; (21), which writes likelihoods as a sum, is meant so. With
Z_k = E[p(y = 0 | X)^k] = exp(-k mu - sum_x w (1 - (1 - d)^k)), which is (16) with k copies of the event,

    H[y | X] = (mu + lambda beta) Z_1 + Z_1 - sum_{k >= 2} Z_k / (k (k - 1)).                       (23), (24)

The paper cuts the sum after its first ten terms. What it leaves out, sum_{k > K} Z_k / (k (k - 1)), is
bounded: Z_k falls with k, from Z_{K+1} towards the probability Z_inf that the event is empty for certain
(exp(-sum of w over d > 0) without clutter, else 0), and sum_{k > K} 1 / (k (k - 1)) = 1 / K. So the rest is
between Z_inf / K and Z_{K+1} / K. `Conditional.stated` is the paper's value; `value` subtracts the middle of
the bounds and is at most `error` off. Without it, a measurement that sees nothing would seem to lose 0.1.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from estimator.kernels import kernel
from planner.information.entropy import checked

TERMS = 10  # as in the paper


@dataclass(frozen=True, slots=True)
class Conditional:
    """H[y | X] of m events, in nats."""

    stated: FloatArray  # (m,) with the Taylor terms alone, never less than the truth
    value: FloatArray  # (m,) with the middle of the bounds of what they leave out
    error: FloatArray  # (m,) by which `value` is off at most


def conditional_entropies(
    detection: FloatArray, weights: FloatArray, clutter: FloatArray, terms: int = TERMS
) -> Conditional:
    """H[y | X] of each event on its own.

    Args:
        detection: (m, n) p_D of each point in each event.
        weights: (n,) expected targets at each point.
        clutter: (m,) mu, expected false measurements of each event.
        terms: of the Taylor series; k runs to this number.

    Raises:
        ValueError: if a shape does not fit, a number is out of its range, or there is not one term.
    """
    if terms < 1:
        raise ValueError(f"terms: expected at least 1, got {terms}")
    detection, weights, clutter = checked(detection, weights, clutter, most=2**31)
    stated, low, high = conditional_kernel(detection, weights, clutter, terms)
    return Conditional(stated, stated - 0.5 * (low + high), 0.5 * (high - low))


@kernel
def conditional_kernel(
    detection: FloatArray, weights: FloatArray, clutter: FloatArray, terms: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The paper's value, and the least and most (m,) that the terms left out can be."""
    m, n = detection.shape
    stated, low, high = np.empty(m), np.empty(m), np.empty(m)
    missed, rest = np.empty(n), np.empty(n)
    for i in range(m):
        seen, beta, visible = 0, 0.0, 0.0
        for x in range(n):
            d = detection[i, x]
            if d > 0.0 and weights[x] > 0.0:
                visible += weights[x]
                if d < 1.0:
                    beta -= weights[x] * (1.0 - d) * np.log(1.0 - d)
                missed[seen] = 1.0 - d
                rest[seen] = weights[x]
                seen += 1
        mu, total, last = clutter[i], 0.0, 0.0
        for k in range(1, terms + 2):
            left = 0.0
            for j in range(seen):
                rest[j] *= missed[j]
                left += rest[j]
            last = np.exp(-k * mu - (visible - left))
            if k == 1:
                total = (mu + beta) * last + last
            elif k <= terms:
                total -= last / (k * (k - 1.0))
        stated[i] = total
        high[i] = last / terms
        low[i] = np.exp(-visible) / terms if mu == 0.0 else 0.0
    return stated, low, high
