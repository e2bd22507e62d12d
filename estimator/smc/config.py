"""The particle filter's table in a mission."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from estimator.arrays import Count, Fraction, NonNegative, Positive
from estimator.motion import MotionConfig


class SmcPhdConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The filter's table in a mission."""

    particles: Annotated[int, Meta(ge=100, le=10_000_000)] = 10_000  # at most
    expected_targets: NonNegative = 1.0  # mass of the uniform prior intensity
    initial: Literal["undetected", "grid"] = "undetected"  # the prior: an intensity, or particles everywhere
    grid_spacing_m: Positive | None = None  # between those particles; default: as many particles as allowed
    spacing_m: NonNegative = 0.0  # targets are never nearer to each other than this
    motion: MotionConfig = MotionConfig()
    birth: NonNegative = 0.0  # expected new targets per second in the whole area
    birth_at: Literal["area", "measurements"] = "area"  # evenly, or where measurements are (Ristic et al.)
    survival: Fraction = 1.0  # p_S per second
    spawning: NonNegative = 0.0  # targets that a detected one brings forth at its place, per second
    spawning_from: NonNegative = 0.5  # mass from which a cluster spawns: it is there rather than not
    spawning_to: Positive = 3.0  # mass up to which a cluster spawns
    grid_points: list[Count] | None = None  # of the undetected intensity; default 33 x 33 or 17 x 17 x 17
    resample_below: Fraction = 0.5  # share of effective particles below which they are resampled, 0 is never
    jitter: NonNegative = 0.5  # bandwidth of the regularisation, 1 is the normal rule, 0 is none
    roughening: NonNegative = 0.0  # noise on copies after resampling, in standard deviations of a location
    cluster_cutoff_m: Positive | None = None  # default: 3 standard deviations of a measurement's location
    cluster_least_mass: Positive = 0.1
    cluster_separation: Positive = 3.0  # standard deviations at which two clusters are two
    cluster_floor: NonNegative = 0.0  # width of a single particle, in standard deviations of a location
    stray_sigmas: NonNegative = 0.0  # stray particles this near to a removed cluster go with it
    thinning: Literal["systematic", "super_particles"] = "systematic"  # what stands for many particles
