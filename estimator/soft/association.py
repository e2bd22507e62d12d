"""Which of a known number of targets made which measurement, where some targets are alike."""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.lmb.association import CERTAIN, Pairs, associated


def shares(
    explained: FloatArray, missed: FloatArray, clutter: FloatArray, kinds: IntArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Marginal probabilities (t, m) that a target made a measurement, (t,) that it made none, and new kinds.

    explained (t, m) is E[p_D g(z_j | x_i)], missed (t,) E[1 - p_D], clutter (m,) c(z_j); kinds (t,) are equal
    and >= 0 for targets that cannot be told apart. Joint associations may be relabelled among these without
    changing what is known of the set of targets (the idea of set JPDA, Svensson et al. 2011): each
    measurement's probability is given to as few of them as can hold it, so that one target is not smeared
    over all places where one of them was seen. Those that got something become of a kind of their own.
    """
    psi = np.zeros_like(explained)
    possible = explained > 0.0
    scale = missed[:, None] * clutter[None, :]
    psi[possible] = np.minimum(explained[possible] / np.maximum(scale[possible], 1e-300), CERTAIN)
    rows, columns = np.nonzero(possible)
    offsets = np.searchsorted(rows, np.arange(len(missed) + 1))
    result = associated(Pairs(offsets, columns, psi[possible], clutter.size))
    share = np.zeros_like(explained)
    share[rows, columns] = result.pairs
    share, kinds = share.copy(), kinds.copy()
    for kind in np.unique(kinds[kinds >= 0]):
        alike = np.flatnonzero(kinds == kind)
        if alike.size > 1:
            share[alike] = _packed(share[alike].sum(axis=0), alike.size)
            kinds[alike[share[alike].sum(axis=1) > 0.0]] = -1
    return share, np.maximum(1.0 - share.sum(axis=1), 0.0), kinds


def _packed(masses: FloatArray, count: int) -> FloatArray:
    """Masses (m,) of at most 1 each, `count` together, given to `count` bins of size 1: (count, m).

    The greatest first, each whole into the first bin that has room; what fits into none is split.
    """
    out, room = np.zeros((count, masses.size)), np.ones(count)
    for j in np.argsort(-masses, kind="stable"):
        left = masses[j]
        if left <= 0.0:
            continue
        fits = np.flatnonzero(room >= left - 1e-12)
        for i in fits[:1] if fits.size else np.argsort(-room, kind="stable"):
            part = min(left, max(room[i], 0.0)) if not fits.size else left
            out[i, j] += part
            room[i] -= part
            left -= part
    return out
