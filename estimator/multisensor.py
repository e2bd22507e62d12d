"""The PHD corrector of several sensors at once, whose result does not depend on their order.

The iterated corrector applies sensors one after another and takes the intensity in between for Poisson again,
which it is not: so the order matters. The exact corrector of a Poisson prior (Mahler, "The multisensor PHD
filter: I. General solution via multitarget calculus", Proceedings of SPIE 7336, 2009; in this form Nannuru,
Blouin, Coates & Rabbat, "Multisensor CPHD filter", IEEE Transactions on Aerospace and Electronic Systems,
2016) sums over the partitions of all measurements into subsets W that one target each may have caused, with
at most one measurement of each sensor:

    v'(x) = v(x) (b_0(x) + sum_W a_W b_W(x)),
    b_W(x) = prod_{s in W} p_s g_s(z_s | x) prod_{s not in W} (1 - p_s),
    a_W = F(Z \\ W) / F(Z),   F(U) = sum over partitions of U of prod_W d_W,
    d_W = integral of v b_W, and the clutter intensity c(z) on top for W = {z}.

The papers choose partitions greedily; here `estimator.partitions` sums over all of them, group by group.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel
from estimator.partitions import (
    MOST,
    Groups,
    Terms,
    Touching,
    coefficients,
    grouped,
    summed,
    terms,
    with_clutter,
)
from estimator.sensor import Look, SensorModel, checked_poses, validated

_NONE, _EMPTY = np.zeros(0, np.int64), np.zeros(0)


@dataclass(frozen=True, slots=True, eq=False)
class Take:
    """What one sensor measured at the time in question."""

    sensor: SensorModel
    pose: FloatArray  # (4,)
    measurements: FloatArray  # (m, s)


def checked_take(take: Take) -> Take:
    """The take with arrays as kernels want them.

    Raises:
        ValueError: if the pose or the measurements have another shape or are not finite; names them.
    """
    measurements = validated(take.measurements, take.sensor.measurement_size)
    return Take(take.sensor, checked_poses(take.pose)[0], measurements)


def jointly_corrected(weights: FloatArray, looks: Sequence[Look], most: int = MOST) -> FloatArray:
    """Posterior weights (n,) of points with prior weights (n,) after several sensors' looks at one time.

    With one look it is the corrector of `estimator.smc.correction`. Any order of the looks gives the same.

    Raises:
        ValueError: if there is not one weight per point of each look.
    """
    seen = Seen.by(weights, looks)
    groups = grouped([seen.touching], seen.sensors, most)
    found, values = seen.terms(weights, groups)
    totals = with_clutter(summed(values, found.slots, groups.slots), seen.clutter, groups)
    shares = coefficients(totals, groups)[found.slots]
    return seen.unseen(weights) + summed(values * shares, found.owners, weights.size)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """The looks of q sensors at n points, put together."""

    touching: Touching
    gains: FloatArray  # (e,) p_D g of each entry
    missed: FloatArray  # (q, n) 1 - p_D
    sensors: IntArray  # (M,) of each measurement
    clutter: FloatArray  # (M,)

    @staticmethod
    def by(weights: FloatArray, looks: Sequence[Look]) -> "Seen":
        """Of points with weights (n,).

        Raises:
            ValueError: if there is not one weight per point of each look.
        """
        missed = np.ones((len(looks), weights.size))
        for s, look in enumerate(looks):
            if look.detection.shape != weights.shape:
                raise ValueError(f"weights: expected shape {look.detection.shape}, got {weights.shape}")
            missed[s] -= look.detection
        sizes = np.array([look.clutter.size for look in looks], dtype=np.int64)
        points, numbers, likelihood, gains, clutter = [_NONE], [_NONE], [_EMPTY], [_EMPTY], [_EMPTY]
        for look, start in zip(looks, np.cumsum(sizes) - sizes, strict=True):
            points.append(look.indices)
            numbers.append(np.repeat(start + np.arange(look.clutter.size), np.diff(look.offsets)))
            likelihood.append(look.likelihood)
            gains.append(look.detection[look.indices] * look.likelihood)
            clutter.append(look.clutter)
        where, fit = np.concatenate(numbers), np.concatenate(likelihood)
        peaks = np.zeros(int(sizes.sum()))
        np.maximum.at(peaks, where, fit)
        touching = Touching.of(np.concatenate(points), where, fit / peaks[where], weights.size)
        sensors = np.repeat(np.arange(len(looks)), sizes)
        return Seen(touching, np.concatenate(gains)[touching.order], missed, sensors, np.concatenate(clutter))

    def unseen(self, weights: FloatArray) -> FloatArray:
        """v b_0 (n,): what no sensor saw."""
        return np.asarray(weights * self.missed.prod(axis=0))

    def terms(self, weights: FloatArray, groups: Groups) -> tuple[Terms, FloatArray]:
        """All terms and v b_W of each (t,)."""
        found = terms(self.touching, groups, len(self.missed))
        values = weights[found.owners]
        _multiply(values, found.owners, found.members, self.gains, self.missed)
        return found, values


@kernel
def _multiply(
    values: FloatArray, owners: IntArray, members: IntArray, gains: FloatArray, missed: FloatArray
) -> None:
    """values (t,) times p_D g of each member and 1 - p_D of each sensor without one."""
    for t in range(values.size):
        for s in range(members.shape[1]):
            entry = members[t, s]
            values[t] *= gains[entry] if entry >= 0 else missed[s, owners[t]]
