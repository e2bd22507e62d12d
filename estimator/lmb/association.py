"""Which track made which measurement: marginal association probabilities over all joint associations.

A joint association gives each track at most one measurement and each measurement at most one track. With the
weight w_i0 of track i going unseen, w_ij of it making measurement j, and lambda_j of measurement j coming
from elsewhere (clutter, or a target never seen before), its probability is in proportion to the product of
psi_ij = w_ij / (w_i0 lambda_j) over its pairs. Tracks and measurements that no chain of pairs connects are
independent, and each such group is solved on its own:

- small groups exactly (`subsets`),
- others by loopy belief propagation (`propagation`) or Gibbs sampling (`gibbs`).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel
from estimator.lmb.gibbs import sample
from estimator.lmb.groups import transposed
from estimator.lmb.propagation import propagate
from estimator.lmb.subsets import solve_small

Method = Literal["lbp", "gibbs"]

_ITERATIONS = 1000
_TOLERANCE = 1e-7  # relative change of the messages at which belief propagation has converged
# Beyond this a track and a measurement belong together for all that float64 can tell. It keeps products over
# a group finite where there is neither clutter nor a way to go unseen, and every psi would be infinite.
CERTAIN = 1e30


@dataclass(frozen=True, slots=True)
class Pairs:
    """Track i may have made the measurements `columns[offsets[i]:offsets[i + 1]]`, and no others."""

    offsets: IntArray  # (n + 1,)
    columns: IntArray  # (p,) measurements, in 0..m-1, each at most once in a row
    psi: FloatArray  # (p,) w_ij / (w_i0 lambda_j), >= 0
    measurements: int  # m


@dataclass(frozen=True, slots=True)
class Marginals:
    """Probabilities over all joint associations."""

    pairs: FloatArray  # (p,) track i made measurement j
    unseen: FloatArray  # (n,) track i made none, or does not exist
    others: FloatArray  # (m,) measurement j was made by none of the tracks
    converged: bool  # whether belief propagation met its tolerance; True where it was not needed


def associated(
    pairs: Pairs,
    method: Method = "lbp",
    *,
    exact_up_to: int = 5,
    sweeps: int = 100,
    rng: np.random.Generator | None = None,
) -> Marginals:
    """The marginals of `pairs`.

    Groups whose smaller side has at most `exact_up_to` members are solved exactly, the others by `method`.
    `sweeps` and `rng` are for Gibbs sampling, which is the only user of random numbers.

    Raises:
        ValueError: if psi is negative or not a number, or Gibbs sampling has no generator.
    """
    psi = np.minimum(pairs.psi, CERTAIN)
    if psi.size and not psi.min() >= 0.0:
        raise ValueError("psi: expected numbers from 0 up")
    n, m = pairs.offsets.size - 1, pairs.measurements
    out = Marginals(np.zeros(psi.size), np.ones(n), np.ones(m), True)
    if psi.size == 0:
        return out
    by_column, entries = transposed(pairs.offsets, pairs.columns, m)
    left = np.zeros(n, np.bool_)
    solve_small(
        pairs.offsets, pairs.columns, psi, by_column, entries, exact_up_to, out.pairs, out.unseen, left
    )
    converged = True
    if left.any():
        if method == "lbp":
            converged = propagate(
                pairs.offsets, psi, by_column, entries, left, _ITERATIONS, _TOLERANCE, out.pairs, out.unseen
            )
        else:
            if rng is None:
                raise ValueError("rng: Gibbs sampling needs a generator")
            sample(
                pairs.offsets,
                pairs.columns,
                psi,
                by_column,
                entries,
                left,
                rng.random((max(sweeps, 1), n)),
                out.pairs,
                out.unseen,
            )
    _rest(pairs.columns, out.pairs, out.others)
    return Marginals(out.pairs, out.unseen, out.others, converged)


@kernel
def _rest(columns: IntArray, marginals: FloatArray, others: FloatArray) -> None:
    for p in range(columns.size):
        others[columns[p]] -= marginals[p]
    for j in range(others.size):
        others[j] = min(max(others[j], 0.0), 1.0)
