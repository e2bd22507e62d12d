"""What a soft observation makes of an intensity.

Let v be the intensity of a Poisson process and p(x) the probability that a target at x is what the statement
says, independently of the others. No target is, with probability product(1 - p(x_i)), so "nothing is" leaves
a Poisson process of intensity (1 - p) v. "Something is" has the complement's likelihood. Its posterior is no
Poisson process; what a PHD filter keeps of it is the intensity, and with L the integral of p v this is

    v (1 - (1 - p) e^-L) / (1 - e^-L) = v (1 + p / (e^L - 1)).

Targets that were found and are no longer in v may be spoken of too. If none of them is with probability q,

    v (1 - q (1 - p) e^-L) / (1 - q e^-L) = v (1 + q p / (e^L - q)).

Both follow from E[sum_i delta(x - x_i) (1 - product_j(1 - p(x_j)))] by Campbell's theorem; the tests check
them against sampled point processes.
"""

import numpy as np

from estimator.arrays import FloatArray
from estimator.soft.statement import SoftObservation

_MANY = 700.0  # expected targets that agree, beyond which a statement says nothing; e^710 is too large


def agreeing(statement: SoftObservation, points: FloatArray) -> FloatArray:
    """p (n,): the probability of the statement's category at points (d, n)."""
    return np.asarray(statement.softmax.probabilities(points)[statement.category])


def share_of_something(expected: float, known: FloatArray | None) -> float:
    """The c of v (1 + c p): q / (e^L - q) with L = `expected`; 0 if the statement cannot have been said.

    known (f,) are p of the targets that were found and are not in v.
    """
    none = 1.0 if known is None else float(np.prod(1.0 - known))
    surplus = float(np.expm1(min(expected, _MANY))) + (1.0 - none)
    return none / surplus if surplus > 0.0 else 0.0


def factors(
    statement: SoftObservation, p: FloatArray, weights: FloatArray, known: FloatArray | None
) -> FloatArray:
    """By what (n,) to multiply an intensity given as weights (n,) at points where the statement has p (n,).

    Raises:
        ValueError: if the statement names a target: targets of an intensity have no names.
    """
    if statement.target is not None:
        raise ValueError(
            f"target: this filter knows no target {statement.target!r}; say something or nothing, or take "
            "the filter mixtures"
        )
    if not statement.positive:
        return np.asarray(1.0 - p)
    return np.asarray(1.0 + share_of_something(float(p @ weights), known) * p)
