"""Messages to bytes and back, for one sender: MAVLink 2 only, signed with keys, counted."""

import time
from collections import Counter
from collections.abc import Callable, Iterable

from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.framing import Frame, Framer
from bridges.mavlink.signing import Keys

AUTOPILOT = 1  # component id
Address = object  # of a peer, as its carrier names it
HEARTBEAT = 0


class Wire:
    """Packs and parses. Not thread-safe: one thread owns a link."""

    def __init__(
        self,
        source: tuple[int, int],
        keys: Keys | None = None,
        heed: Callable[[int, int, int], bool] | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """`heed(system, component, message)` says which frames are worth parsing; None: all."""
        self._packer = mavlink.MAVLink(None, *source)
        self._packer.signing.sign_outgoing = keys is not None
        self._parser = mavlink.MAVLink(None)
        self._keys = keys
        self._heed = heed
        self._clock = clock
        self._framers: dict[Address, Framer] = {}
        self.counters: Counter[str] = Counter()
        self.version1: set[int] = set()  # systems that sent MAVLink 1
        self.unsigned: set[int] = set()  # systems whose frames were not believed
        self.signing: set[int] = set()  # systems that sign
        self.arrived: dict[int, int] = {}  # frames of each system's autopilot
        self.missed: dict[int, int] = {}  # those that its numbers show to be lost
        self._numbers: dict[int, int] = {}  # each one's last
        if keys is not None:
            self._packer.signing.secret_key = keys.secret
            self._packer.signing.link_id = keys.link

    def __repr__(self) -> str:
        return f"Wire({self.source}, {dict(self.counters)})"

    @property
    def source(self) -> tuple[int, int]:
        """System and component id that we send as."""
        return self._packer.srcSystem, self._packer.srcComponent

    @source.setter
    def source(self, value: tuple[int, int]) -> None:
        self._packer.srcSystem, self._packer.srcComponent = value

    def pack(self, message: Message) -> bytes:
        """The bytes of a message, numbered and signed."""
        if self._keys is not None:
            self._packer.signing.timestamp = self._keys.next_stamp(self._clock())
        data = bytes(message.pack(self._packer))
        self._packer.seq = (self._packer.seq + 1) % 256
        self.counters["sent"] += 1
        return data

    def parse(self, data: bytes, address: Address = None, whole: bool = False) -> Iterable[Message]:
        """The messages in bytes from one peer; `whole`: a datagram, which holds no half frames."""
        framer = self._framers.get(address)
        if framer is None:
            if len(self._framers) >= 64:  # a flood of made-up addresses
                self._framers.clear()
            framer = self._framers[address] = Framer()
        before = (framer.garbage, framer.broken, framer.unknown)
        for frame in framer.feed(data):
            message = self._message(frame)
            if message is not None:
                yield message
        if whole:
            framer.end()
        after = (framer.garbage, framer.broken, framer.unknown)
        for name, old, new in zip(
            ("garbage_bytes", "broken_frames", "unknown_messages"), before, after, strict=True
        ):
            if new != old:
                self.counters[name] += new - old

    def forget(self) -> None:
        """The connection was lost: no half frame goes on in the next."""
        self._framers.clear()
        self._numbers.clear()

    def _count(self, frame: Frame, known: bool) -> None:
        """Also those that nobody heeds: a number that is left out would look like a loss."""
        system = frame.system
        last = self._numbers.get(system)
        gap = 0 if last is None else (frame.sequence - last - 1) % 256
        if not known and gap:
            return  # it may be anything
        if gap < 128:
            self.missed[system] = self.missed.get(system, 0) + gap
        self.arrived[system] = self.arrived.get(system, 0) + 1
        self._numbers[system] = frame.sequence

    def _message(self, frame: Frame) -> Message | None:
        known = frame.message in mavlink.mavlink_map
        if frame.component == AUTOPILOT:
            self._count(frame, known)
        if not known:
            return None
        self.counters["received"] += 1
        if frame.version == 1:
            self.version1.add(frame.system)
            self.counters["version1"] += 1
            return None
        self.version1.discard(frame.system)
        if frame.signed:
            self.signing.add(frame.system)
        if self._keys is not None:
            trouble = self._keys.trouble(frame)
            if trouble is not None:
                self.counters[f"rejected.{trouble}"] += 1
                self.unsigned.add(frame.system)
                return None
            self.unsigned.discard(frame.system)
        if self._heed is not None and not self._heed(frame.system, frame.component, frame.message):
            self.counters["unheeded"] += 1
            return None
        try:
            return self._parser.decode(bytearray(frame.data))
        except mavlink.MAVError:
            self.counters["broken_frames"] += 1
            return None
