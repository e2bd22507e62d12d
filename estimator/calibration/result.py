"""What a calibration is asked, and what it answers."""

from dataclasses import dataclass, field

import numpy as np

from estimator.arrays import FloatArray
from estimator.calibration.clutter import Peak
from estimator.calibration.resampling import Interval


@dataclass(frozen=True, slots=True)
class Options:
    """How a calibration goes about it.

    Raises:
        ValueError: naming the field that is wrong.
    """

    range_gate: float = 1.0  # metres; a greater error is no noise
    bearing_gate: float = float(np.radians(10.0))
    breaks: tuple[float, ...] = ()  # metres, of the table of p_D; (): eight over the ranges seen
    bystander_radius: float = 0.0  # metres; hides what is behind it
    reach: float = np.inf  # metres; no target further away is seen. A sensor without ranges is asked itself
    stretches: int = 60  # that are resampled
    draws: int = 200
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.reach > 0.0:
            raise ValueError(f"reach: expected a number > 0, found {self.reach}")
        for name in ("range_gate", "bearing_gate"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name}: expected a finite number > 0, found {getattr(self, name)}")
        breaks = np.array(self.breaks)
        if breaks.size and (
            breaks.size < 2 or not np.isfinite(breaks).all() or breaks[0] < 0 or (np.diff(breaks) <= 0).any()
        ):
            raise ValueError(f"breaks: expected two or more growing numbers >= 0, found {self.breaks}")
        if min(self.stretches, self.draws) < 2:
            raise ValueError("stretches, draws: expected 2 or more")


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What the recording says of the sensor. Intervals go by the estimates' names."""

    quantities: tuple[str, ...]
    sigmas: dict[str, float]  # by quantity, metres or radians
    biases: dict[str, float]
    outliers: float  # share of the sightings whose error is no noise
    nearest: float  # metres, least and greatest distance of a target seen
    farthest: float
    opening: tuple[float, float]  # radians from the heading, in which targets are seen; (-pi, pi): all around
    breaks: FloatArray  # (b,) metres
    gains: FloatArray  # (b,) p_D in view
    sectors: FloatArray  # (s,) radians, middles of parts of the opening
    sector_gains: FloatArray  # (s,) p_D there over the table's
    clutter: float  # false measurements in a set
    peaks: tuple[Peak, ...]  # over the bearing
    clutter_uniform: float  # share of clutter beyond two peaks at +-90 degrees, Dames & Kumar (31)
    clutter_peak: float  # radians, their width; NaN: there are none
    sets: int
    sightings: int  # of targets
    trials: int  # how often a target was in view
    measured: tuple[float, float]  # the greatest range and bearing off the heading ever measured, or NaN
    intervals: dict[str, list[Interval]] = field(default_factory=dict)
