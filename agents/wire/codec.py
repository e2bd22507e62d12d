"""Messages to bytes and back: MessagePack, with arrays as raw little-endian bytes.

Nothing that comes from the network is trusted. `decode` bounds what a payload may make the parser allocate,
then checks types, team, sender, every number for being finite, and every array's dtype and shape, and raises
nothing but MalformedMessage. What only a receiver can know (the mission's dimension, its sensors' measurement
size) is the receiver's to check.

An array travels as {"d": dtype, "s": shape, "b": bytes}. Decoded arrays are writable copies on purpose:
numba compiles a kernel again for read-only arguments, which would stall a robot in mid-mission.
"""

import math
from dataclasses import dataclass
from functools import cache
from types import EllipsisType
from typing import Any, get_type_hints

import msgpack
import msgspec
import numpy as np

from agents.errors import MalformedMessage
from agents.health.histogram import BINS
from agents.wire import messages as m
from agents.wire.topics import Topic

# A claimed length is allocated before it is read, and lists can be nested: these keep a small hostile
# payload from asking for gigabytes. The longest honest lists are ranges of a watermark.
MAX_ITEMS = 10_000
MAX_STRING_BYTES = 10_000

Dimension = int | str | EllipsisType


@dataclass(frozen=True, slots=True)
class ArraySpec:
    """What one array field must be. A number is a fixed length; a letter is the same length all over the
    message; (..., "d") stands for d axes of at least one point each."""

    dtype: str
    shape: tuple[Dimension, ...]


def _floats(*shape: Dimension) -> ArraySpec:
    return ArraySpec("<f8", shape)


_ESTIMATE = {
    "means": _floats("d", "c"),
    "covariances": _floats("c", "d", "d"),
    "masses": _floats("c"),
    "radii": _floats("c"),
    "velocities": _floats("d", "c"),
    "found": _floats("d", "f"),
    "found_covariances": _floats("f", "d", "d"),
    "found_velocities": _floats("d", "f"),
    "found_times": _floats("f"),
    "found_labels": ArraySpec("<i8", ("f",)),
}

ARRAYS: dict[type[m.Message], dict[str, ArraySpec]] = {
    m.PoseMessage: {"pose": _floats(4), "velocity": _floats(3)},
    m.MeasurementSetMessage: {"pose": _floats(4), "measurements": _floats("m", "s")},
    m.SoftObservationMessage: {"points": _floats("p", 2)},
    m.BidMessage: {"places": _floats("t", "d")},
    m.PlanMessage: {
        "waypoint": _floats(3),
        "measure_times": _floats("m"),
        "measure_poses": _floats("m", 4),
        "times": _floats("k"),
        "poses": _floats("k", 4),
    },
    m.PosteriorMessage: _ESTIMATE,
    m.BeliefMessage: _ESTIMATE,
    m.PictureMessage: {
        "exploration": ArraySpec("|u1", (..., "d")),
        "points": ArraySpec("<f4", ("d", "k")),
        "weights": ArraySpec("<f4", ("k",)),
    },
    m.StartMessage: {"answers": _floats(2)},
    m.HealthMessage: {"histograms": ArraySpec("<i8", (BINS,))},
    m.TruthMessage: {"targets": _floats("d", "n")},
}

# Bounds of the letters; a letter that is not here may be 0 or more. They also rule out arrays without bytes
# that claim a huge length on another axis.
LIMITS = {"d": (2, 3), "s": (1, 16), "p": (1, 64)}

# Of a soft observation: how many points each relation may have, and how large its metres may be.
POINTS = {
    **dict.fromkeys(("near", "around", "far"), (1, 1)),
    **dict.fromkeys(("inside", "outside"), (3, 64)),
    **dict.fromkeys(("in_front", "behind", "left", "right"), (1, 2)),
}
FARTHEST_M = 1e7

_DTYPES = {name: np.dtype(name) for name in ("<f8", "<f4", "|u1", "<i8")}


@dataclass(frozen=True, slots=True)
class _Layout:
    """What `decode` checks in one type of message."""

    fields: tuple[str, ...]
    arrays: tuple[tuple[str, np.dtype[Any], tuple[Dimension, ...]], ...]
    floats: tuple[str, ...]
    float_maps: tuple[str, ...]


@cache
def _layout(kind: type[m.Message]) -> _Layout:
    hints = get_type_hints(kind)
    return _Layout(
        kind.__struct_fields__,
        tuple((name, _DTYPES[spec.dtype], spec.shape) for name, spec in ARRAYS.get(kind, {}).items()),
        tuple(name for name in kind.__struct_fields__ if hints[name] is float),
        tuple(name for name in kind.__struct_fields__ if hints[name] == dict[str, float]),
    )


def encode(message: m.Message) -> bytes:
    """The payload of a message. Arrays are brought to their declared dtype.

    Raises:
        TypeError: if an array cannot be brought to its dtype without loss of kind (float to integer).
    """
    layout = _layout(type(message))
    fields: dict[str, Any] = {name: getattr(message, name) for name in layout.fields}
    for name, dtype, _ in layout.arrays:
        value = fields[name]
        fields[name] = (
            {key: _pack(array, dtype) for key, array in value.items()}
            if isinstance(value, dict)
            else _pack(value, dtype)
        )
    packed: bytes = msgpack.packb(fields, default=msgspec.structs.asdict)
    return packed


def _pack(array: m.Array, dtype: np.dtype[Any]) -> dict[str, Any]:
    if array.dtype != dtype:
        array = array.astype(dtype, casting="same_kind")
    return {"d": dtype.str, "s": array.shape, "b": array.tobytes()}


def decode(topic: Topic, payload: bytes, *, team: str, sender: str) -> m.Message:
    """The message in a payload that came on `topic` from the key of `sender` in `team`.

    Raises:
        MalformedMessage: with the reason oversize, not_msgpack, schema_version, wrong_type, wrong_team,
            wrong_sender, not_finite or wrong_shape.
    """
    if len(payload) > topic.max_bytes:
        raise MalformedMessage("oversize", f"{len(payload)} bytes, allowed are {topic.max_bytes}")
    try:
        raw = msgpack.unpackb(
            payload,
            raw=False,
            strict_map_key=True,
            max_str_len=MAX_STRING_BYTES,
            max_bin_len=len(payload),
            max_array_len=MAX_ITEMS,
            max_map_len=MAX_ITEMS,
            max_ext_len=0,
        )
    except Exception as error:  # whatever the parser says of garbage, it is the sender's doing
        raise MalformedMessage("not_msgpack", str(error)) from None
    if not isinstance(raw, dict):
        raise MalformedMessage("wrong_type", f"expected a map, got {type(raw).__name__}")
    version = raw.get("version")
    if type(version) is not int or version != m.SCHEMA_VERSION:
        raise MalformedMessage("schema_version", f"got {repr(version)[:40]}, this is {m.SCHEMA_VERSION}")
    try:
        message = msgspec.convert(raw, topic.message, strict=True, dec_hook=_unpack)
    except msgspec.ValidationError as error:
        raise MalformedMessage("wrong_type", str(error)) from None
    if message.team != team:
        raise MalformedMessage("wrong_team", f"{message.team!r} on a key of {team!r}")
    if message.sender != sender:
        raise MalformedMessage("wrong_sender", f"{message.sender!r} on a key of {sender!r}")
    _check(message)
    return message


def _unpack(kind: type, raw: Any) -> m.Array:
    """An array from its wire form; msgspec calls this for every array field."""
    if not isinstance(raw, dict) or len(raw) != 3:
        raise MalformedMessage("wrong_type", "an array is a map of d, s and b")
    name, shape, data = raw.get("d"), raw.get("s"), raw.get("b")
    dtype = _DTYPES.get(name) if isinstance(name, str) else None
    if dtype is None or not isinstance(shape, list) or not isinstance(data, bytes):
        raise MalformedMessage("wrong_type", "an array is a map of d, s and b")
    size = dtype.itemsize
    for length in shape:
        if type(length) is not int or not 0 <= length < 2**31:
            raise MalformedMessage("wrong_shape", repr(shape)[:80])
        size *= length
    if len(shape) > 4 or size != len(data):
        raise MalformedMessage("wrong_shape", f"{repr(shape)[:80]} of {name} is not {len(data)} bytes")
    if not data:
        return np.zeros(shape, dtype)
    return np.ndarray(shape, dtype, bytearray(data))


def _check(message: m.Message) -> None:
    layout = _layout(type(message))
    for name in layout.floats:
        if not math.isfinite(getattr(message, name)):
            raise MalformedMessage("not_finite", name)
    for name in layout.float_maps:
        if not all(map(math.isfinite, getattr(message, name).values())):
            raise MalformedMessage("not_finite", name)
    lengths: dict[str, int] = {}
    for name, dtype, shape in layout.arrays:
        value = getattr(message, name)
        for array in value.values() if type(value) is dict else (value,):
            if array.dtype is not dtype and array.dtype != dtype:
                raise MalformedMessage("wrong_type", f"{name}: {array.dtype.str}, expected {dtype.str}")
            if array.shape != shape and not _fits(array.shape, shape, lengths):
                raise MalformedMessage("wrong_shape", f"{name}: {array.shape} where {lengths} hold")
            if dtype.kind == "f" and not _finite(array):
                raise MalformedMessage("not_finite", name)
    if isinstance(message, m.SoftObservationMessage):
        _check_soft_observation(message)
    elif isinstance(message, m.BidMessage):
        _check_bid(message)
    elif isinstance(message, m.RequestMessage):
        _check_wish(message.wish)


def _check_soft_observation(message: m.SoftObservationMessage) -> None:
    """What its fields must be for the relation. Whether a polygon makes sense is the receiver's to see."""
    fewest, most = POINTS[message.relation]
    if not fewest <= len(message.points) <= most:
        raise MalformedMessage("wrong_shape", f"points: {len(message.points)} for {message.relation!r}")
    if np.abs(message.points).max() > FARTHEST_M:
        raise MalformedMessage("wrong_type", f"points: beyond {FARTHEST_M:g} m")
    inner, outer = message.inner, message.outer
    if most == 1 and not 0.0 < inner < outer <= FARTHEST_M:
        raise MalformedMessage("wrong_type", f"inner, outer: {inner:g} and {outer:g} m for a distance")
    if most == 2 and not (inner == 0.0 and 0.0 <= outer <= FARTHEST_M):
        raise MalformedMessage("wrong_type", f"inner, outer: {inner:g} and {outer:g} m for a side")
    if fewest == 3 and (inner, outer) != (0.0, 0.0):
        raise MalformedMessage("wrong_type", f"inner, outer: {inner:g} and {outer:g} m for a region")


def _check_bid(message: m.BidMessage) -> None:
    if len(message.places) != len(message.tasks):
        raise MalformedMessage("wrong_shape", f"places: {len(message.places)} for {len(message.tasks)} tasks")
    if message.winning_bids.keys() != message.winning_agents.keys():
        raise MalformedMessage("wrong_type", "winning_bids and winning_agents are of different tasks")
    for wish in message.wishes:
        _check_wish(wish)


def _check_wish(wish: m.Wish) -> None:
    if not all(map(math.isfinite, (*wish.place, wish.worth, wish.asked))):
        raise MalformedMessage("not_finite", f"request {wish.name}")


def _finite(array: m.Array) -> bool:
    # The square sum is several times quicker on small arrays; it may overflow where every number is finite.
    return math.isfinite(np.vdot(array, array)) or bool(np.isfinite(array).all())


def _fits(actual: tuple[int, ...], pattern: tuple[Dimension, ...], lengths: dict[str, int]) -> bool:
    """Whether a shape has the pattern's; letters met for the first time are entered in `lengths`."""
    if pattern[0] is ...:
        return 0 not in actual and _fits((len(actual),), pattern[1:], lengths)
    if len(actual) != len(pattern):
        return False
    for length, expected in zip(actual, pattern, strict=True):
        if isinstance(expected, str):
            low, high = LIMITS.get(expected, (0, length))
            if not low <= length <= high or lengths.setdefault(expected, length) != length:
                return False
        elif length != expected:
            return False
    return True
