"""The parameter protocol: each autopilot with its own way of putting an integer into a float."""

import math
import struct
from collections import deque

from bridges.mavlink.dialect import Message, mavlink
from sim.mavlink.parameter_tables import Table

WIRE_TYPES = {"b": 2, "h": 4, "i": 6, "f": 9}  # MAV_PARAM_TYPE
RANGES = {"b": (-128, 127), "h": (-32768, 32767), "i": (-(2**31), 2**31 - 1)}
BURST = 8  # values a tick that a whole list is sent with


class Parameters:
    """Named values. Reading one that it has not is an error of the simulation, not of a client."""

    def __init__(self, table: Table, bytewise: bool, changed: dict[str, float]) -> None:
        self._types = {name: kind for name, (kind, _) in table.items()}
        self._values = {name: float(value) for name, (_, value) in table.items()}
        self._names = sorted(self._values)
        self._bytewise = bytewise
        self._listing: deque[int] = deque()
        for name, value in changed.items():
            self[name] = value

    def __repr__(self) -> str:
        return f"Parameters({len(self._values)}, listing={len(self._listing)})"

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __setitem__(self, name: str, value: float) -> None:
        """Raises KeyError for a name that it has not."""
        if name not in self._values:
            raise KeyError(f"no parameter {name}")
        kind = self._types[name]
        if kind == "f":
            value = struct.unpack("<f", struct.pack("<f", value))[0]
        else:
            low, high = RANGES[kind]
            value = min(max(round(value), low), high)
        self._values[name] = float(value)

    @property
    def count(self) -> int:
        return len(self._names)

    def receive(self, message: Message) -> list[Message]:
        """The answers to a PARAM_* message; a list follows with `tick`."""
        kind = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            self._listing = deque(range(len(self._names)))
            return []
        if kind == "PARAM_REQUEST_READ":
            if 0 <= message.param_index < len(self._names):
                return [self._value(message.param_index)]
            return self._named(message.param_id)
        if kind == "PARAM_SET":
            return self._set(message)
        return []

    def tick(self) -> list[Message]:
        """The next values of a list that was asked for."""
        return [self._value(self._listing.popleft()) for _ in range(min(BURST, len(self._listing)))]

    def _set(self, message: Message) -> list[Message]:
        """An impossible value changes nothing: the old one is told, as both autopilots do."""
        name = _text(message.param_id)
        if name in self._values:
            value = self._decode(message.param_value, message.param_type)
            if math.isfinite(value):
                self[name] = value
        return self._named(message.param_id)

    def _named(self, identity: str | bytes) -> list[Message]:
        name = _text(identity)
        return [self._value(self._names.index(name))] if name in self._values else []

    def _value(self, index: int) -> Message:
        name = self._names[index]
        kind, value = self._types[name], self._values[name]
        sent = value
        if self._bytewise and kind != "f":
            sent = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        return mavlink.MAVLink_param_value_message(
            name.encode(), sent, WIRE_TYPES[kind], len(self._names), index
        )

    def _decode(self, value: float, kind: int) -> float:
        if self._bytewise and kind != 9:
            return float(struct.unpack("<i", struct.pack("<f", value))[0])
        return value


def _text(identity: str | bytes) -> str:
    if isinstance(identity, bytes):
        return identity.split(b"\0")[0].decode("ascii", "replace")
    return identity.split("\0")[0]
