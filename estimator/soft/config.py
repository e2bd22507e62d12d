"""The labelled mixtures' table in a mission."""

from typing import Annotated

import msgspec
from msgspec import Meta

from estimator.arrays import Fraction, Positive
from estimator.motion import MotionConfig


class TargetTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A target that has a name; without a mean it may be anywhere in the area."""

    name: Annotated[str, Meta(min_length=1, max_length=64)]
    mean_m: list[float] | None = None  # where it is expected
    sigma_m: Positive | None = None  # standard deviation per axis; needed with a mean


class MixturesConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The filter's table in a mission."""

    targets: list[TargetTable] = []  # known by name
    unnamed: Annotated[int, Meta(ge=0, le=200)] | None = None  # others, alike; default 1 without targets
    components: Annotated[int, Meta(ge=1, le=200)] = 15  # M_max of each target
    samples: Annotated[int, Meta(ge=16, le=10_000)] = 64  # of each importance sampling
    operator_error: Fraction = 0.0  # probability that a statement says nothing about the truth
    cluster_radius_m: Positive | None = None  # default: a tenth of the area's shortest side
    motion: MotionConfig = MotionConfig()
