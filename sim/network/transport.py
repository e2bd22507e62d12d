"""One simulated process's end of the simulated network."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING

from agents.wire.topics import Topic
from agents.wire.transport import Inbox, Peer, PeerChange, Received, Transport
from sim.network.streams import Inlet, Outlet

if TYPE_CHECKING:
    from sim.network.network import SimulatedNetwork

Arrival = tuple[float, int, Received, "Outlet | None", int]  # time, order, message, stream and its number


class SimulatedTransport(Transport):
    """Messages lie in `_arrivals` until their time has come and somebody looks."""

    def __init__(self, network: SimulatedNetwork) -> None:
        self.me = Peer("", "", "")
        self.outlets: dict[str, Outlet] = {}
        self.alive = False
        self.peaks: dict[str, int] = {}  # the most that ever waited, by topic
        self._network = network
        self._inboxes: dict[str, Inbox] = {}
        self._urgent: set[str] = set()
        self._arrivals: list[Arrival] = []
        self._inlets: dict[Outlet, Inlet] = {}
        self._changes: list[PeerChange] = []
        self._roll: set[Peer] = set()
        self._counters: Counter[str] = Counter()
        self._wake: Callable[[], None] = lambda: None

    def __repr__(self) -> str:
        return f"SimulatedTransport({self.me.id}/{self.me.boot}, waiting={len(self._arrivals)})"

    # What an agent's driver uses

    def open(self, me: Peer, wake: Callable[[], None]) -> None:
        self.me, self._wake, self.alive = me, wake, True
        self._network.join(self)

    def subscribe(self, topic: Topic, urgent: bool = True) -> None:
        new = topic.name not in self._inboxes
        self._inboxes.setdefault(topic.name, Inbox(topic))
        if urgent:
            self._urgent.add(topic.name)
        if new:
            self._network.listen(self, topic)

    def publish(self, topic: Topic, payload: bytes) -> None:
        if not self.alive:
            return
        self._counters["published"] += 1
        self._network.carry(self, topic, Received(topic, self.me.id, payload))

    def drain(self) -> list[Received]:
        self.settle(wake=False)
        for name, inbox in self._inboxes.items():
            if len(inbox) > self.peaks.get(name, 0):
                self.peaks[name] = len(inbox)
        return [item for inbox in self._inboxes.values() for item in inbox.drain()]

    def drain_peer_changes(self) -> list[PeerChange]:
        changes, self._changes = self._changes, []
        return changes

    def statistics(self) -> dict[str, int]:
        dropped = {f"dropped.{name}": box.dropped for name, box in self._inboxes.items() if box.dropped}
        missed = sum(inlet.missed for inlet in self._inlets.values())
        return dict(self._counters) | dropped | ({"missed": missed} if missed else {})

    def close(self) -> None:
        if self.alive:
            self.alive = False
            self._network.leave(self)

    # What the network uses

    def wants(self, topic: Topic) -> bool:
        """Whether the topic is subscribed to."""
        return topic.name in self._inboxes

    def hurried(self, topic: Topic) -> bool:
        """Whether a message of the topic wakes the process."""
        return topic.name in self._urgent

    def outlet(self, topic: Topic) -> Outlet:
        """This end's numbering and cache of a reliable topic."""
        outlet = self.outlets.get(topic.name)
        if outlet is None:
            outlet = self.outlets[topic.name] = Outlet(self, topic, self._network.now())
        return outlet

    def inlet(self, outlet: Outlet) -> Inlet | None:
        """Where this end is in a stream, if it ever heard of it."""
        return self._inlets.get(outlet)

    def begin(self, outlet: Outlet, last: int) -> Inlet:
        """Enter a stream after its message `last`."""
        inlet = self._inlets[outlet] = Inlet(last)
        return inlet

    def put(self, arrival: Arrival) -> None:
        """A message that will have arrived at its time."""
        heapq.heappush(self._arrivals, arrival)

    def settle(self, wake: bool = True) -> None:
        """Sort into the inboxes what has arrived by now."""
        now, arrivals = self._network.now(), self._arrivals
        while arrivals and arrivals[0][0] <= now:
            _, _, item, outlet, number = heapq.heappop(arrivals)
            if outlet is None:
                self._hand_on([item], wake)
                continue
            inlet = self._inlets[outlet]
            self._hand_on(inlet.arrive(number, item), wake)
            if inlet.pending and not inlet.asking:
                self._network.ask(self, outlet, inlet)

    def answered(self, inlet: Inlet, cached: list[tuple[int, Received]]) -> None:
        """A publisher's cache answered, or will not any more."""
        self._hand_on(inlet.answered(cached), True)

    def see(self, peer: Peer, alive: bool) -> bool:
        """A token came or went; False if that was known."""
        if not self.alive or peer == self.me or alive == (peer in self._roll):
            return False
        (self._roll.add if alive else self._roll.remove)(peer)
        self._changes.append(PeerChange(peer, alive))
        self._wake()
        return True

    def forget(self, name: str, but: Peer | None = None) -> None:
        """All tokens of a name fall but one; its caches will not answer any more."""
        for peer in [peer for peer in self._roll if peer.id == name and peer != but]:
            self.see(peer, False)
            for outlet, inlet in self._inlets.items():
                if outlet.owner.me == peer and inlet.asking:
                    self.answered(inlet, [])

    def _hand_on(self, items: list[Received], wake: bool) -> None:
        for item in items:
            name = item.topic.name
            if name in self._inboxes:
                self._counters["received"] += 1
                self._inboxes[name].put(item)
                if wake and name in self._urgent:
                    self._wake()
