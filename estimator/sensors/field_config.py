"""The keys of a mission's sensor table that say where the sensor detects, shared by all sensors."""

from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from estimator.arrays import FloatArray, Fraction, NonNegative, Positive
from estimator.sensors.field_of_view import FieldOfView


class FieldConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A field of view in a mission file."""

    gain: Fraction = 1.0  # G
    field_of_view: Literal["exponential", "box", "sector", "smooth_sector"] = "exponential"
    reach_m: Annotated[list[Positive], Meta(min_length=2, max_length=3)] | None = None  # F_x, F_y(, F_z)
    box_m: Annotated[list[tuple[float, float]], Meta(min_length=2, max_length=3)] | None = None
    box_frame: Literal["world", "body"] = "world"
    range_m: Positive | None = None  # sector; smooth_sector: where p_D has fallen to half
    min_range_m: NonNegative = 0.0  # sector
    angle_deg: Annotated[float, Meta(gt=0, le=360)] | None = None  # sectors, full opening about the yaw
    edge_steepness: Positive = 10.0  # smooth_sector: alpha_2 of Liu & Hedrick (7)
    range_breaks_m: list[NonNegative] = []  # p_D is multiplied by range_gains, linear between the breaks
    range_gains: list[Fraction] = []


def field_of(config: FieldConfig, dimension: int, beam: float = np.inf) -> FieldOfView:
    """The field of view that a mission's table describes.

    Raises:
        ValueError: if a key is missing or does not fit the dimension; names the key.
    """
    breaks, gains = np.array(config.range_breaks_m), np.array(config.range_gains)
    if breaks.size != gains.size:
        raise ValueError(f"range_gains: {gains.size} numbers for {breaks.size} range_breaks_m")
    if (np.diff(breaks) <= 0).any():
        raise ValueError("range_breaks_m: must grow")
    turns = config.box_frame == "body"
    size = _size(config, dimension)
    return FieldOfView(dimension, config.field_of_view, config.gain, size, turns, breaks, gains, beam)


def _size(config: FieldConfig, d: int) -> FloatArray:
    shape = config.field_of_view
    if shape == "exponential":
        size = np.array(config.reach_m or [])
        if size.size != d:
            raise ValueError(
                f"reach_m: an exponential field of view needs {d} numbers here, found {size.size}"
            )
        return size
    if shape == "box":
        size = np.array(config.box_m or []).ravel()
        if size.size != 2 * d:
            raise ValueError(f"box_m: needs {d} pairs here, found {size.size // 2}")
        if not (np.isfinite(size).all() and (size[::2] < size[1::2]).all()):
            raise ValueError("box_m: every pair must be [least, greatest]")
        return size
    if config.range_m is None or config.angle_deg is None:
        key = "angle_deg" if config.range_m else "range_m"
        raise ValueError(f"{key}: a {shape} field of view needs it")
    opening = float(np.radians(config.angle_deg))
    if shape == "smooth_sector":
        return np.array([config.range_m**-2, config.edge_steepness, opening])
    if config.min_range_m >= config.range_m:
        raise ValueError("min_range_m: must be less than range_m")
    return np.array([config.min_range_m, config.range_m, opening])
