"""The exact multi-target Bayes update on a handful of places, by summing over every set of targets.

Nothing of the filters' formulas is in here: only the standard multi-target likelihood (Mahler, "Statistical
Multisource-Multitarget Information Fusion", 2007, section 12.3) and Bayes' rule, for checking them.
"""

from itertools import combinations_with_replacement
from math import factorial
from typing import NamedTuple

import numpy as np

from estimator.arrays import FloatArray


class Sighting(NamedTuple):
    """One sensor's set of m measurements, as seen from n places."""

    detection: FloatArray  # (n,) p_D
    likelihood: FloatArray  # (m, n) g
    clutter: FloatArray  # (m,) c


def set_likelihood(places: tuple[int, ...], sighting: Sighting) -> float:
    """f(Z | X) up to a constant, X being targets at some of the places: all ways to explain Z."""

    def explained(targets: tuple[int, ...], left: tuple[int, ...]) -> float:
        if not targets:
            return float(np.prod(sighting.clutter[list(left)]))
        x, rest = targets[0], targets[1:]
        p = sighting.detection[x]
        total = (1.0 - p) * explained(rest, left)
        for j in left:
            without = tuple(k for k in left if k != j)
            total += p * sighting.likelihood[j, x] * explained(rest, without)
        return total

    return explained(places, tuple(range(len(sighting.clutter))))


def posterior_intensity(prior: FloatArray, sightings: list[Sighting], most: int = 6) -> FloatArray:
    """Expected number of targets at each place (n,) after all sightings at once, of a Poisson prior (n,).

    Sets of more than `most` targets are left out: choose a prior for which they do not matter.
    """
    n, evidence, expected = prior.size, 0.0, np.zeros(prior.size)
    for count in range(most + 1):
        for places in combinations_with_replacement(range(n), count):
            value = 1.0
            for x in set(places):
                value *= float(prior[x]) ** places.count(x) / factorial(places.count(x))
            for sighting in sightings:
                value *= set_likelihood(places, sighting)
            evidence += value
            for x in places:
                expected[x] += value
    return expected / evidence
