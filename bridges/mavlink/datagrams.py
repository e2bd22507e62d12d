"""Measurement sets from a companion detector: one MessagePack map in one UDP datagram.

| key | | |
| --- | --- | --- |
| `v` | integer | 1, the version of this format |
| `age_s` | number | seconds since the picture was taken, when the datagram was sent |
| `unix_s` | number | or instead: when it was taken, on a clock that agrees with the robot's |
| `z` | list of lists | a row of numbers for each thing seen, as the sensor's `model` has them; [] for none |
| `seq` | integer | optional, grows with every datagram of a sender: so losses are counted |

A datagram that is not like that is not taken; `reading` says why in a fixed word, for counting.
"""

from dataclasses import dataclass
from math import isfinite
from typing import Any

import msgpack
import numpy as np

from estimator.arrays import FloatArray

VERSION = 1
KEYS = frozenset({"v", "age_s", "unix_s", "z", "seq"})
LARGEST = 60_000  # bytes
FUTURE_S = 0.05  # by which clocks that agree may differ


class Refused(ValueError):
    """A datagram that is not taken; the word is for counting, the sentence for people."""

    def __init__(self, word: str, sentence: str) -> None:
        super().__init__(sentence)
        self.word = word


@dataclass(frozen=True, slots=True)
class Reading:
    """What a datagram says."""

    age: float  # s, when it arrived
    sequence: int | None
    rows: FloatArray  # (m, s)


def reading(data: bytes, arrived_unix: float, size: int, most: int, oldest: float) -> Reading:
    """The set in a datagram that arrived at `arrived_unix`, of rows with `size` numbers.

    Raises:
        Refused: if it is none.
    """
    table = _table(data)
    age = _age(table, arrived_unix)
    if not isfinite(age):
        raise Refused("not_finite", "its time is no number")
    if age < -FUTURE_S:
        raise Refused("future", f"it was taken {-age:.2f} s from now; the clocks differ: send age_s instead")
    if age > oldest:
        raise Refused("too_old", f"it was taken {age:.2f} s ago, longer than max_age_s = {oldest:g}")
    sequence = table.get("seq")
    if sequence is not None and (type(sequence) is not int or sequence < 0):
        raise Refused("seq", f"seq is {sequence!r}, expected a whole number from 0")
    return Reading(max(age, 0.0), sequence, _rows(table["z"], size, most))


def _table(data: bytes) -> dict[str, Any]:
    if len(data) > LARGEST:
        raise Refused("too_large", f"it has {len(data)} bytes, more than {LARGEST}")
    try:
        table = msgpack.unpackb(
            data, strict_map_key=True, max_array_len=10_000, max_map_len=16, max_str_len=64, max_bin_len=0
        )
    except (ValueError, TypeError, RecursionError):  # all that msgpack raises on garbage
        raise Refused("not_msgpack", "it is no MessagePack") from None
    if not isinstance(table, dict):
        raise Refused("not_a_map", f"it holds a {type(table).__name__}, expected a map")
    if table.get("v") != VERSION:
        raise Refused("version", f"v is {table.get('v')!r}, expected {VERSION}")
    unknown = [str(key) for key in table if key not in KEYS]
    if unknown:
        raise Refused("unknown_key", f"unknown key {unknown[0][:40]!r}; known are {', '.join(sorted(KEYS))}")
    if "z" not in table:
        raise Refused("no_set", "z is missing; send [] for nothing seen")
    return table


def _age(table: dict[str, Any], arrived_unix: float) -> float:
    given = [key for key in ("age_s", "unix_s") if key in table]
    if len(given) != 1:
        raise Refused("time", "expected exactly one of age_s and unix_s")
    value = table[given[0]]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Refused("time", f"{given[0]} is {str(value)[:40]!r}, expected a number")
    return float(value) if given[0] == "age_s" else arrived_unix - float(value)


def _rows(rows: Any, size: int, most: int) -> FloatArray:
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        raise Refused("shape", "z is expected to be a list of lists")
    if len(rows) > most:
        raise Refused("too_many", f"it has {len(rows)} measurements, more than most = {most}")
    for row in rows:
        if len(row) != size:
            raise Refused("shape", f"a measurement has {len(row)} numbers, the sensor's model has {size}")
        if any(isinstance(value, bool) or not isinstance(value, int | float) for value in row):
            raise Refused("shape", "a measurement holds something that is no number")
    try:
        found = np.array(rows, dtype=np.float64).reshape(len(rows), size)
    except OverflowError:
        raise Refused("not_finite", "a number is too large") from None
    if not np.isfinite(found).all():
        raise Refused("not_finite", "a measurement holds a number that is none (NaN or infinite)")
    return found
