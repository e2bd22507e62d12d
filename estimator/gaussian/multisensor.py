"""Several sensors' measurement sets of one time applied together to Gaussian components, in no order.

The corrector of `estimator.multisensor` with components for points: a component and a subset W of
measurements become one component, by a Gauss-Newton step on all of them stacked and a second one at its
result, which no order of the sensors can change. What was never detected joins in: a subset that measurements
of different sensors make out of the undetected intensity is one new target, and not one for each sensor.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, pi

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.gaussian.components import Components, sigma_points
from estimator.gaussian.detection import split_at_edges
from estimator.gaussian.update import kalman_pairs
from estimator.motion import Motion
from estimator.multisensor import Take
from estimator.partitions import (
    MOST,
    Groups,
    Touching,
    coefficients,
    grouped,
    summed,
    terms,
    with_clutter,
)
from estimator.sensor import gaussian
from estimator.undetected import Undetected

_STEPS = 2  # of Gauss-Newton: measurements are made linear at the posterior, not only at the prior


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """A Gaussian for each source and subset of measurements."""

    slots: IntArray  # (t,)
    values: FloatArray  # (t,) v b_W, integrated
    means: FloatArray  # (t, n_x)
    covariances: FloatArray  # (t, n_x, n_x)


@dataclass(frozen=True, slots=True, eq=False)
class AnySensor:
    """Detected by any of several sensors: p_D = 1 - prod (1 - p_s). Only what splitting asks a sensor for."""

    takes: Sequence[Take]

    @property
    def dimension(self) -> int:
        return self.takes[0].sensor.dimension

    def detection(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        """p_D of points (d, n), shape (1, n); every sensor is at its own pose."""
        missed = np.ones((1, points.shape[1]))
        for take in self.takes:
            missed *= 1.0 - take.sensor.detection(points, take.pose[None, :])
        return np.asarray(1.0 - missed)


def jointly_updated(
    prior: Components,
    undetected: Undetected,
    takes: Sequence[Take],
    motion: Motion,
    *,
    gate: float,
    tolerance: float,
    depth: int,
    most: int = MOST,
) -> tuple[Components, Components, Undetected]:
    """What was missed, what was detected (new targets among it), and what stays undetected.

    `gate`, `tolerance` and `depth` as in `GmPhdConfig`; `most` measurements may be in one group.

    Raises:
        ValueError: if a sensor's noise is not Gaussian.
    """
    anyone = AnySensor(takes)
    prior, detection = split_at_edges(prior, anyone, np.zeros(4), tolerance=tolerance, depth=depth)  # type: ignore[arg-type]
    missed = prior.scaled(1.0 - detection)
    left = undetected
    for take in takes:
        left = left.after(take.sensor, take.pose)
    sizes = np.array([len(take.measurements) for take in takes])
    if sizes.sum() == 0:
        return missed, Components.none(prior.state_size), left
    sensors = np.repeat(np.arange(len(takes)), sizes)
    known = _touched(prior.means, prior.covariances, takes, gate)
    new = of_undetected(undetected, takes, gate)
    groups = grouped([known, new.touching], sensors, most)
    one = _of_components(prior, known, groups, takes)
    two = new.hypotheses(groups)
    totals = summed(one.values, one.slots, groups.slots) + summed(two.values, two.slots, groups.slots)
    clutter = np.concatenate([take.sensor.clutter_intensity(take.measurements, take.pose) for take in takes])
    shares = coefficients(with_clutter(totals, clutter, groups), groups)
    old = Components(one.values * shares[one.slots], one.means, one.covariances)
    d, n = motion.dimension, motion.state_size
    means = np.zeros((two.values.size, n))
    means[:, :d] = two.means
    born = Components(two.values * shares[two.slots], means, motion.start_covariance(two.covariances))
    return missed, old.joined(born), left


def _touched(means: FloatArray, covariances: FloatArray, takes: Sequence[Take], gate: float) -> Touching:
    """The measurements of all sensors inside each component's gates."""
    owners, numbers, closeness, start = [], [], [], 0
    for take in takes:
        pairs = kalman_pairs(
            means, covariances, gaussian(take.sensor), take.pose, take.measurements, gate=gate
        )
        owners.append(pairs.owners())
        numbers.append(start + pairs.measurements)
        peak = np.full(len(take.measurements), -np.inf)
        np.maximum.at(peak, pairs.measurements, pairs.log_likelihood)
        closeness.append(np.exp(pairs.log_likelihood - peak[pairs.measurements]))
        start += len(take.measurements)
    return Touching.of(np.concatenate(owners), np.concatenate(numbers), np.concatenate(closeness), len(means))


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Where each of M measurements says its target is; those of sensors that give no place have none."""

    known: BoolArray  # (M,)
    means: FloatArray  # (M, d)
    covariances: FloatArray  # (M, d, d)

    @staticmethod
    def of(takes: Sequence[Take]) -> "Places":
        """Of all measurements, sensor by sensor."""
        d = takes[0].sensor.dimension
        known, means, covariances = [], [], []
        for take in takes:
            m, places = len(take.measurements), take.sensor.measurement_size >= d
            known.append(np.full(m, places))
            if places and m:
                means.append(take.sensor.locate(take.measurements, take.pose).T)
                covariances.append(take.sensor.location_covariance(take.measurements, take.pose))
            else:
                means.append(np.zeros((m, d)))
                covariances.append(np.tile(np.eye(d), (m, 1, 1)))
        return Places(
            np.concatenate(known),
            np.ascontiguousarray(np.concatenate(means)),
            np.ascontiguousarray(np.concatenate(covariances)),
        )

    def touching(self, takes: Sequence[Take], sensors: IntArray, gate: float) -> tuple[Touching, IntArray]:
        """Each place as a source: what may be of the same target, itself among it. And all pairs a < b that
        may, as sorted keys a M + b.

        A subset is found from its lowest measurement with a place only, so a source touches none that has a
        place and a lower number.
        """
        count = len(self.means)
        near = _touched(self.means, self.covariances, takes, gate)
        a, b = near.owners(), near.measurements
        fit = self.known[a] & (sensors[a] != sensors[b])
        a, b, close = a[fit], b[fit], near.closeness[fit]
        keys = np.unique(np.minimum(a, b) * count + np.maximum(a, b))
        first, second = keys // count, keys % count
        strength = np.zeros(keys.size)
        np.maximum.at(strength, np.searchsorted(keys, np.minimum(a, b) * count + np.maximum(a, b)), close)
        turned = ~self.known[first]
        first, second = np.where(turned, second, first), np.where(turned, first, second)
        own = np.flatnonzero(self.known)
        touching = Touching.of(
            np.concatenate([own, first]),
            np.concatenate([own, second]),
            np.concatenate([np.ones(own.size), strength]),
            count,
        )
        return touching, keys


def _of_components(prior: Components, known: Touching, groups: Groups, takes: Sequence[Take]) -> Hypotheses:
    found = terms(known, groups, len(takes))
    members = np.where(found.members >= 0, known.measurements[found.members], -1)
    start, spread = prior.means[found.owners], prior.covariances[found.owners]
    information = np.asarray(np.linalg.inv(spread), dtype=np.float64)
    means, covariances, level = _gauss_newton(start, information, members, takes)
    level -= 0.5 * np.linalg.slogdet(spread)[1] if start.size else 0.0
    rates = _rates(means, covariances, members, takes, None)
    return Hypotheses(found.slots, prior.weights[found.owners] * np.exp(level) * rates, means, covariances)


@dataclass(frozen=True, slots=True, eq=False)
class Newcomers:
    """What the undetected intensity may have to do with the measurements of all sensors."""

    undetected: Undetected
    takes: Sequence[Take]
    places: Places
    touching: Touching  # with a source for each measurement that says a place
    together: IntArray  # keys of the pairs of measurements that may be of one new target

    def hypotheses(self, groups: Groups) -> Hypotheses:
        """A Gaussian over positions (t, d) for each subset that may be of one new target."""
        places, takes = self.places, self.takes
        found = terms(self.touching, groups, len(takes))
        members = np.where(found.members >= 0, self.touching.measurements[found.members], -1)
        whole = (members == found.owners[:, None]).any(axis=1) & _compatible(members, places, self.together)
        members, slots = members[whole], found.slots[whole]
        d = places.means.shape[1]
        information, vector = np.zeros((slots.size, d, d)), np.zeros((slots.size, d))
        inverses = np.linalg.inv(places.covariances)
        for s in range(members.shape[1]):
            has = (members[:, s] >= 0) & places.known[members[:, s]]
            which = members[has, s]
            information[has] += inverses[which]
            vector[has] += np.einsum("kij,kj->ki", inverses[which], places.means[which])
        start = np.linalg.solve(information, vector[:, :, None])[:, :, 0]
        # next to nothing is added, for places at which a sensor's derivatives vanish
        means, covariances, level = _gauss_newton(start, 1e-9 * information, members, takes)
        level += 0.5 * d * log(2.0 * pi)
        rates = _rates(means, covariances, members, takes, self.undetected)
        return Hypotheses(slots, np.exp(level) * rates, means, covariances)


def of_undetected(undetected: Undetected, takes: Sequence[Take], gate: float) -> Newcomers:
    """How measurements within `gate` standard deviations of each other may be of one new target."""
    places = Places.of(takes)
    sensors = np.repeat(np.arange(len(takes)), [len(take.measurements) for take in takes])
    touching, together = places.touching(takes, sensors, gate)
    return Newcomers(undetected, takes, places, touching, together)


def _compatible(members: IntArray, places: Places, together: IntArray) -> BoolArray:
    """Whether each two members (t, q) with a place between them may be of one target."""
    count, fits = len(places.means), np.ones(len(members), dtype=np.bool_)
    for s in range(members.shape[1]):
        for r in range(s + 1, members.shape[1]):
            a, b = members[:, s], members[:, r]
            both = (a >= 0) & (b >= 0) & (places.known[a] | places.known[b])
            keys = np.minimum(a, b) * count + np.maximum(a, b)
            at = np.minimum(np.searchsorted(together, keys), max(together.size - 1, 0))
            found = together[at] == keys if together.size else np.zeros(len(members), dtype=np.bool_)
            fits &= ~both | found
    return fits


def _gauss_newton(
    start: FloatArray, information: FloatArray, members: IntArray, takes: Sequence[Take]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Posterior means (t, n), covariances (t, n, n), and log integrals (t,) of prior times likelihoods.

    The prior is exp(-(x - start)' information (x - start) / 2); the integrals are by Laplace's rule, without
    the (2 pi)^(n / 2) that a Gaussian prior's own factor takes away again.
    """
    mean = start
    covariances, level = np.zeros_like(information), np.zeros(len(start))
    for _ in range(_STEPS):
        total, vector = information.copy(), np.zeros_like(start)
        level = np.zeros(len(start))
        first = 0
        for s, take in enumerate(takes):
            has = np.flatnonzero(members[:, s] >= 0)
            z = take.measurements[members[has, s] - first]
            first += len(take.measurements)
            if has.size == 0:
                continue
            sensor, d = gaussian(take.sensor), take.sensor.dimension
            points = np.ascontiguousarray(mean[has, :d].T)
            slope = sensor.jacobian(points, take.pose)
            off = z - sensor.measure(points, take.pose)
            off = np.where(sensor.angular, off - 2.0 * pi * np.round(off / (2.0 * pi)), off)
            off += np.einsum("ksd,kd->ks", slope, mean[has, :d] - start[has, :d])
            weight = np.linalg.inv(sensor.noise)
            total[has, :d, :d] += np.einsum("ksa,st,ktb->kab", slope, weight, slope)
            vector[has, :d] += np.einsum("ksa,st,kt->ka", slope, weight, off)
            level[has] -= 0.5 * np.einsum("ks,st,kt->k", off, weight, off)
            level[has] -= 0.5 * float(np.linalg.slogdet(2.0 * pi * sensor.noise)[1])
        if len(start) == 0:
            break
        covariances = np.asarray(np.linalg.inv(total), dtype=np.float64)
        covariances = 0.5 * (covariances + np.swapaxes(covariances, 1, 2))
        step = np.einsum("kab,kb->ka", covariances, vector)
        mean = start + step
        level += 0.5 * np.einsum("ka,ka->k", step, vector) - 0.5 * np.linalg.slogdet(total)[1]
    return np.ascontiguousarray(mean), np.ascontiguousarray(covariances), level


def _rates(
    means: FloatArray,
    covariances: FloatArray,
    members: IntArray,
    takes: Sequence[Take],
    undetected: Undetected | None,
) -> FloatArray:
    """Means (t,) over the Gaussians of prod p_s prod (1 - p_s), times the undetected intensity if given."""
    d, t = takes[0].sensor.dimension, len(means)
    each = 2 * d + 1
    points = np.empty((d, t * each))
    bad = sigma_points(means, covariances, np.arange(t), points)
    if bad >= 0:
        raise ValueError(f"covariances: number {bad} is not positive definite")
    values = np.ones((t, each)) if undetected is None else undetected.at(points).reshape(t, each)
    for s, take in enumerate(takes):
        seen = take.sensor.detection(points, take.pose[None, :])[0].reshape(t, each)
        values = values * np.where(members[:, s, None] >= 0, seen, 1.0 - seen)
    return np.asarray((1.0 - d / 3.0) * values[:, 0] + values[:, 1:].sum(axis=1) / 6.0)
