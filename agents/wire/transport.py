"""The transport seam: carry bytes between the processes of a team, and say who is alive.

A transport never raises into its user for what the network does and never blocks it; what arrives waits in
bounded queues until it is drained. Implementations: bridges.zenoh.transport, sim.network.network.
"""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from agents.wire.topics import Drop, Topic


@dataclass(frozen=True, slots=True)
class Received:
    """Bytes that came on a topic, with the sender that the key names."""

    topic: Topic
    sender: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class Peer:
    """A process whose liveliness token stands."""

    role: str  # "robot", "fusion", "operator", "watch", "swarm"
    id: str
    boot: str


@dataclass(frozen=True, slots=True)
class PeerChange:
    """A token that came or went."""

    peer: Peer
    alive: bool


class Inbox:
    """The bounded queue of one subscription. `put` and `drain` may be called from different threads."""

    def __init__(self, topic: Topic) -> None:
        self.topic = topic
        self.received = 0
        self.dropped = 0
        self._queue: deque[Received] = deque()

    def __repr__(self) -> str:
        return f"Inbox({self.topic.name}, waiting={len(self._queue)}, dropped={self.dropped})"

    def __len__(self) -> int:
        return len(self._queue)

    def put(self, item: Received) -> None:
        """Add an item; when full, the oldest goes and is counted."""
        self.received += 1
        if len(self._queue) >= self.topic.queue:
            try:
                self._queue.popleft()
                self.dropped += 1
            except IndexError:  # drained meanwhile by the reader
                pass
        self._queue.append(item)

    def drain(self) -> list[Received]:
        """All that waits, in order; of a latest-only topic just each sender's newest."""
        items: list[Received] = []
        while self._queue:
            try:
                items.append(self._queue.popleft())
            except IndexError:
                break
        if self.topic.drop is Drop.LATEST_ONLY:
            newest = {item.sender: item for item in items}
            items = [item for item in items if newest[item.sender] is item]
        return items


class Transport(ABC):
    """One process's end of the team's network. Use as a context manager."""

    @abstractmethod
    def open(self, me: Peer, wake: Callable[[], None]) -> None:
        """Join the team as `me`. `wake` is called from any thread when something arrived.

        Raises:
            LinkError: if the network cannot be had, with what to do about it.
        """

    @abstractmethod
    def subscribe(self, topic: Topic, urgent: bool = True) -> None:
        """Receive the topic from all senders but oneself; what is not urgent waits without a `wake`."""

    def prepare(self, topic: Topic) -> None:
        """Make ready to publish the topic, so that its first message need not wait for that."""

    @abstractmethod
    def publish(self, topic: Topic, payload: bytes) -> None:
        """Send to all subscribers, under one's own id; never waits for them."""

    @abstractmethod
    def drain(self) -> list[Received]:
        """Everything that arrived since the last call."""

    @abstractmethod
    def drain_peer_changes(self) -> list[PeerChange]:
        """Tokens that came or went since the last call; the first call gives all that stand."""

    def waiting(self) -> dict[str, int]:
        """How many messages wait to be drained, by topic."""
        return {}

    @abstractmethod
    def statistics(self) -> dict[str, int]:
        """Counters by name: published, received, dropped per topic, missed, ..."""

    @abstractmethod
    def close(self) -> None:
        """Leave the team. Safe to call twice."""

    def __enter__(self) -> "Transport":
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
