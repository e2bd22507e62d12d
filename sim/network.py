"""A simulated network: every message takes its time, and may be lost or doubled, all by one seed."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import msgspec
import numpy as np

from agents.topics import Topic
from agents.transport import Inbox, Peer, PeerChange, Received, Transport
from estimator.arrays import Fraction, NonNegative

Post = Callable[[float, Callable[[], None]], None]  # (delay, action): do it that much later


class NetworkConditions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How good the network is."""

    delay_s: NonNegative = 0.002
    jitter_s: NonNegative = 0.001  # standard deviation of an exponential extra delay
    loss: Fraction = 0.0
    duplication: Fraction = 0.0


@dataclass
class _Member:
    peer: Peer
    transport: "SimulatedTransport"


class SimulatedNetwork:
    """Connects the simulated transports of one run."""

    def __init__(self, conditions: NetworkConditions, rng: np.random.Generator, post: Post) -> None:
        self._conditions = conditions
        self._rng = rng
        self._post = post
        self._members: list[_Member] = []

    def join(self, peer: Peer, transport: "SimulatedTransport") -> None:
        """Everyone learns of everyone."""
        change = PeerChange(peer, True)
        for member in self._members:
            member.transport.notice(change)
            transport.notice(PeerChange(member.peer, True))
        self._members.append(_Member(peer, transport))

    def leave(self, transport: "SimulatedTransport") -> None:
        """A process ended or died."""
        gone = [m for m in self._members if m.transport is transport]
        self._members = [m for m in self._members if m.transport is not transport]
        for member in self._members:
            for left in gone:
                member.transport.notice(PeerChange(left.peer, False))

    def carry(self, sender: "SimulatedTransport", item: Received) -> None:
        """Bring an item to all who want it, each copy with its own luck."""
        c = self._conditions
        for member in self._members:
            receiver = member.transport
            if receiver is sender or not receiver.wants(item.topic):
                continue
            copies = 1
            if c.loss and self._rng.random() < c.loss:
                copies = 0
            elif c.duplication and self._rng.random() < c.duplication:
                copies = 2
            for _ in range(copies):
                delay = c.delay_s + (self._rng.exponential(c.jitter_s) if c.jitter_s else 0.0)
                self._post(delay, lambda r=receiver: r.deliver(item))  # type: ignore[misc]


class SimulatedTransport(Transport):
    """One simulated process's end."""

    def __init__(self, network: SimulatedNetwork) -> None:
        self._network = network
        self._inboxes: dict[str, Inbox] = {}
        self._urgent: set[str] = set()
        self._changes: list[PeerChange] = []
        self._counters: Counter[str] = Counter()
        self._wake: Callable[[], None] = lambda: None
        self._me: Peer | None = None

    def open(self, me: Peer, wake: Callable[[], None]) -> None:
        self._me = me
        self._wake = wake
        self._network.join(me, self)

    def subscribe(self, topic: Topic, urgent: bool = True) -> None:
        self._inboxes[topic.name] = Inbox(topic)
        if urgent:
            self._urgent.add(topic.name)

    def publish(self, topic: Topic, payload: bytes) -> None:
        assert self._me is not None, "open() comes first"
        self._counters["published"] += 1
        self._network.carry(self, Received(topic, self._me.id, payload))

    def drain(self) -> list[Received]:
        return [item for inbox in self._inboxes.values() for item in inbox.drain()]

    def drain_peer_changes(self) -> list[PeerChange]:
        changes, self._changes = self._changes, []
        return changes

    def statistics(self) -> dict[str, int]:
        dropped = {f"dropped.{name}": box.dropped for name, box in self._inboxes.items() if box.dropped}
        return dict(self._counters) | dropped

    def close(self) -> None:
        self._network.leave(self)

    def wants(self, topic: Topic) -> bool:
        """Whether the topic is subscribed to."""
        return topic.name in self._inboxes

    def deliver(self, item: Received) -> None:
        """An item arrives."""
        self._counters["received"] += 1
        self._inboxes[item.topic.name].put(item)
        if item.topic.name in self._urgent:
            self._wake()

    def notice(self, change: PeerChange) -> None:
        """A token came or went."""
        self._changes.append(change)
        self._wake()
