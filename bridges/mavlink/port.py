"""One end of a MAVLink link that heals itself, used by one thread.

A line that cannot be opened or is lost is tried again with growing pauses, so that a dead link costs nothing
and a healed one is found within two seconds. A TCP or serial line long silent is opened anew.
"""

import select
import socket
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field

from bridges.mavlink.carriers import Carrier, open_carrier
from bridges.mavlink.dialect import Message
from bridges.mavlink.signing import Keys
from bridges.mavlink.url import Endpoint, parse_url
from bridges.mavlink.wire import AUTOPILOT, HEARTBEAT, Wire

FIRST_PAUSE, LONGEST_PAUSE = 0.1, 1.0  # s between tries
SILENCE = 6.0  # s after which a line that should speak is opened anew
MOVES, TWICE = 3, 5.0  # so many moves of an id between addresses within s are two vehicles


@dataclass(frozen=True, slots=True)
class LinkState:
    """What the link knows that no message says."""

    open: bool = True
    trouble: str = ""  # why it is not open
    version1: frozenset[int] = frozenset()  # systems that speak MAVLink 1 only
    unsigned: frozenset[int] = frozenset()  # systems whose messages are not believed for want of a signature
    signing: frozenset[int] = frozenset()  # systems that sign
    keys: bool = False  # whether we sign
    doubled: frozenset[int] = frozenset()  # systems heard from two addresses at the same time
    arrived: Mapping[int, int] = field(default_factory=dict)  # frames of each system's autopilot
    missed: Mapping[int, int] = field(default_factory=dict)  # those that its numbers show to be lost


class Port:
    """Sends and receives messages. `wake` may be called by any thread, everything else by one."""

    def __init__(
        self,
        url: str | Endpoint,
        source: tuple[int, int] = (1, 191),
        keys: Keys | None = None,
        heed: Callable[[int, int, int], bool] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.endpoint = parse_url(url) if isinstance(url, str) else url
        self.wire = Wire(source, keys, heed)
        self.counters: Counter[str] = self.wire.counters
        self._keys = keys
        self._clock = clock
        self._carrier: Carrier | None = None
        self._trouble = "not tried yet"
        self._pause = FIRST_PAUSE
        self._next_try = 0.0
        self._heard = 0.0
        self._routes: dict[int, object] = {}  # system -> the peer that speaks for it
        self._moves: dict[int, deque[float]] = {}  # when a system was heard from another peer than before
        self._ear, self._bell = socket.socketpair()
        self._ear.setblocking(False)
        self._bell.setblocking(False)

    def __repr__(self) -> str:
        return f"Port({self.endpoint}, {'open' if self._carrier else self._trouble}, {dict(self.counters)})"

    def state(self) -> LinkState:
        """A snapshot for the pilot and for people."""
        now = self._clock()
        # One that came up again elsewhere moves once; two that take turns move again and again.
        doubled = {s for s, moves in self._moves.items() if len(moves) == MOVES and now - moves[0] < TWICE}
        return LinkState(
            open=self._carrier is not None,
            trouble=self._trouble,
            version1=frozenset(self.wire.version1),
            unsigned=frozenset(self.wire.unsigned),
            signing=frozenset(self.wire.signing),
            keys=self._keys is not None,
            doubled=frozenset(doubled),
            arrived=self.wire.arrived.copy(),
            missed=self.wire.missed.copy(),
        )

    def wake(self) -> None:
        """Let `poll` return now."""
        with suppress(OSError):
            self._bell.send(b"!")

    def poll(self, timeout: float) -> list[Message]:
        """The messages that came; waits for the first, a wake-up or `timeout` seconds."""
        deadline = self._clock() + timeout
        self._open()
        carrier = self._carrier
        if carrier is None:
            self._wait([], [], min(max(0.0, self._next_try - self._clock()), timeout))
            return []
        try:
            idle = carrier.flush()
            fd = carrier.fileno()
            self._wait([fd], [] if idle else [fd], max(0.0, deadline - self._clock()))
            found = self._read(carrier)
        except (OSError, ValueError) as error:
            self._lose(str(error) or type(error).__name__)
            return []
        if carrier.watched and self._clock() - self._heard > SILENCE:
            self._lose(f"nothing was heard for {SILENCE:g} s")
        return found

    def send(self, messages: Iterable[Message], to_all: bool = False) -> None:
        """Send now; what cannot go is dropped and counted. A target is sought where it was heard."""
        for message in messages:
            if self._carrier is None:
                self.counters["dropped"] += 1
                continue
            target = getattr(message, "target_system", 0)
            try:
                sent = self._carrier.write(
                    self.wire.pack(message), None if to_all else self._routes.get(target)
                )
            except OSError as error:
                self._lose(str(error))
                sent = False
            if not sent:
                self.counters["dropped"] += 1

    def close(self) -> None:
        """Let go of the line."""
        if self._carrier is not None:
            self._carrier.close()
        self._carrier = None
        self._ear.close()
        self._bell.close()

    def _open(self) -> None:
        if self._carrier is not None or self._clock() < self._next_try:
            return
        try:
            self._carrier = open_carrier(self.endpoint)
        except OSError as error:
            self._trouble = error.strerror or str(error)
            self.counters["failed_opens"] += 1
            self._next_try = self._clock() + self._pause
            self._pause = min(2 * self._pause, LONGEST_PAUSE)
            return
        self.counters["opened"] += 1
        self._trouble = ""
        self._heard = self._clock()

    def _lose(self, why: str) -> None:
        if self._carrier is not None:
            self._carrier.close()
        self._carrier = None
        self._trouble = why
        self.counters["lost_lines"] += 1
        self.wire.forget()
        self._next_try = self._clock() + self._pause
        self._pause = min(2 * self._pause, LONGEST_PAUSE)

    def _wait(self, read: list[int], write: list[int], timeout: float) -> None:
        poller = select.poll()  # not select: a process with many files has numbers beyond its reach
        poller.register(self._ear.fileno(), select.POLLIN)
        for fd in read:
            poller.register(fd, select.POLLIN | (select.POLLOUT if write else 0))
        for fd, _ in poller.poll(timeout * 1000):
            if fd == self._ear.fileno():
                with suppress(BlockingIOError):
                    self._ear.recv(4096)

    def _read(self, carrier: Carrier) -> list[Message]:
        found: list[Message] = []
        for data, peer in carrier.read():
            self._heard = self._clock()
            for message in self.wire.parse(data, peer, carrier.datagrams):
                found.append(message)
                self._route(message, peer)
        if found:
            self._pause = FIRST_PAUSE
        return found

    def _route(self, message: Message, peer: object) -> None:
        if message.get_msgId() != HEARTBEAT or message.get_srcComponent() != AUTOPILOT:
            return
        system, now = message.get_srcSystem(), self._clock()
        known = self._routes.get(system)
        if known is not None and known != peer:
            self._moves.setdefault(system, deque(maxlen=MOVES)).append(now)
        self._routes[system] = peer
