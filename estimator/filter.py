"""The seam between filters and the fusion service: init, predict, update, clusters, removal.

A filter's state is frozen; every call returns a new one, so that the fusion can keep checkpoints for free.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.maps.occupancy import OccupancyMap
from estimator.sensor import SensorModel

if TYPE_CHECKING:
    from estimator.soft.statement import SoftObservation

State = TypeVar("State")


@dataclass(frozen=True, slots=True)
class Clusters:
    """Estimated targets that are not yet found: c clusters of the intensity, heaviest first."""

    means: FloatArray  # (d, c) metres
    covariances: FloatArray  # (c, d, d) m^2
    masses: FloatArray  # (c,) expected number of targets in each
    radii: FloatArray  # (c,) metres, standard deviation per axis: sqrt(trace(covariance) / d)
    labels: IntArray | None = None  # (c,) identities that last over time, where the filter keeps them
    velocities: FloatArray | None = None  # (d, c) m/s, where the filter estimates them

    @staticmethod
    def none(dimension: int) -> "Clusters":
        """No cluster at all."""
        return Clusters(
            np.zeros((dimension, 0)), np.zeros((0, dimension, dimension)), np.zeros(0), np.zeros(0)
        )

    def chosen(self, keep: BoolArray | IntArray) -> "Clusters":
        """Those of a mask (c,), or of numbers, in their order."""
        return Clusters(
            np.ascontiguousarray(self.means[:, keep]),
            self.covariances[keep],
            self.masses[keep],
            self.radii[keep],
            None if self.labels is None else self.labels[keep],
            None if self.velocities is None else np.ascontiguousarray(self.velocities[:, keep]),
        )


class Solid(Protocol):
    """Something in which no target can be."""

    def contains(self, points: FloatArray) -> BoolArray:
        """(n,) whether points (d, n) lie in it."""


@dataclass(frozen=True, slots=True)
class Area:
    """The axis-aligned box in which targets may be; with a map, in its free cells only, and in no solid."""

    low: FloatArray  # (d,) metres
    high: FloatArray  # (d,) metres
    map: OccupancyMap | None = None
    solids: tuple[Solid, ...] = ()  # what does not reach through all altitudes, beside the map

    @property
    def dimension(self) -> int:
        return int(self.low.size)

    @property
    def volume(self) -> float:
        """Of the whole box, in m^d."""
        return float(np.prod(self.high - self.low))

    def is_free(self, points: FloatArray) -> BoolArray:
        """Whether a target may be at points (d, n) as far as map and solids go, (n,); without, all True."""
        free = np.ones(points.shape[1], dtype=np.bool_) if self.map is None else self.map.is_free(points)
        for solid in self.solids:
            free &= ~solid.contains(points)
        return free


class Filter(Protocol, Generic[State]):
    """One multi-target filter. Every random draw comes from the generator in the arguments."""

    def init(self, area: Area, rng: np.random.Generator) -> State:
        """The prior intensity over the area."""

    def predict(self, state: State, duration: float, rng: np.random.Generator) -> State:
        """The state `duration` seconds later: motion, survival, birth."""

    def update(
        self,
        state: State,
        sensor: SensorModel,
        pose: FloatArray,
        measurements: FloatArray,
        rng: np.random.Generator,
    ) -> State:
        """The posterior after one sensor's measurement set (m, s); the empty set says nothing was seen."""

    def clusters(self, state: State, rng: np.random.Generator) -> tuple[State, Clusters]:
        """Estimated targets; the state may remember them to be quicker next time."""

    def remove(self, state: State, clusters: IntArray) -> State:
        """The intensity without the given clusters of the last `clusters` call."""

    def mass(self, state: State) -> float:
        """The expected number of targets in the intensity."""

    def thinned(self, state: State, size: int) -> tuple[FloatArray, FloatArray]:
        """At most `size` points (d, k) with weights (k,) that stand for the intensity, for people."""


@runtime_checkable
class Listening(Protocol):
    """What a filter has besides `Filter` if operators' soft observations can change its state."""

    def observe(
        self,
        state: State,
        statement: "SoftObservation",
        rng: np.random.Generator,
        *,
        known: FloatArray | None = None,
    ) -> State:
        """The posterior after a statement.

        `known` (f,) is the probability of the statement's category at each target that was found and is no
        longer in the state: "something is near" may speak of one of them.

        Raises:
            ValueError: if the filter cannot take this statement; says why.
        """
