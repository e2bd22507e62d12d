"""A simulated network: messages take their time, and may be lost, doubled, spoiled or cut off, by one seed.

It carries as bridges.zenoh.transport does over TCP: each link keeps its order; what is sent into a short cut
comes in a burst afterwards; after the lease the other end is given up, its token falls, and what is sent is
lost until both have met again. Reliable topics fetch what is missing from their publisher's cache
(sim.network.streams). With `datagrams` it promises nothing at all. Names stand for hosts: cuts last while
processes come and go.
"""

from collections.abc import Callable, Collection, Mapping
from itertools import count

import numpy as np

from agents.wire.topics import Topic
from agents.wire.transport import Peer, Received
from sim.network.conditions import NetworkConditions, corrupted
from sim.network.links import Link, Links, LinkState, Post
from sim.network.streams import Inlet, Outlet
from sim.network.transport import SimulatedTransport

Near = Mapping[str, Collection[str]]  # whom a robot's radio reaches

DEATH_S = 0.005  # until a closed or dead process is missed on an open link
HEARTBEAT_S = 1.0  # of reliable topics: a lost last message is noticed within this time
ASK_TIMEOUT_S = 10.0  # a question to a cache that nobody answers is given up
RETRY_S = 0.2  # such questions and answers, when lost, are sent again

__all__ = ["NetworkConditions", "SimulatedNetwork", "SimulatedTransport"]


class SimulatedNetwork:
    """Connects the simulated transports of one run. `near` is asked for who reaches whom, with `reach_m`."""

    def __init__(
        self,
        conditions: NetworkConditions,
        rng: np.random.Generator,
        post: Post,
        now: Callable[[], float],
        near: Callable[[], Near] | None = None,
    ) -> None:
        self.conditions = conditions
        self.now = now
        # What one link needs more draws for must not change the luck of messages on others.
        meeting, self._asking = rng.spawn(2)
        self.links = Links(meeting, post, self._look_again)
        self._near = near
        self._rng = rng
        self._post = post
        self._order = count()
        self._members: dict[str, SimulatedTransport] = {}  # by name: who is alive
        self._listeners: dict[str, list[SimulatedTransport]] = {}

    def __repr__(self) -> str:
        return f"SimulatedNetwork(members={sorted(self._members)}, {self.links})"

    # Coming and going

    def join(self, transport: SimulatedTransport) -> None:
        """Whoever is in reach learns of it, and it of them."""
        others = list(self._members.values())
        self._members[transport.me.id] = transport
        for other in others:
            self._meet(other, transport)
            self._meet(transport, other)

    def leave(self, transport: SimulatedTransport) -> None:
        """A process ended or died."""
        if self._members.get(transport.me.id) is transport:
            del self._members[transport.me.id]
        for listeners in self._listeners.values():
            if transport in listeners:
                listeners.remove(transport)
        self._post(DEATH_S, lambda: self._miss(transport.me))

    def listen(self, transport: SimulatedTransport, topic: Topic) -> None:
        """A topic was subscribed to; for what was said before, the caches are asked."""
        self._listeners.setdefault(topic.name, []).append(transport)
        if transport.alive:
            for publisher in self._members.values():
                self._ask_history(transport, publisher, topic.name)

    def cut(self, sources: Collection[str], sinks: Collection[str]) -> None:
        """Nothing gets from a source to a sink until it is healed as often as it was cut."""
        self.links.cut(sources, sinks, self.conditions.lease_s)

    def heal(self, sources: Collection[str], sinks: Collection[str]) -> None:
        """Undo a cut."""
        for link in self.links.heal(sources, sinks):
            for sender, receiver, item, outlet, number in link.held:
                self._arrive(sender, receiver, self.now() + self.conditions.delay_s, item, outlet, number)

    def silence(self, name: str) -> None:
        """A process has said nothing for the length of the lease: it is stopped."""
        self.links.silence(name, [other for other in self._members if other != name])

    def answer(self, name: str) -> None:
        """It goes on."""
        self.links.answer(name)

    def _miss(self, peer: Peer) -> None:
        """Tokens of the dead fall at once on open links; on others they do at the lease, or at the heal."""
        here = self._members.get(peer.id)
        for member in list(self._members.values()):
            if self.links.open(peer.id, member.me.id):
                member.forget(peer.id, None if here is None else here.me)

    def _look_again(self, link: Link) -> None:
        """Let the sink of a link see what it can see over it now."""
        observer, peer = self._members.get(link.sink), self._members.get(link.source)
        if observer is None:
            return
        if link.state is not LinkState.OPEN:
            observer.forget(link.source)
            return
        observer.forget(link.source, None if peer is None else peer.me)
        if peer is not None:
            self._meet(observer, peer)
        self._ask_again(link)

    def _meet(self, observer: SimulatedTransport, peer: SimulatedTransport) -> None:
        if self.links.open(peer.me.id, observer.me.id) and observer.see(peer.me, True):
            for topic in list(peer.outlets):
                self._ask_history(observer, peer, topic)

    # Messages

    def carry(self, sender: SimulatedTransport, topic: Topic, item: Received) -> None:
        """Bring an item to all who want it, each copy with its own luck."""
        c, now = self.conditions, self.now()
        outlet = sender.outlet(topic) if topic.reliable and not c.datagrams else None
        number = outlet.add(item) if outlet is not None else 0
        receivers = self._receivers(sender, topic)
        if not receivers:
            return
        delays = np.full(len(receivers), c.delay_s)
        if c.jitter_s:
            delays += self._rng.exponential(c.jitter_s, size=len(receivers))
        plain = c.clean and not self.links.closed
        for receiver, delay in zip(receivers, delays.tolist(), strict=True):
            if outlet is not None and receiver.inlet(outlet) is None:
                receiver.begin(outlet, number - 1)
            if plain:
                self._arrive(sender, receiver, now + delay, item, outlet, number)
            else:
                self._send(sender, receiver, delay, item, outlet, number)

    def _receivers(self, sender: SimulatedTransport, topic: Topic) -> list[SimulatedTransport]:
        listeners = self._listeners.get(topic.name, ())
        if self.conditions.reach_m and self._near is not None:
            near = self._near()
            mine = near.get(sender.me.id)
            if mine is not None:
                return [r for r in listeners if r is not sender and (r.me.id in mine or r.me.id not in near)]
        return [receiver for receiver in listeners if receiver is not sender]

    def _send(
        self,
        sender: SimulatedTransport,
        receiver: SimulatedTransport,
        delay: float,
        item: Received,
        outlet: Outlet | None,
        number: int,
    ) -> None:
        """To one receiver, in whatever weather."""
        c, rng = self.conditions, self._rng
        link = self.links[sender.me.id, receiver.me.id]
        if link.state is not LinkState.OPEN:
            if link.state is LinkState.CUT and not c.datagrams:
                link.hold(sender, receiver, item, outlet, number)
            return
        if link.weather.loses(c, rng):
            if outlet is not None:
                self._trouble(receiver, outlet)
            return
        if c.late and rng.random() < c.late:
            delay += c.late_s
        if c.corruption and rng.random() < c.corruption:
            item = Received(item.topic, item.sender, corrupted(item.payload, rng))
        self._arrive(sender, receiver, self.now() + delay, item, outlet, number)
        if c.duplication and rng.random() < c.duplication:
            again = delay + c.delay_s + float(rng.exponential(c.jitter_s or c.delay_s))
            self._arrive(sender, receiver, self.now() + again, item, outlet, number)

    def _arrive(
        self,
        sender: SimulatedTransport,
        receiver: SimulatedTransport,
        at: float,
        item: Received,
        outlet: Outlet | None,
        number: int,
    ) -> None:
        if not self.conditions.datagrams:
            link = self.links[sender.me.id, receiver.me.id]
            at = link.fifo_at = max(at, link.fifo_at)
        receiver.put((at, next(self._order), item, outlet, number))
        inlet = None if outlet is None else receiver.inlet(outlet)
        if receiver.hurried(item.topic) or (inlet is not None and inlet.troubled):
            self._post(max(0.0, at - self.now()), receiver.settle)

    # Recovery

    def _trouble(self, receiver: SimulatedTransport, outlet: Outlet) -> None:
        """Something of a stream was lost: the next message or heartbeat will show it."""
        inlet = receiver.inlet(outlet)
        assert inlet is not None
        inlet.troubled = True
        to_heartbeat = HEARTBEAT_S - (self.now() - outlet.born) % HEARTBEAT_S

        def heartbeat() -> None:
            if inlet.troubled and receiver.alive and outlet.owner.alive:
                self.ask(receiver, outlet, inlet)

        self._post(to_heartbeat + self.conditions.delay_s, heartbeat)

    def ask(self, receiver: SimulatedTransport, outlet: Outlet, inlet: Inlet) -> None:
        """A receiver wants of a publisher's cache what it has not."""
        if inlet.asking:
            return
        inlet.asking = True
        c = self.conditions
        delay = 2.0 * c.delay_s + (float(self._asking.exponential(2.0 * c.jitter_s)) if c.jitter_s else 0.0)
        for _ in range(8):
            if c.loss and self._asking.random() < c.loss:
                delay += RETRY_S
        self._post(delay, lambda: self._answer(receiver, outlet, inlet))

    def _answer(self, receiver: SimulatedTransport, outlet: Outlet, inlet: Inlet) -> None:
        if not inlet.asking or not receiver.alive:
            return  # the publisher was given up meanwhile
        here, there = receiver.me.id, outlet.owner.me.id
        if outlet.owner.alive and self.links.open(here, there) and self.links.open(there, here):
            receiver.answered(inlet, list(outlet.cache))
        else:
            inlet.unheard = True
            self._post(ASK_TIMEOUT_S, lambda: receiver.answered(inlet, []) if inlet.unheard else None)

    def _ask_again(self, link: Link) -> None:
        """Questions that got lost between two ends are asked anew when these meet again."""
        ends = (self._members.get(link.source), self._members.get(link.sink))
        for here, there in (ends, ends[::-1]):
            if here is not None and there is not None:
                for outlet in there.outlets.values():
                    inlet = here.inlet(outlet)
                    if inlet is not None and inlet.unheard:
                        inlet.asking = inlet.unheard = False
                        self.ask(here, outlet, inlet)

    def _ask_history(self, receiver: SimulatedTransport, publisher: SimulatedTransport, topic: str) -> None:
        outlet = publisher.outlets.get(topic)
        if outlet is None or self.conditions.datagrams or receiver not in self._listeners.get(topic, ()):
            return
        inlet = receiver.inlet(outlet)
        if inlet is None:
            inlet = receiver.begin(outlet, outlet.sent - 1 - len(outlet.cache))
        self.ask(receiver, outlet, inlet)
