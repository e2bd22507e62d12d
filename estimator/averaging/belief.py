"""Arithmetic-average fusion of intensities of robots that looked at different places.

Neighbours k with averaging weights m_k (sum 1) and attentions a_k(x) (`attention`) give

    a(x) = sum_k m_k a_k(x),    v(x) = sum_k m_k a_k(x) v_k(x) / a(x).                                  (1)

At each place v is a convex combination of the v_k, so
- averaging equal intensities changes nothing: information that comes back on another way, or comes twice, is
  not counted twice, whatever the weights are and however the robots' errors depend on each other;
- no place gets more than the most that somebody believed, none less than the least;
- the numerators a_k v_k and the attentions a_k are averaged linearly. With doubly stochastic weights
  (`consensus.metropolis`) their sums over the team never change, and repeated averaging drives every robot
  to sum_k a_k v_k / sum_k a_k: each place as those believe who looked there, by how much they did.

The arithmetic average of intensities: Mahler 2009; Li, Corchado & Sun, "Partial consensus and conservative
fusion of Gaussian mixtures for distributed PHD fusion", IEEE Transactions on Aerospace and Electronic
Systems, 2019; weights by place for different fields of view: Yi, Li, Wang, Hoseinnezhad & Kong, "Distributed
multi-sensor fusion of PHD filters with different sensor coverage", 2020; Gostar et al., "Cooperative sensor
fusion in centralized sensor networks using Cauchy-Schwarz divergence", 2020. None has (1): there the weights
follow from the present fields of view, here from all looks, which consensus itself can carry, derived anew.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.averaging.attention import Attention
from estimator.gaussian.components import Components
from estimator.gaussian.reduction import reduced
from estimator.kernels import kernel
from estimator.smc.resampling import systematic
from estimator.undetected import Undetected


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """One robot's intensity in the form that all filters share, and where it comes from.

    The detected part is a Gaussian mixture, or weighted points where `covariances` is None.
    """

    weights: FloatArray  # (k,) expected targets each
    means: FloatArray  # (k, n_x) states, positions first; or points
    covariances: FloatArray | None  # (k, n_x, n_x)
    undetected: Undetected
    attention: Attention

    @property
    def mass(self) -> float:
        """The expected number of targets."""
        return float(self.weights.sum()) + self.undetected.mass()

    def positions(self) -> FloatArray:
        """(d, k) of the components or points."""
        return np.ascontiguousarray(self.means[:, : self.undetected.area.dimension].T)


@dataclass(frozen=True, slots=True)
class Size:
    """How much a belief may hold after averaging. Mass is kept but for what is pruned."""

    prune: float = 1e-6  # components of less mass are dropped
    merge_sigmas: float = 1.0  # components nearer than this become one, with their common moments
    most: int = 500  # components
    points: int = 20_000  # more points than this are resampled to this many, of equal weight


def average(beliefs: Sequence[Belief], shares: FloatArray, size: Size | None = None) -> Belief:
    """Equation (1) of several robots' beliefs with averaging weights `shares` (r,), then reduced to `size`.

    Grids must be the same for all. A component or point is weighed by the attention at its mean.

    Raises:
        ValueError: if there is no belief, shares are not one per belief, from 0 up and with sum 1, grids
            differ, or some beliefs are points and some are not; names the argument.
    """
    shares = np.asarray(shares, dtype=np.float64)
    if not beliefs or shares.shape != (len(beliefs),):
        raise ValueError(f"shares: expected one for each of {len(beliefs)} beliefs, got shape {shares.shape}")
    if not ((shares >= 0.0).all() and abs(shares.sum() - 1.0) < 1e-9):
        raise ValueError("shares: expected numbers from 0 up that add up to 1")
    first = beliefs[0]
    _check_alike(beliefs)
    taken = [(belief, share) for belief, share in zip(beliefs, shares, strict=True) if share > 0.0]
    values = sum((share * belief.attention.values for belief, share in taken), np.zeros(()))
    attention = Attention(np.asarray(values), first.attention.area)
    weights, means, covariances = [], [], []
    for belief, share in taken:
        if belief.weights.size:
            places = belief.positions()
            weights.append(belief.weights * share * belief.attention.at(places) / attention.at(places))
            means.append(belief.means)
            covariances.append(belief.covariances)
    fused = Belief(
        weights=np.concatenate(weights) if weights else first.weights[:0],
        means=np.concatenate(means) if means else first.means[:0],
        covariances=_joined(first, covariances),
        undetected=_undetected(taken, attention),
        attention=attention,
    )
    return shrunk(fused, size or Size())


def shrunk(belief: Belief, size: Size) -> Belief:
    """The belief with at most so many components or points; equal ones become one."""
    if belief.covariances is None:
        weights, means = _without_twins(belief.weights, belief.means)
        if weights.size > size.points:
            chosen = systematic(weights, size.points, 0.5)
            means = means[chosen]
            weights = np.full(size.points, weights.sum() / size.points)
        return replace(belief, weights=weights, means=means)
    few = reduced(
        Components(belief.weights, belief.means, belief.covariances),
        prune=size.prune,
        merge_sigmas=size.merge_sigmas,
        most=size.most,
        mutual=True,
    )
    return replace(belief, weights=few.weights, means=few.means, covariances=few.covariances)


def _undetected(taken: Sequence[tuple[Belief, float]], attention: Attention) -> Undetected:
    """(1) of the undetected parts, at their nodes; of their directions of motion too, where all have them."""
    first = taken[0][0].undetected
    places = first.nodes()
    weights = [
        (share * belief.attention.at(places) / attention.at(places)).reshape(first.values.shape)
        for belief, share in taken
    ]
    values = sum((w * b.undetected.values for w, (b, _) in zip(weights, taken, strict=True)), np.zeros(()))
    directions = [b.undetected.parts for b, _ in taken if b.undetected.parts is not None]
    parts = None
    if len(directions) == len(taken):
        parts = np.asarray(sum((w * p for w, p in zip(weights, directions, strict=True)), np.zeros(())))
    return replace(
        first,
        values=np.asarray(values),
        parts=parts,
        travelled=first.travelled if parts is not None else (),
    )


def _joined(first: Belief, covariances: Sequence[FloatArray | None]) -> FloatArray | None:
    if first.covariances is None:
        return None
    parts = [part for part in covariances if part is not None]
    return np.concatenate(parts) if parts else first.covariances[:0]


def _check_alike(beliefs: Sequence[Belief]) -> None:
    """That beliefs can be averaged.

    Raises:
        ValueError: if not.
    """
    first = beliefs[0]
    for i, other in enumerate(beliefs[1:], 1):
        for name in ("undetected", "attention"):
            one, two = getattr(first, name), getattr(other, name)
            same = one.values.shape == two.values.shape
            if not (same and np.array_equal(one.area.low, two.area.low)):
                raise ValueError(f"beliefs: the {name} grid of number {i} is not that of the first")
            if not np.array_equal(one.area.high, two.area.high):
                raise ValueError(f"beliefs: the area of number {i} is not that of the first")
        if (first.covariances is None) != (other.covariances is None):
            raise ValueError("beliefs: some are points and some are Gaussians; let all be of one kind")
        if first.means.shape[1] != other.means.shape[1]:
            raise ValueError(f"beliefs: states of number {i} have {other.means.shape[1]} numbers")


def _without_twins(weights: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weights (k,) and points (k, n_x) in which points that are equal to the last bit are one."""
    if weights.size == 0:
        return weights, points
    order = np.lexsort(points.T[::-1])
    firsts = _first_of_equals(points, order)
    keep = np.flatnonzero(firsts == np.arange(weights.size))
    return np.asarray(np.bincount(firsts, weights, weights.size)[keep], np.float64), points[keep]


@kernel
def _first_of_equals(points: FloatArray, order: IntArray) -> IntArray:
    """For each point (k, n_x) the least index of a point equal to it, given a stable sorting order."""
    firsts = np.empty(order.size, np.int64)
    leader = order[0]
    for t in range(order.size):
        i = order[t]
        for a in range(points.shape[1]):
            if points[i, a] != points[leader, a]:
                leader = i
                break
        firsts[i] = leader
    return firsts
