"""A filter's state to bytes and back, exactly: every bit of every number, and the layout of every array.

Checkpoints of the ledger and robots that go on without a fusion need it. A state is a tree of frozen
dataclasses, arrays and plain values. The bytes name classes, so they say what is made of them; therefore
nothing is made but dataclasses of modules that are loaded already, and none of their code is called
(pickle would run whatever the bytes ask for). What both sides have anyway and is no plain value (the
area with its map) is not sent: it stands in the filter's initial state and is referred to by its place there.

The layout counts because compiled kernels and sums go through an array in another order, and so to other
last bits, when its strides are others.
"""

import dataclasses
import hashlib
import platform
import sys
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgpack
import numpy as np

from agents.errors import DataError
from agents.mission.mission import Mission
from agents.mission.mission_file import mission_hash

VERSION = 1  # of this encoding
_PLAIN = (bool, int, float, str, bytes, type(None))
_MOST_BYTES = 256_000_000
_DEPTH = 32


class Snapshots:
    """Encodes and decodes states that grew out of one initial state."""

    def __init__(self, initial: Any, fingerprint: str) -> None:
        """`fingerprint` is of the code and the mission; bytes of another are not decoded."""
        self.fingerprint = fingerprint
        self._known = list(_objects(initial))
        self._places = {id(value): place for place, value in enumerate(self._known)}

    def __repr__(self) -> str:
        return f"Snapshots({self.fingerprint[:12]}, known={len(self._known)})"

    def encode(self, state: Any) -> bytes:
        """The bytes of a state.

        Raises:
            TypeError: if it holds something else than dataclasses, arrays, tuples, lists, dictionaries and
                plain values; names the type.
        """
        packed: bytes = msgpack.packb([VERSION, self.fingerprint, self._tree(state)])
        return hashlib.sha256(packed).digest() + packed

    def decode(self, payload: bytes) -> Any:
        """The state in the bytes.

        Raises:
            DataError: if they were damaged, or made by other code or for another mission.
        """
        packed = payload[32:]
        if hashlib.sha256(packed).digest() != payload[:32]:
            raise DataError("the state was damaged: its checksum is another")
        try:
            found = msgpack.unpackb(packed, strict_map_key=False, max_bin_len=_MOST_BYTES)
            if found[:2] != [VERSION, self.fingerprint]:
                raise DataError("the state is of other code or of another mission")
            return self._value(found[2], _DEPTH)
        except DataError:
            raise
        except Exception as error:  # whatever is wrong in it, it is no state
            raise DataError(f"not a state: {error}") from None

    def _tree(self, value: Any) -> Any:
        place = self._places.get(id(value))
        if place is not None:
            return ["r", place]
        if isinstance(value, np.ndarray):
            return ["a", *_array(value)]
        if isinstance(value, np.generic):
            return ["n", value.dtype.str, value.tobytes()]
        if isinstance(value, _PLAIN) and type(value) in _PLAIN:
            return value
        if type(value) is tuple:
            return ["t", [self._tree(item) for item in value]]
        if type(value) is list:
            return ["l", [self._tree(item) for item in value]]
        if type(value) is dict:
            return ["d", [[self._tree(key), self._tree(item)] for key, item in value.items()]]
        if dataclasses.is_dataclass(value):
            kind = type(value)
            fields = [self._tree(getattr(value, field.name)) for field in dataclasses.fields(value)]
            return ["c", kind.__module__, kind.__qualname__, fields]
        raise TypeError(f"a state cannot hold a {type(value).__name__}")

    def _value(self, tree: Any, depth: int) -> Any:
        if not isinstance(tree, list):
            return tree
        if depth == 0:
            raise DataError("not a state: nested too deeply")
        match tree:
            case ["r", place]:
                return self._known[place]
            case ["a", dtype, shape, strides, start, data]:
                return _restored(dtype, shape, strides, start, data)
            case ["n", dtype, data]:
                return np.frombuffer(data, dtype)[0]
            case ["t", items]:
                return tuple(self._value(item, depth - 1) for item in items)
            case ["l", items]:
                return [self._value(item, depth - 1) for item in items]
            case ["d", items]:
                return {self._value(key, depth - 1): self._value(item, depth - 1) for key, item in items}
            case ["c", module, name, fields]:
                return self._instance(module, name, fields, depth)
            case _:
                raise DataError("not a state: an unknown mark")

    def _instance(self, module: str, name: str, trees: list[Any], depth: int) -> Any:
        kind: Any = sys.modules.get(module)
        for part in name.split("."):
            kind = getattr(kind, part, None)
        if not isinstance(kind, type) or not dataclasses.is_dataclass(kind):
            raise DataError(f"not a state: no dataclass {module}.{name}")
        fields = dataclasses.fields(kind)
        made = object.__new__(kind)
        for field, tree in zip(fields, trees, strict=True):
            object.__setattr__(made, field.name, self._value(tree, depth - 1))
        return made


def _objects(value: Any) -> Iterator[Any]:
    """All that a state holds and that is neither array nor plain value, in one order for ever."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield value
        for field in dataclasses.fields(value):
            yield from _objects(getattr(value, field.name))
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _objects(item)
    elif isinstance(value, dict):
        for item in value.values():
            yield from _objects(item)
    elif not isinstance(value, (*_PLAIN, np.ndarray, np.generic)):
        yield value


def _array(value: np.ndarray[Any, Any]) -> list[Any]:
    """dtype, shape, strides (None: contiguous), offset of the first element, bytes."""
    if value.dtype.hasobject:
        raise TypeError("a state cannot hold an array of objects")
    if value.flags.c_contiguous:
        return [value.dtype.str, list(value.shape), None, 0, value.tobytes()]
    reach = [(n - 1) * step for n, step in zip(value.shape, value.strides, strict=True)]
    start = -sum(step for step in reach if step < 0)
    size = start + sum(step for step in reach if step > 0) + value.itemsize
    data = bytearray(size)
    np.ndarray(value.shape, value.dtype, data, start, value.strides)[...] = value
    return [value.dtype.str, list(value.shape), list(value.strides), start, bytes(data)]


def _restored(
    dtype: str, shape: list[int], strides: list[int] | None, start: int, data: bytes
) -> np.ndarray[Any, Any]:
    if np.dtype(dtype).hasobject:
        raise DataError("not a state: an array of objects")
    if not data:
        return np.zeros(shape, dtype)
    return np.ndarray(shape, dtype, bytearray(data), start, strides)


def fingerprint(mission: Mission, seed: int, filter: object) -> str:
    """64 hexadecimal digits: the same only if the same sets give the same state, as far as one can tell.

    Of the mission, the seed, the code of the estimator and of the filter's own package, and the versions of
    what computes. Two processors may still differ in last bits.
    """
    words = f"{mission_hash(mission)} {seed} {_code(type(filter).__module__)}"
    return hashlib.sha256(words.encode()).hexdigest()


@cache
def _code(module: str) -> str:
    here = Path(__file__).resolve().parents[2]
    paths = [
        *here.glob("estimator/**/*.py"),
        here / "agents/fusion/estimate.py",
        here / "agents/fusion/timeline.py",
    ]
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is not None and not Path(file).is_relative_to(here / "estimator"):
        paths += Path(file).parent.glob("*.py")
    digest = hashlib.sha256()
    for name in ("numpy", "numba", "scipy"):
        digest.update(f"{name} {version(name)} ".encode())
    digest.update(f"{platform.python_version()} {platform.machine()}".encode())
    for path in sorted(paths):
        digest.update(path.read_bytes())
    return digest.hexdigest()
