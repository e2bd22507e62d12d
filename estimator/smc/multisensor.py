"""Several sensors' measurement sets of one time applied together to the particle filter, in no order.

`estimator.multisensor` on the particles. The undetected part joins in as Gaussian hypotheses, one for each
subset of measurements that may be of one new target (`estimator.gaussian.multisensor`), and what the sets
show of it is drawn from those; a target first seen by several sensors at once becomes one and not several.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.gaussian.multisensor import of_undetected
from estimator.motion import Motion
from estimator.multisensor import Seen, Take, checked_take
from estimator.partitions import MOST, coefficients, grouped, summed, with_clutter
from estimator.smc.smc_phd import SmcPhd
from estimator.smc.state import SmcPhdState, with_velocities

_GATE = 5.0  # standard deviations between measurements that may be of one new target
_LEAST = 1e-4  # mass of a hypothesis that becomes particles


def updated_together(
    filter: SmcPhd, state: SmcPhdState, takes: Sequence[Take], rng: np.random.Generator, most: int = MOST
) -> SmcPhdState:
    """The posterior after the sets of several sensors of one time; only what is drawn depends on their order.

    Expects a state whose undetected part is on the grid (`initial` is not "grid"). Does not resample: call
    `filter.resampled`, or let the next `update` do it.

    Raises:
        ValueError: as `SmcPhd.update`, or if a sensor's noise is not Gaussian.
    """
    takes = [checked_take(take) for take in takes]
    if not takes:
        return state
    looks = [take.sensor.look(state.positions, take.pose, take.measurements) for take in takes]
    seen = Seen.by(state.weights, looks)
    new = of_undetected(state.undetected, takes, _GATE)
    groups = grouped([seen.touching, new.touching], seen.sensors, most)
    found, values = seen.terms(state.weights, groups)
    fresh = new.hypotheses(groups)
    totals = summed(values, found.slots, groups.slots) + summed(fresh.values, fresh.slots, groups.slots)
    shares = coefficients(with_clutter(totals, seen.clutter, groups), groups)
    weights = seen.unseen(state.weights) + summed(
        values * shares[found.slots], found.owners, state.weights.size
    )
    undetected = state.undetected
    for take in takes:
        undetected = undetected.after(take.sensor, take.pose)
    masses = fresh.values * shares[fresh.slots]
    shown = np.flatnonzero(masses > _LEAST)
    masses = masses[shown]
    counts = np.ceil(masses * max(50, filter.config.particles // 20)).astype(np.int64)
    owners = np.repeat(np.arange(shown.size), counts)
    d = state.centres.shape[0]
    factors = np.linalg.cholesky(fresh.covariances[shown])
    units = rng.standard_normal((owners.size, d))
    points = fresh.means[shown][owners] + np.einsum("kab,kb->ka", factors[owners], units)
    states = with_velocities(np.ascontiguousarray(points.T), Motion(d, filter.config.motion), rng)
    return replace(
        state,
        states=np.concatenate([state.states, states], axis=1),
        weights=np.concatenate([weights, (masses / np.maximum(counts, 1))[owners]]),
        labels=np.concatenate([state.labels, np.full(owners.size, -1)]),
        undetected=undetected,
    )
