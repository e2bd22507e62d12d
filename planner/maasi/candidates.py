"""Candidate waypoints: a regular grid of places to go next, (MA)ASI sections 4 and 5.1."""

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from estimator.arrays import Count, FloatArray
from estimator.filter import Area

Corner = Annotated[list[float], Meta(min_length=2, max_length=3)]


class CandidateGrid(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """`points` per axis between the corners `low` and `high`; one point on an axis lies in the middle.

    Two axes are enough, also for robots that fly: their candidates lie at the altitude that they have.
    """

    low: Corner  # metres
    high: Corner  # metres
    points: Annotated[list[Count], Meta(min_length=2, max_length=3)]

    def __post_init__(self) -> None:
        if not len(self.low) == len(self.high) == len(self.points):
            raise ValueError(
                "low, high and points: expected one number per axis each, "
                f"got {len(self.low)}, {len(self.high)} and {len(self.points)}"
            )
        if not np.isfinite([*self.low, *self.high]).all():
            raise ValueError("low and high: every number must be finite")
        if any(high < low for low, high in zip(self.low, self.high, strict=True)):
            raise ValueError(f"low: expected no number above that of high, got {self.low} and {self.high}")

    @staticmethod
    def over(area: Area, per_axis: int) -> "CandidateGrid":
        """The middles of `per_axis` equal parts of each axis of the area."""
        half = (area.high - area.low) / (2 * per_axis)
        return CandidateGrid(
            low=(area.low + half).tolist(),
            high=(area.high - half).tolist(),
            points=[per_axis] * area.dimension,
        )

    def waypoints(self, altitude: float) -> FloatArray:
        """All candidates (w, 3), last axis fastest; those of a grid of two axes at `altitude` metres."""
        axes = [
            np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2])
            for low, high, count in zip(self.low, self.high, self.points, strict=True)
        ]
        if len(axes) == 2:
            axes.append(np.array([altitude]))
        return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
