"""An autopilot's parameters, read by name. They are never written: what they say is the operator's choice."""

import struct

from bridges.mavlink.dialect import Message, mavlink

TRIES = 4
PATIENCE = 0.7  # s
WIDTH = 5  # asked at a time
_INTEGERS = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}


def decode(value: float, kind: int, bytewise: bool) -> float:
    """A PARAM_VALUE's number. PX4 puts an integer's bytes into the float's place, ArduPilot converts it."""
    if bytewise and kind in _INTEGERS:
        data = struct.pack("<f", value)
        form = _INTEGERS[kind]
        return float(struct.unpack(form, data[: struct.calcsize(form)])[0])
    return float(value)


class Parameters:
    """Asks for each name until it is answered; what is never answered the autopilot does not have."""

    def __init__(self, system: int, component: int = 1) -> None:
        self._target = (system, component)
        self._waiting: list[str] = []
        self._asked: dict[str, tuple[float, int]] = {}  # name -> when to ask again, tries
        self.values: dict[str, float] = {}
        self.missing: set[str] = set()

    def __repr__(self) -> str:
        return (
            f"Parameters({len(self.values)} read, {len(self.missing)} missing, {len(self._waiting)} waiting)"
        )

    @property
    def done(self) -> bool:
        return not self._waiting and not self._asked

    def read(self, names: tuple[str, ...]) -> None:
        """Ask for these, also if they are known."""
        self._waiting += [name for name in names if name not in self._asked and name not in self._waiting]

    def hear(self, message: Message, bytewise: bool) -> None:
        """Take in a PARAM_VALUE."""
        name = (
            message.param_id
            if isinstance(message.param_id, str)
            else message.param_id.decode("ascii", "replace")
        )
        name = name.rstrip("\x00")
        if name in self._asked:
            self.values[name] = decode(message.param_value, message.param_type, bytewise)
            self.missing.discard(name)
            del self._asked[name]

    def step(self, now: float) -> list[Message]:
        """The questions that are due."""
        out = []
        for name, (due, tries) in list(self._asked.items()):
            if now < due:
                continue
            if tries >= TRIES:
                self.missing.add(name)
                del self._asked[name]
            else:
                out.append(self._question(name, now, tries))
        while self._waiting and len(self._asked) < WIDTH:
            out.append(self._question(self._waiting.pop(0), now, 0))
        return out

    def _question(self, name: str, now: float, tries: int) -> Message:
        self._asked[name] = (now + PATIENCE, tries + 1)
        return mavlink.MAVLink_param_request_read_message(*self._target, name.encode("ascii"), -1)
