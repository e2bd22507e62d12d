"""How good a simulated network is, and the luck of each message on it."""

import msgpack
import msgspec
import numpy as np

from estimator.arrays import Fraction, NonNegative, Positive

NAN = b"\x00\x00\x00\x00\x00\x00\xf8\x7f"  # float64, little-endian


class NetworkConditions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How good the network is."""

    delay_s: NonNegative = 0.002
    jitter_s: NonNegative = 0.001  # standard deviation of an exponential extra delay
    loss: Fraction = 0.0  # share of messages, on every link
    burst: NonNegative = 0.0  # mean number of messages lost in a row (Gilbert 1960); up to 1: independent
    duplication: Fraction = 0.0
    late: Fraction = 0.0  # share of messages that take `late_s` longer
    late_s: NonNegative = 0.0
    corruption: Fraction = 0.0  # share of messages that arrive as something else
    # Links that promise nothing: no order, no recovery, no history, nothing kept in a short cut.
    datagrams: bool = False
    reach_m: NonNegative = 0.0  # robots farther apart do not hear each other; 0: all hear all
    lease_s: Positive = 2.0  # who is not heard for so long counts as gone

    @property
    def clean(self) -> bool:
        """Whether every message simply arrives."""
        return self.loss == self.duplication == self.late == self.corruption == 0.0


class Weather:
    """Where one link is between good and bad: the two states of Gilbert's channel, a step a message."""

    __slots__ = ("_bad",)

    def __init__(self) -> None:
        self._bad = False

    def loses(self, conditions: NetworkConditions, rng: np.random.Generator) -> bool:
        """Whether the next message is lost: in the long run a share `loss`, `burst` in a row on average."""
        loss = conditions.loss
        if loss == 0.0:
            return False
        if conditions.burst <= 1.0 or loss >= 1.0:
            return bool(rng.random() < loss)
        leave = 1.0 / conditions.burst
        enter = min(1.0, leave * loss / (1.0 - loss))
        self._bad = bool(rng.random() < (1.0 - leave if self._bad else enter))
        return self._bad


def corrupted(payload: bytes, rng: np.random.Generator) -> bytes:
    """What is left of a payload: never a message that could be taken for another good one."""
    way = int(rng.integers(6))
    if way == 0:
        return payload[: int(rng.integers(len(payload)))]  # truncated
    if way == 1:
        return bytes(rng.integers(0, 256, size=min(len(payload), 64), dtype=np.uint8))
    fields = msgpack.unpackb(payload, raw=False)
    if way == 2:
        fields["version"] = fields["version"] + 1
    elif way == 3:
        fields["time"] = float("nan")
    elif way == 4:
        _spoil(fields)
    else:
        fields["sequence"] = -1
    packed: bytes = msgpack.packb(fields)
    return packed


def _spoil(fields: dict[str, object]) -> None:
    """Put a NaN into the first array of numbers; without one, take away a field."""
    for value in fields.values():
        if isinstance(value, dict) and value.get("d") == "<f8" and value.get("b"):
            value["b"] = NAN + value["b"][8:]
            return
    fields.pop("boot")
