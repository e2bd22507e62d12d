"""The wire of a simulated vehicle: bytes to messages and back, and what goes wrong on the way."""

import random
from collections.abc import Hashable, Iterable

from bridges.mavlink.dialect import Message, mavlink
from sim.mavlink.settings import Faults, Settings

MARKER_2 = 0xFD
SIGNING_EPOCH = 1_420_070_400.0  # s since 1970 at 2015-01-01, from which signatures count 10 µs


class _Nowhere:
    def write(self, data: bytes) -> None:
        """pymavlink wants a file; frames are taken from `pack`."""


class Port:
    """Parses each peer's bytes by themselves, and packs what the vehicle says once for all."""

    def __init__(self, settings: Settings, faults: Faults) -> None:
        self._settings, self._faults = settings, faults
        self._chance = random.Random(settings.seed)
        self._packer = self._made()
        self._parsers: dict[Hashable, mavlink.MAVLink] = {}
        self._junk = self._flood = 0.0
        self.last = 0.0
        self.rejected = 0  # pieces that were no frame, or not signed as they must be

    def __repr__(self) -> str:
        return f"Port({len(self._parsers)} peers, {self.rejected} rejected)"

    def receive(self, peer: Hashable, data: bytes, time: float) -> list[Message]:
        """The messages that a peer's bytes complete."""
        if self._faults.active("deaf", time):
            return []
        if peer not in self._parsers:
            self._parsers[peer] = self._made()
            self._parsers[peer].signing.timestamp = self._signing_time(time)
        heard: list[Message] = []
        for message in self._parsers[peer].parse_buffer(data) or []:
            if message.get_type() == "BAD_DATA":
                self.rejected += 1
            elif message.get_type().startswith("UNKNOWN") or self._lost(time):
                continue
            elif not self._settings.version_1 or message.get_msgbuf()[0] != MARKER_2:
                heard.append(message)
        return heard

    def forget(self, peer: Hashable) -> None:
        """A connection was closed: what it began is no frame of the next one."""
        self._parsers.pop(peer, None)

    def send(self, messages: Iterable[Message], time: float) -> list[bytes]:
        """Frames, in order; faults may add to them and take from them."""
        frames: list[bytes] = []
        for message in messages:
            frames.extend(self._framed(message, time))
        frames.extend(self._unasked(time))
        self.last = time
        return [] if self._faults.active("mute", time) else frames

    def _framed(self, message: Message, time: float) -> list[bytes]:
        kind = message.get_type()
        if kind == "HEARTBEAT" and self._faults.active("no_heartbeat", time):
            return []
        if kind == "COMMAND_ACK" and self._happens("lost_acks", time):
            return []
        if self._lost(time):
            return []
        frame = self._packed(message, time)
        if self._happens("truncated", time):
            return [frame[: self._chance.randrange(1, len(frame))]]
        return [frame, frame] if self._happens("repeated", time) else [frame]

    def _packed(self, message: Message, time: float) -> bytes:
        signing = self._packer.signing
        signing.timestamp = max(signing.timestamp, self._signing_time(time))
        frame: bytes = message.pack(self._packer, force_mavlink1=self._settings.version_1)
        self._packer.seq = (self._packer.seq + 1) % 256
        return frame

    def _unasked(self, time: float) -> list[bytes]:
        """What floods and garbage make of the time since the last call."""
        frames: list[bytes] = []
        since = max(time - self.last, 0.0)
        self._junk += self._faults.amount("garbage", time) * since
        if self._junk >= 1.0:
            frames.append(self._chance.randbytes(int(self._junk)))
            self._junk %= 1.0
        self._flood += self._faults.amount("flood", time) * since
        while self._flood >= 1.0:
            self._flood -= 1.0
            ms = round(time * 1000) % 2**32
            frames.append(self._packed(mavlink.MAVLink_named_value_float_message(ms, b"flood", time), time))
        return frames

    def _lost(self, time: float) -> bool:
        return self._happens("lost_messages", time)

    def _happens(self, kind: str, time: float) -> bool:
        chance = self._faults.amount(kind, time)  # type: ignore[arg-type]
        return chance > 0.0 and self._chance.random() < chance

    def _signing_time(self, time: float) -> int:
        return round((self._settings.unix_start + time - SIGNING_EPOCH) * 1e5)

    def _made(self) -> "mavlink.MAVLink":
        made = mavlink.MAVLink(_Nowhere(), srcSystem=self._settings.system_id, srcComponent=1)
        made.robust_parsing = True
        key = self._settings.signing_key
        if key is not None:
            made.signing.secret_key = key
            made.signing.sign_outgoing = True
            made.signing.allow_unsigned_callback = _only_radio
        return made


def _only_radio(parser: "mavlink.MAVLink", message_id: int) -> bool:
    """Unsigned, only the telemetry radio's own status is heard."""
    return message_id == 109
