"""What explains measurements besides the particles there are, and the particles that it becomes.

- What was never detected (`estimator.undetected`): of the uniform prior, and of births spread evenly.
- Births driven by measurements: Ristic, Clark, Vo & Vo, "Adaptive target birth intensity for PHD and CPHD
  filters", IEEE Transactions on Aerospace and Electronic Systems, 2012. A target born since the last set is
  detected for certain (where the sensor can detect at all), so it is where one of the measurements is. In its
  (17) the newborn's likelihood stands in the same denominator as clutter and the targets there are; the
  paper's intensity, "uniform over what measurements see", is here uniform over the area.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.filter import Area
from estimator.newly_detected import Explanations, detected, explanations
from estimator.sensor import SensorModel, checked_points
from estimator.sensors.known import bare
from estimator.smc.resampling import gathered, systematic
from estimator.smc.state import SmcPhdState, turned_back
from estimator.undetected import Undetected

# A measurement is left to the particles if they explain it so much better than a newcomer does,
_PLAIN = 1e-2
_TRACE = 1e-4  # or if the new target would have less mass than this.


class Newcomers(Protocol):
    """A part of the intensity that is not in the particles yet."""

    @property
    def totals(self) -> FloatArray:
        """(m,) what it explains of each measurement: the integral of p_D g(z_j | x) v(x)."""

    def drawn(
        self, masses: FloatArray, counts: IntArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Points (d, b) and weights (b,) of what measurements now show of it: masses (m,) in counts (m,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """Newcomers where each measurement says its target is."""

    prior: Undetected
    sensor: SensorModel
    pose: FloatArray
    measurements: FloatArray
    explained: Explanations

    @staticmethod
    def of(
        prior: Undetected,
        sensor: SensorModel,
        pose: FloatArray,
        measurements: FloatArray,
        *,
        certain: bool = False,
    ) -> "Located":
        return Located(
            prior,
            sensor,
            pose,
            measurements,
            explanations(prior, sensor, pose, measurements, certain=certain),
        )

    @property
    def totals(self) -> FloatArray:
        return self.explained.totals

    def drawn(
        self, masses: FloatArray, counts: IntArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        return detected(
            self.prior, self.sensor, self.pose, self.measurements, self.explained, masses, counts, rng
        )


@dataclass(frozen=True, slots=True, eq=False)
class Scattered:
    """Newcomers at places spread evenly, for sensors whose measurements do not say a place."""

    points: FloatArray  # (d, k)
    offsets: IntArray  # (m + 1,) as in a Look
    indices: IntArray
    shares: FloatArray  # g(z | x) times the mass of a point
    totals: FloatArray  # (m,)

    @staticmethod
    def of(
        points: FloatArray, mass: float, sensor: SensorModel, pose: FloatArray, measurements: FloatArray
    ) -> "Scattered":
        """`mass` newborn targets spread evenly over points (d, k)."""
        look = bare(sensor).look(points, pose, measurements)
        shares = look.likelihood * (look.detection[look.indices] > 0.0) * (mass / max(points.shape[1], 1))
        rows = np.repeat(np.arange(len(measurements)), np.diff(look.offsets))
        totals = np.bincount(rows, shares, minlength=len(measurements)).astype(np.float64)
        return Scattered(points, look.offsets, look.indices, shares, totals)

    def drawn(
        self, masses: FloatArray, counts: IntArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        points, weights = [self.points[:, :0]], [np.zeros(0)]
        for j in np.flatnonzero(counts):
            row = slice(self.offsets[j], self.offsets[j + 1])
            chosen = systematic(self.shares[row], int(counts[j]), rng.random())
            points.append(gathered(self.points, self.indices[row][chosen]))
            weights.append(np.full(chosen.size, masses[j] / chosen.size))
        return np.concatenate(points, axis=1), np.concatenate(weights)


def newcomers(
    state: SmcPhdState,
    sensor: SensorModel,
    pose: FloatArray,
    measurements: FloatArray,
    rng: np.random.Generator,
) -> list[Newcomers]:
    """All that can explain measurements (m, s) besides the particles of the state."""
    parts: list[Newcomers] = []
    if state.places is None:
        parts.append(Located.of(state.undetected, sensor, pose, measurements))
    if state.unborn > 0.0 and len(measurements):
        if state.places is None:
            area, shape = state.undetected.area, state.undetected.values.shape
            born = Undetected.uniform(area, shape, state.unborn)
            parts.append(Located.of(born, sensor, pose, measurements, certain=True))
        else:
            points = scattered(state, np.arange(state.places.shape[1]), rng)
            parts.append(Scattered.of(points, state.unborn, sensor, pose, measurements))
    return parts


def scattered(state: SmcPhdState, chosen: IntArray, rng: np.random.Generator) -> FloatArray:
    """Points (d, k) drawn evenly about places where the prior's particles lay, chosen (k,)."""
    assert state.places is not None
    area = state.undetected.area
    points = gathered(state.places, chosen)
    apart = turned_back(points + state.spacing * (rng.random(points.shape) - 0.5), area)
    return np.where(area.is_free(apart), apart, points)


def initial_places(
    area: Area, particles: int, spacing: float | None, places: FloatArray | None
) -> tuple[FloatArray, float]:
    """Where particles lie at first (d, f), and their distance in metres: `places`, or a grid in free space.

    Dames & Kumar (2015, section IV-B). The grid's cells fill the area, a particle in the middle of each that
    is free.

    Raises:
        ValueError: if places have a wrong shape, are none, not finite or outside the area, or if there are
            more than `particles`.
    """
    if places is None:
        return _free_grid(area, particles, spacing)
    places = checked_points(places, area.dimension)
    if not 0 < places.shape[1] <= particles:
        raise ValueError(f"places: expected 1 to {particles} points, one per particle, got {places.shape[1]}")
    inside = (places >= area.low[:, None]) & (places <= area.high[:, None])
    if not inside.all():  # also not finite
        raise ValueError("places: every point must lie in the area")
    return places, spacing or float((area.volume / places.shape[1]) ** (1.0 / area.dimension))


def _free_grid(area: Area, particles: int, spacing: float | None) -> tuple[FloatArray, float]:
    side = spacing or float((area.volume / particles) ** (1.0 / area.dimension))
    counts = np.maximum(((area.high - area.low) / side + (0.5 if spacing else 1e-9)).astype(int), 1)
    cells = int(np.prod(counts.astype(float)))
    if cells > 100 * particles:  # not worth the memory to look which of them are free
        raise ValueError(
            f"grid_spacing_m: the area has {cells} cells of {side:g} m, {particles} particles may be"
        )
    axes = [
        low + (high - low) * (np.arange(n) + 0.5) / n
        for low, high, n in zip(area.low, area.high, counts, strict=True)
    ]
    grid = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])
    grid = np.ascontiguousarray(grid[:, area.is_free(grid)])
    if not 0 < grid.shape[1] <= particles:
        raise ValueError(
            f"grid_spacing_m: {grid.shape[1]} free cells of {side:g} m in the area; 1 to {particles} may be"
        )
    return grid, side


def shown(totals: FloatArray, known: FloatArray, denominators: FloatArray) -> FloatArray:
    """Those totals (m,) that become particles; 0 for measurements left to the particles there are."""
    return np.where((totals > _PLAIN * known) & (totals > _TRACE * denominators), totals, 0.0)
