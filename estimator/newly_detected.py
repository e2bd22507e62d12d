"""How targets that were never detected explain measurements, and what becomes of the part that they show.

A measurement makes of the wide undetected intensity (`estimator.undetected`) something narrow where it says
that its target is: that is integrated, and drawn from, by importance sampling around that place.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import pi

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel
from estimator.sensor import SensorModel, own_look
from estimator.sensors.known import bare
from estimator.undetected import Undetected

_SPREAD = (
    1.25  # proposals are this much wider than the measurement's own covariance, so that no tail is missed
)
_PROBES = 16


def _probes(dimension: int) -> FloatArray:
    """A fixed symmetric set (d, 2 * _PROBES) of standard normal points with covariance exactly 1."""
    half = np.random.default_rng(dimension).standard_normal((dimension, _PROBES))
    points = np.concatenate([half, -half], axis=1)
    factor = np.linalg.cholesky(points @ points.T / points.shape[1])
    return np.ascontiguousarray(np.linalg.solve(factor, points))


_PROBE_SETS = {2: _probes(2), 3: _probes(3)}


@dataclass(frozen=True, slots=True, eq=False)
class Explanations:
    """How the undetected intensity v explains measurements: e_j = integral of p_D g(z_j | x) v(x)."""

    totals: FloatArray  # (m,) e_j
    centres: FloatArray  # (d, m) where each measurement says its target is
    factors: FloatArray  # (m, d, d) Cholesky factors of the proposals' covariances
    probes: FloatArray  # (d, m * k) proposals already evaluated, k of each measurement in turn
    shares: FloatArray  # (m * k,) what each contributes to its e_j
    spread: float  # metres, root mean square distance of the measurements' locations from the truth
    certain: bool = False  # whether p_D counts as 1 wherever it is not 0


def explanations(
    prior: Undetected,
    sensor: SensorModel,
    pose: FloatArray,
    measurements: FloatArray,
    *,
    certain: bool = False,
) -> Explanations:
    """Importance sampling of e_j around where each measurement (m, s) points, with fixed points.

    With `certain`, targets are detected for certain wherever they can be detected at all.
    """
    d, m = sensor.dimension, len(measurements)
    plain = bare(sensor)
    quick = own_look(plain)
    if quick is not None:
        centres, covariances = quick.located(measurements, pose)
    else:
        centres, covariances = plain.locate(measurements, pose), plain.location_covariance(measurements, pose)
    factors = _SPREAD**2 * np.ascontiguousarray(covariances)
    spread = np.sqrt(_factorised(factors)) / _SPREAD
    units, owners = _PROBE_SETS[d], _owners(m, 2 * _PROBES)
    probes, shares = _evaluated(prior, sensor, pose, measurements, centres, factors, owners, units, certain)
    shares /= 2 * _PROBES
    totals = shares.reshape(m, 2 * _PROBES).sum(axis=1)
    return Explanations(totals, centres, factors, probes, shares, float(spread), certain)


@lru_cache(maxsize=256)
def _owners(count: int, each: int) -> IntArray:
    owners = np.repeat(np.arange(count), each)
    owners.flags.writeable = False
    return owners


def detected(
    prior: Undetected,
    sensor: SensorModel,
    pose: FloatArray,
    measurements: FloatArray,
    explained: Explanations,
    masses: FloatArray,
    counts: IntArray,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Particles (d, b), weights (b,) of the part of v that measurements now show, p_D g(z_j | x) v(x) / D_j.

    masses (m,) is that part's mass for each measurement, counts (m,) how many particles to draw; those of a
    measurement weigh its mass together.
    """
    owners = np.repeat(np.arange(len(measurements)), counts)
    units = rng.standard_normal((sensor.dimension, owners.size))
    points, shares = _evaluated(
        prior,
        sensor,
        pose,
        measurements,
        explained.centres,
        explained.factors,
        owners,
        units,
        explained.certain,
    )
    totals = np.bincount(owners, shares, minlength=counts.size)
    lost = np.flatnonzero((counts > 0) & (totals <= 0.0))
    if lost.size:  # all draws fell where nothing can be: take the probes, of which some did not
        k = explained.shares.size // counts.size
        again = (lost[:, None] * k + np.arange(k)).ravel()
        owners = np.concatenate([owners, np.repeat(lost, k)])
        points = np.concatenate([points, explained.probes[:, again]], axis=1)
        shares = np.concatenate([shares, explained.shares[again]])
        totals = np.bincount(owners, shares, minlength=counts.size)
    keep = shares > 0.0
    owners, points, shares = owners[keep], np.ascontiguousarray(points[:, keep]), shares[keep]
    return points, shares * (masses / np.where(totals > 0.0, totals, 1.0))[owners]


def _evaluated(
    prior: Undetected,
    sensor: SensorModel,
    pose: FloatArray,
    measurements: FloatArray,
    centres: FloatArray,
    factors: FloatArray,
    owners: IntArray,
    units: FloatArray,
    certain: bool,
) -> tuple[FloatArray, FloatArray]:
    """Proposals (d, b), b = owners.size, and p_D g v / q there, each for its own measurement (b,).

    A proposal is its measurement's centre + factor unit; units (d, k) are taken again and again.
    """
    points = np.empty((units.shape[0], owners.size))
    shares = np.empty(owners.size)
    _propose(centres, factors, owners, units, points, shares)
    detection, own = _own_look(bare(sensor), points, pose, measurements, owners)
    shares *= prior.at(points)
    shares *= own
    shares *= detection > 0.0 if certain else detection
    return points, shares


def _own_look(
    sensor: SensorModel, points: FloatArray, pose: FloatArray, measurements: FloatArray, owners: IntArray
) -> tuple[FloatArray, FloatArray]:
    """p_D (b,) of points (d, b), and g (b,) of each under its own measurement.

    A look at all pairs says it too; sensors that can leave out the other pairs have `own_look`.
    """
    quick = own_look(sensor)
    if quick is not None:
        return quick.own_look(points, pose, measurements, owners)
    look = sensor.look(points, pose, measurements)
    own = np.zeros(owners.size)
    _pick(look.offsets, look.indices, look.likelihood, owners, own)
    return look.detection, own


@kernel
def _factorised(matrices: FloatArray) -> float:
    """Cholesky factors (m, d, d) in place of covariances; the mean of the covariances' traces.

    A direction without spread stays without.
    """
    m, d = matrices.shape[0], matrices.shape[1]
    trace = 0.0
    for j in range(m):
        for a in range(d):
            trace += matrices[j, a, a]
            for b in range(a + 1):
                value = matrices[j, a, b]
                for k in range(b):
                    value -= matrices[j, a, k] * matrices[j, b, k]
                if a == b:
                    matrices[j, a, a] = np.sqrt(max(value, 0.0))
                else:
                    matrices[j, a, b] = value / matrices[j, b, b] if matrices[j, b, b] > 0.0 else 0.0
                    matrices[j, b, a] = 0.0
    return float(trace / max(m, 1))


@kernel
def _propose(
    centres: FloatArray,
    factors: FloatArray,
    owners: IntArray,
    units: FloatArray,
    points: FloatArray,
    inverse_densities: FloatArray,
) -> None:
    d = centres.shape[0]
    volume = np.empty(factors.shape[0])
    for j in range(factors.shape[0]):
        volume[j] = (2.0 * pi) ** (0.5 * d)
        for a in range(d):
            volume[j] *= factors[j, a, a]
    inverse = np.empty(units.shape[1])
    for u in range(units.shape[1]):
        square = 0.0
        for a in range(d):
            square += units[a, u] * units[a, u]
        inverse[u] = np.exp(0.5 * square)
    u = 0
    for k in range(owners.size):
        j = owners[k]
        for a in range(d):
            x = centres[a, j]
            for b in range(a + 1):
                x += factors[j, a, b] * units[b, u]
            points[a, k] = x
        inverse_densities[k] = volume[j] * inverse[u]
        u = u + 1 if u + 1 < units.shape[1] else 0


@kernel
def _pick(
    offsets: IntArray,
    indices: IntArray,
    likelihood: FloatArray,
    owners: IntArray,
    own: FloatArray,
) -> None:
    """g of each point (b,) for the measurement that proposed it."""
    for j in range(offsets.size - 1):
        for k in range(offsets[j], offsets[j + 1]):
            if owners[indices[k]] == j:
                own[indices[k]] = likelihood[k]
