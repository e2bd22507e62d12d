"""The Zenoh transport between real sessions, and between real processes where that matters."""

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import pytest

from agents.errors import LinkError
from agents.mission.mission import LinkTable
from agents.wire.topics import EVENT, PICTURE, PLAN, POSE, SET, Topic, key
from agents.wire.transport import Peer, PeerChange, Received
from bridges.zenoh import roll as zenoh_roll
from bridges.zenoh.local_router import Router
from bridges.zenoh.transport import ZenohTransport
from tests.bridges.zenoh_child import TEAM

PATIENCE_S = 20.0

T = TypeVar("T")


@pytest.fixture
def router() -> Iterator[Router]:
    with Router(LinkTable()) as opened:
        yield opened


@contextmanager
def joined(endpoints: tuple[str, ...], name: str, link: LinkTable | None = None) -> Iterator[ZenohTransport]:
    with ZenohTransport(link or LinkTable(), TEAM, endpoints=endpoints) as transport:
        transport.open(Peer("robot", name, f"{name}-boot"), lambda: None)
        yield transport


@contextmanager
def child(router: Router, name: str, behaviour: str) -> Iterator[subprocess.Popen[str]]:
    """A process of its own, joined and ready."""
    command = [sys.executable, "-m", "tests.bridges.zenoh_child", router.endpoint, name, behaviour]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


def eventually(look: Callable[[], T], enough: Callable[[T], bool] = bool) -> T:
    deadline = time.monotonic() + PATIENCE_S
    while not enough(seen := look()):
        assert time.monotonic() < deadline, f"last seen: {seen!r}"
        time.sleep(0.005)
    return seen


class Collector:
    """Everything that a transport received on a topic, over many drains."""

    def __init__(self, transport: ZenohTransport, topic: Topic = SET) -> None:
        self._transport = transport
        self._topic = topic
        self.items: list[Received] = []

    def __call__(self) -> list[tuple[str, bytes]]:
        self.items += self._transport.drain()
        return [(item.sender, item.payload) for item in self.items if item.topic is self._topic]


def flowing(sender: ZenohTransport, seen: Collector, payload: bytes) -> None:
    """Publish until the receiver has it."""

    def look() -> bool:
        sender.publish(POSE, payload)
        return any(found == payload for _, found in seen())

    eventually(look)


@pytest.mark.processes
def test_messages_pass_between_processes_and_name_their_sender(router: Router) -> None:
    with joined(router.endpoints, "a") as a, child(router, "b", "echo"):
        a.subscribe(SET)
        seen = Collector(a)
        eventually(seen, lambda s: ("b", b"hello") in s)
        a.publish(SET, b"ping")
        eventually(seen, lambda s: ("b", b"ping") in s)


def test_own_messages_are_not_received(router: Router) -> None:
    with joined(router.endpoints, "a") as a, joined(router.endpoints, "b") as b:
        for topic in (SET, POSE):
            a.subscribe(topic)
            b.subscribe(topic)
        a.publish(SET, b"a set")
        a.publish(POSE, b"a pose")
        b.publish(SET, b"b set")
        mine, theirs = Collector(a), Collector(b)
        eventually(mine, lambda s: s == [("b", b"b set")])
        eventually(theirs, lambda s: s == [("a", b"a set")])
        assert {item.sender for item in mine.items} == {"b"}
        assert a.statistics()["missed"] == 0


def test_wake_is_called_for_urgent_topics_and_peers(router: Router) -> None:
    woken: list[str] = []
    with ZenohTransport(LinkTable(), TEAM, endpoints=router.endpoints) as a:
        a.open(Peer("robot", "a", "1"), lambda: woken.append("up"))
        a.subscribe(PLAN)
        a.subscribe(SET, urgent=False)
        with joined(router.endpoints, "b") as b:
            eventually(lambda: len(woken), lambda n: n == 1)  # b's token
            b.publish(SET, b"can wait")
            eventually(lambda: a.statistics()["received"], lambda n: n == 1)
            assert len(woken) == 1
            b.publish(PLAN, b"cannot")
            eventually(lambda: len(woken), lambda n: n == 2)


def test_late_joiner_gets_the_history_of_reliable_topics_once_and_in_order(router: Router) -> None:
    sets = [b"%d" % i for i in range(SET.history + 20)]
    with joined(router.endpoints, "a") as a:
        for payload in sets:
            a.publish(SET, payload)
        a.publish(PLAN, b"old plan")
        a.publish(PLAN, b"plan")
        a.publish(POSE, b"pose")
        with joined(router.endpoints, "late") as late:
            for topic in (SET, PLAN, POSE):
                late.subscribe(topic)
            seen, plans = Collector(late), Collector(late, PLAN)
            eventually(seen, lambda s: len(s) == SET.history)
            a.publish(SET, b"now")
            eventually(seen, lambda s: len(s) > SET.history)
            assert [payload for _, payload in seen()] == [*sets[-SET.history :], b"now"]
            plans.items = seen.items
            eventually(plans, lambda s: s == [("a", b"plan")])
            assert not [item for item in seen.items if item.topic is POSE]


def test_message_sent_before_the_subscriber_knows_the_publisher_arrives(router: Router) -> None:
    with joined(router.endpoints, "a") as a, joined(router.endpoints, "b") as b:
        b.subscribe(EVENT)
        a.publish(EVENT, b"first words")
        eventually(Collector(b, EVENT), lambda s: s == [("a", b"first words")])


def test_latest_only_topic_keeps_the_newest_of_each_sender(router: Router) -> None:
    with (
        joined(router.endpoints, "a") as a,
        joined(router.endpoints, "b") as b,
        joined(router.endpoints, "c") as c,
    ):
        c.subscribe(POSE)
        seen = Collector(c, POSE)
        flowing(a, seen, b"a first")
        flowing(b, seen, b"b first")
        for i in range(1, 11):
            a.publish(POSE, b"a %d" % i)
            b.publish(POSE, b"b %d" % i)
        waiting = c._subscriptions[POSE.name].inbox._queue
        eventually(
            lambda: {item.payload for item in list(waiting)},
            lambda w: {b"a 1", b"a 10", b"b 1", b"b 10"} <= w,
        )
        assert sorted(item.payload for item in c.drain()) == [b"a 10", b"b 10"]


def test_oversize_messages_are_counted_and_not_queued(router: Router) -> None:
    with joined(router.endpoints, "a") as a, joined(router.endpoints, "b") as b:
        b.subscribe(PLAN)
        assert a._session is not None
        # Past the sender's own check, as somebody else's program would send it.
        a._session.put(key(TEAM, PLAN, "a"), bytes(PLAN.max_bytes + 1))
        a.publish(PLAN, bytes(PLAN.max_bytes))
        eventually(lambda: b.statistics()["oversize"], lambda n: n == 1)
        eventually(Collector(b, PLAN), lambda s: [len(payload) for _, payload in s] == [PLAN.max_bytes])


def test_oversize_messages_are_not_sent(router: Router) -> None:
    with joined(router.endpoints, "a") as a:
        a.publish(POSE, bytes(POSE.max_bytes + 1))
        assert a.statistics()["unsent"] == 1
        assert a.statistics()["published"] == 0


def test_the_largest_picture_arrives_whole(router: Router) -> None:
    with joined(router.endpoints, "a") as a, joined(router.endpoints, "b") as b:
        b.subscribe(PICTURE)
        payload = bytes(range(256)) * (PICTURE.max_bytes // 256)
        a.publish(PICTURE, payload)
        eventually(Collector(b, PICTURE), lambda s: s == [("a", payload)])


def test_first_look_at_the_peers_gives_all_that_stand_but_oneself(router: Router) -> None:
    with joined(router.endpoints, "a"), joined(router.endpoints, "b"), joined(router.endpoints, "c") as c:
        changes = c.drain_peer_changes()
        assert {(change.peer.id, change.alive) for change in changes} == {("a", True), ("b", True)}
        assert c.drain_peer_changes() == []


def test_a_peer_that_is_listed_but_never_seen_again_is_gone(
    router: Router, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zenoh_roll, "CONFIRM_S", 0.2)
    ghost = Peer("robot", "ghost", "1")
    with joined(router.endpoints, "a"), joined(router.endpoints, "b") as b:
        b.drain_peer_changes()
        assert b._roll is not None
        # As when a token is withdrawn between the listing and the following.
        b._roll._change(ghost, True)
        b._roll._unconfirmed.add(ghost)
        assert b.drain_peer_changes() == [PeerChange(ghost, True)]
        assert eventually(b.drain_peer_changes) == [PeerChange(ghost, False)]  # and a is not


@pytest.mark.processes
def test_death_by_sigkill_is_seen_by_the_others(router: Router) -> None:
    with joined(router.endpoints, "a") as a, child(router, "b", "idle") as process:
        peer = Peer("robot", "b", f"b-{process.pid}")
        eventually(a.drain_peer_changes, lambda c: PeerChange(peer, True) in c)
        process.kill()
        eventually(a.drain_peer_changes, lambda c: PeerChange(peer, False) in c)


@pytest.mark.processes
def test_an_exception_inside_with_ends_the_process(router: Router) -> None:
    with child(router, "b", "raise") as process:
        _, errors = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 1
        assert "Defect" in errors


@pytest.mark.processes
def test_close_in_a_signal_handler_ends_the_process_under_load(router: Router) -> None:
    with joined(router.endpoints, "a") as a, child(router, "b", "exit on signal") as process:
        for i in range(2000):
            a.publish(SET, b"load")
            if i == 1000:
                process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=PATIENCE_S) == 7


def test_close_twice_and_publish_after_it_do_no_harm(router: Router) -> None:
    with joined(router.endpoints, "a") as a:
        a.subscribe(SET)
        a.close()
        a.close()
        a.publish(SET, b"too late")
        assert a.statistics()["unsent"] == 1
        assert a.drain() == []


def test_clients_survive_a_restart_of_the_router_and_fetch_what_they_missed() -> None:
    with Router(LinkTable()) as first:
        endpoints = first.endpoints
        with joined(endpoints, "a") as a, joined(endpoints, "b") as b:
            b.subscribe(SET)
            seen = Collector(b)
            a.publish(SET, b"before")
            eventually(seen, lambda s: s == [("a", b"before")])
            b.drain_peer_changes()
            first.close()
            eventually(b.drain_peer_changes, lambda c: [(x.peer.id, x.alive) for x in c] == [("a", False)])
            beyond = 10
            for i in range(SET.history + beyond):
                a.publish(SET, b"%d" % i)
            with Router(LinkTable(endpoints=list(endpoints))):
                eventually(b.drain_peer_changes, lambda c: [(x.peer.id, x.alive) for x in c] == [("a", True)])
                eventually(seen, lambda s: len(s) == 1 + SET.history)
                a.publish(SET, b"after")
                eventually(seen, lambda s: s[-1] == ("a", b"after"))
                kept = [b"%d" % i for i in range(beyond, beyond + SET.history)]
                assert [payload for _, payload in seen()] == [b"before", *kept, b"after"]
                assert b.statistics()["missed"] == beyond


def test_mesh_of_three_delivers_and_outlives_its_meeting_point() -> None:
    link = LinkTable(topology="mesh")
    with Router(link) as rendezvous:
        at = rendezvous.endpoints
        with joined(at, "a", link) as a, joined(at, "b", link) as b, joined(at, "c", link) as c:
            team = [a, b, c]
            seen = [Collector(t) for t in team]
            for t in team:
                t.subscribe(SET)
            for t, name in zip(team, (b"a", b"b", b"c"), strict=True):
                t.publish(SET, name)
            for collector, others in zip(seen, ("bc", "ac", "ab"), strict=True):
                eventually(collector, lambda s, o=others: sorted(sender for sender, _ in s) == list(o))
            rendezvous.close()
            # The newcomer takes the free endpoint itself, and is found there by the others.
            with joined(at, "late", link) as late:
                late.subscribe(SET)
                eventually(Collector(late), lambda s: sorted(sender for sender, _ in s) == ["a", "b", "c"])


def test_mesh_processes_that_start_before_any_meeting_point_find_each_other() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        at = (f"tcp/127.0.0.1:{probe.getsockname()[1]}",)
    link = LinkTable(topology="mesh", endpoints=list(at))
    with joined(at, "a", link) as a, joined(at, "b", link) as b:
        b.subscribe(SET)
        a.publish(SET, b"found")
        eventually(Collector(b), lambda s: s == [("a", b"found")])


def test_unreachable_router_is_an_error_that_names_it_and_says_what_to_do() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))  # bound, but nobody listens
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        with pytest.raises(LinkError, match=f"{endpoint}: start it, or correct link.endpoints"):
            ZenohTransport(LinkTable(), TEAM, endpoints=(endpoint,)).open(
                Peer("robot", "a", "1"), lambda: None
            )


def test_an_endpoint_that_does_not_speak_zenoh_is_an_error_too() -> None:
    with socket.create_server(("127.0.0.1", 0)) as mute:
        endpoint = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        with pytest.raises(LinkError, match=endpoint):
            ZenohTransport(LinkTable(), TEAM, endpoints=(endpoint,)).open(
                Peer("robot", "a", "1"), lambda: None
            )


@pytest.mark.parametrize("topology", ["star", "router", "mesh"])
def test_a_wrong_endpoint_is_an_error_that_shows_it(topology: str) -> None:
    link = LinkTable(topology=topology, endpoints=["somewhere"])  # type: ignore[arg-type]
    with pytest.raises(LinkError, match=r"somewhere.*tcp/HOST:PORT"):
        ZenohTransport(link, TEAM).open(Peer("robot", "a", "1"), lambda: None)


def test_a_client_without_any_endpoint_is_told_where_to_write_it() -> None:
    with pytest.raises(LinkError, match=r"link\.endpoints"):
        ZenohTransport(LinkTable(), TEAM).open(Peer("robot", "a", "1"), lambda: None)
