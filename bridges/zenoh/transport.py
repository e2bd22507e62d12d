"""The team's network over Zenoh.

Every put may be dropped when a link is congested (Zenoh's DROP): with BLOCK one receiver that stops
reading makes the sender wait for seconds, and the sender is a robot in flight. What may not be lost
(reliable topics) is instead numbered and cached by its publisher; receivers see the gap, from the next
message or the heartbeat, and fetch what is missing. The same cache serves late joiners, and receivers that
were cut off, up to `topic.history` messages. Beyond that they count as missed; measurement sets are then
offered again by their robot, which knows from the watermark.

A process that ends without closing its session hangs, because Zenoh's callback threads are no daemons, and
neither `atexit` nor a finaliser runs early enough to help: use the transport in a `with` statement. Never
fork while it is open.
"""

import logging
import time
from collections.abc import Callable
from contextlib import suppress

import zenoh
import zenoh.ext

from agents.errors import JoinError, LinkError
from agents.mission.mission import LinkTable
from agents.wire.roles import EXCLUSIVE
from agents.wire.topics import PICTURE, POSE, RELAY, STATE, TRUTH, Topic, key
from agents.wire.transport import Inbox, Peer, PeerChange, Received, Transport
from bridges.keys.keyring import Credentials, credentials
from bridges.zenoh.config import NO_ROUTER, configuration, free_port_endpoint
from bridges.zenoh.roll import Roll
from bridges.zenoh.tls_trouble import tls_trouble

_log = logging.getLogger(__name__)

PATIENCE_S = 3.0  # how long `open` looks for the router
MISSED_S = 1.0  # beyond the lease, until the token of a computer that was switched off is gone
HEARTBEAT_S = 1.0  # a lost last message of a reliable topic is noticed within this time

# Large and unhurried topics must not stand in front of measurement sets in a link's queue.
_PRIORITY = {
    POSE.name: zenoh.Priority.DATA_HIGH,
    PICTURE.name: zenoh.Priority.DATA_LOW,
    STATE.name: zenoh.Priority.DATA_LOW,
    RELAY.name: zenoh.Priority.DATA_LOW,
    TRUTH.name: zenoh.Priority.DATA_LOW,
}

_Publisher = zenoh.Publisher | zenoh.ext.AdvancedPublisher


class _Subscription:
    """One subscribed topic. Its counters are written by one callback thread each."""

    def __init__(self, topic: Topic, own_id: str, wake: Callable[[], None], urgent: bool) -> None:
        self.inbox = Inbox(topic)
        self.urgent = urgent
        self.oversize = 0
        self.missed = 0
        self.closed = False
        self._own_id = own_id
        self._wake = wake

    def receive(self, sample: zenoh.Sample) -> None:
        sender = str(sample.key_expr).rpartition("/")[2]
        if sender == self._own_id or self.closed or sample.kind != zenoh.SampleKind.PUT:
            return
        if len(sample.payload) > self.inbox.topic.max_bytes:
            self.oversize += 1
            return
        self.inbox.put(Received(self.inbox.topic, sender, sample.payload.to_bytes()))
        if self.urgent:
            self._wake()

    def miss(self, miss: zenoh.ext.Miss) -> None:
        self.missed += miss.nb


class ZenohTransport(Transport):
    """One process's Zenoh session. `endpoints` replace those of the link table; `team` is the key prefix.

    star, router: a client of the router at the endpoints. mesh: a peer that listens on a free port, meets
    the others at the endpoints, and is itself the meeting point if an endpoint is its machine's and free.
    """

    def __init__(self, link: LinkTable, team: str, *, endpoints: tuple[str, ...] | None = None) -> None:
        self._link = link
        self._team = team
        self._endpoints = tuple(link.endpoints) if endpoints is None else endpoints
        self._session: zenoh.Session | None = None
        self._me: Peer | None = None
        self._wake: Callable[[], None] = lambda: None
        self._publishers: dict[str, _Publisher] = {}
        self._subscriptions: dict[str, _Subscription] = {}
        self._roll: Roll | None = None
        self._kept: list[object] = []  # Zenoh undeclares what nobody refers to
        self._published = 0
        self._unsent = 0

    def __repr__(self) -> str:
        state = "open" if self._session is not None else "closed"
        return f"ZenohTransport({self._link.topology} {','.join(self._endpoints)}, {state}, {self._roll})"

    def open(self, me: Peer, wake: Callable[[], None]) -> None:
        """Join the team as `me`. Blocks for up to `PATIENCE_S`: call it before the event loop runs."""
        if self._session is not None:
            raise RuntimeError("the transport is open already")
        keys = credentials(self._link.keys, me.id) if self._link.keys else None
        self._session = session = self._connect(keys)
        self._me, self._wake = me, wake
        try:
            liveliness = session.liveliness()
            if me.role in EXCLUSIVE:
                self._await_name(session, me)
            self._roll = roll = Roll(me, wake)
            everyone = key(self._team, "alive", "*/*/*")
            for reply in liveliness.get(everyone, timeout=1.0):
                if reply.ok is not None:
                    roll.listed(reply.ok)
            self._kept.append(liveliness.declare_subscriber(everyone, roll.followed, history=True))
            own = key(self._team, "alive", f"{me.role}/{me.id}/{me.boot}")
            self._kept.append(liveliness.declare_token(own))
        except BaseException:
            self.close()
            raise

    def _await_name(self, session: zenoh.Session, me: Peer) -> None:
        """Wait for an earlier process of this name to be missed, if it died; if it lives, do not join."""
        named = key(self._team, "alive", f"{me.role}/{me.id}/*")
        deadline = time.monotonic() + self._link.lease_s + MISSED_S
        while any(reply.ok is not None for reply in session.liveliness().get(named, timeout=1.0)):
            if time.monotonic() > deadline:
                raise JoinError(
                    f"another process of the team is {me.role} {me.id} already: end that one, or start this "
                    "one under another id"
                )
            time.sleep(0.1)

    def subscribe(self, topic: Topic, urgent: bool = True) -> None:
        session, me = self._opened()
        if topic.name in self._subscriptions:
            self._subscriptions[topic.name].urgent |= urgent
            return
        subscription = _Subscription(topic, me.id, self._wake, urgent)
        self._subscriptions[topic.name] = subscription
        everyone = key(self._team, topic, "*")
        if not topic.reliable:
            self._kept.append(
                session.declare_subscriber(
                    everyone, subscription.receive, allowed_origin=zenoh.Locality.REMOTE
                )
            )
            return
        # Own messages are heard and then ignored: were they kept out here, the heartbeat would miss them.
        subscriber = zenoh.ext.declare_advanced_subscriber(
            session,
            everyone,
            subscription.receive,
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=max(1, topic.history)),
            recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
        )
        # Rare and short, so it needs no thread of its own.
        on_miss = zenoh.handlers.Callback(subscription.miss, indirect=False)
        self._kept += [subscriber, subscriber.sample_miss_listener(on_miss)]

    def prepare(self, topic: Topic) -> None:
        self._publisher(topic)

    def publish(self, topic: Topic, payload: bytes) -> None:
        """Send to all. What the topic calls too large, or comes after `close`, is counted and not sent."""
        if self._session is None or len(payload) > topic.max_bytes:
            self._unsent += 1
            return
        try:
            self._publisher(topic).put(payload)
        except zenoh.ZError as error:  # the session was closed under us; the user is leaving anyway
            self._unsent += 1
            _log.warning("%s was not sent: %s", topic.name, error)
        else:
            self._published += 1

    def drain(self) -> list[Received]:
        return [item for subscription in self._subscriptions.values() for item in subscription.inbox.drain()]

    def drain_peer_changes(self) -> list[PeerChange]:
        return self._roll.drain() if self._roll is not None else []

    def waiting(self) -> dict[str, int]:
        return {name: len(subscription.inbox) for name, subscription in self._subscriptions.items()}

    def statistics(self) -> dict[str, int]:
        """published, received, missed, oversize, unsent, and dropped.TOPIC of each subscribed topic."""
        subscriptions = list(self._subscriptions.values())
        return {
            "published": self._published,
            "received": sum(s.inbox.received for s in subscriptions),
            "missed": sum(s.missed for s in subscriptions),
            "oversize": sum(s.oversize for s in subscriptions),
            "unsent": self._unsent,
            **{f"dropped.{s.inbox.topic.name}": s.inbox.dropped for s in subscriptions},
        }

    def close(self) -> None:
        """Leave the team; what waits can still be drained. Safe to call twice and from a signal handler."""
        session, self._session = self._session, None
        if session is None:
            return
        for subscription in self._subscriptions.values():
            subscription.closed = True  # `wake` may lead to a loop that is closed by now
        if self._roll is not None:
            self._roll.closed = True
        with suppress(zenoh.ZError):
            session.close()  # type: ignore[no-untyped-call]
        self._publishers.clear()
        self._kept.clear()

    def _opened(self) -> tuple[zenoh.Session, Peer]:
        if self._session is None or self._me is None:
            raise RuntimeError("open the transport first")
        return self._session, self._me

    def _publisher(self, topic: Topic) -> _Publisher:
        publisher = self._publishers.get(topic.name)
        if publisher is None:
            publisher = self._publishers[topic.name] = self._declare_publisher(topic)
        return publisher

    def _declare_publisher(self, topic: Topic) -> _Publisher:
        session, me = self._opened()
        own = key(self._team, topic, me.id)
        drop = zenoh.CongestionControl.DROP
        priority = _PRIORITY.get(topic.name, zenoh.Priority.DATA)
        if not topic.reliable:
            return session.declare_publisher(own, congestion_control=drop, priority=priority)
        return zenoh.ext.declare_advanced_publisher(
            session,
            own,
            congestion_control=drop,
            priority=priority,
            cache=zenoh.ext.CacheConfig(max(1, topic.history)),
            sample_miss_detection=zenoh.ext.MissDetectionConfig(
                heartbeat=HEARTBEAT_S, sporadic_heartbeat=None
            ),
            publisher_detection=True,
        )

    def _connect(self, keys: Credentials | None) -> zenoh.Session:
        if self._link.topology == "mesh":
            return self._join_mesh()
        if not self._endpoints:
            raise LinkError(NO_ROUTER)
        config = configuration(self._link, "client", connect=self._endpoints, keys=keys)
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                return zenoh.open(config)
            except zenoh.ZError as error:
                # An attempt may itself take two seconds, when the host does not answer at all.
                if time.monotonic() + 1.0 > deadline:
                    if keys is not None and (trouble := tls_trouble(self._endpoints, keys)) is not None:
                        raise JoinError(trouble) from error
                    raise LinkError(
                        f"no Zenoh router answers at {' or '.join(self._endpoints)}: "
                        "start it, or correct link.endpoints in the mission"
                    ) from error
            time.sleep(0.25)

    def _join_mesh(self) -> zenoh.Session:
        # Every process takes those meeting points that are its own machine's address and free. When the
        # holder of one dies, the others know each other, and the next to start takes it and is found there.
        listen = (free_port_endpoint(self._endpoints), *self._endpoints)
        config = configuration(
            self._link, "peer", connect=self._endpoints, listen=listen, listen_if_free=True
        )
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            raise LinkError(f"cannot join the mesh at {', '.join(self._endpoints)}: {error}") from error
