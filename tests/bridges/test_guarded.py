"""A guarded team over real Zenoh sessions: who has no key, or another's, gets nothing in and sees nothing."""

import json
import shutil
import socket
import ssl
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import zenoh

from agents.errors import JoinError, LinkError
from agents.mission.mission import LinkTable
from agents.wire.topics import HEALTH, POSE, POSTERIOR, SET, TRUTH, Topic
from agents.wire.transport import Peer
from bridges.keys.keyring import Credentials
from bridges.zenoh.config import configuration
from bridges.zenoh.local_router import Router
from bridges.zenoh.tls_trouble import tls_trouble
from bridges.zenoh.transport import ZenohTransport
from tests.bridges.guarded import DAY, TEAM, make_keys, member
from tests.bridges.zenoh.test_transport import Collector, eventually

LONG_ENOUGH_S = 0.7  # for what must not come


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("team") / "keys"
    make_keys(directory, robots=3)
    return directory


@pytest.fixture
def keys(made: Path, tmp_path: Path) -> Path:
    """A copy that a test may spoil."""
    shutil.copytree(made, tmp_path / "keys")
    return tmp_path / "keys"


@pytest.fixture
def router(made: Path) -> Iterator[Router]:
    with Router(LinkTable(keys=str(made))) as opened:
        yield opened


def says(transport: ZenohTransport, topic: Topic, payload: bytes, name: str) -> None:
    """Past the transport, as somebody else's program would."""
    assert transport._session is not None
    transport._session.put(f"{TEAM}/v1/{topic.name}/{name}", payload)


def test_a_guarded_team_hears_each_other_live_and_late(router: Router, keys: Path) -> None:
    assert router.endpoint.startswith("tls/127.0.0.1:")
    at = router.endpoints
    with member(keys, at, "robot", "r1") as r1:
        r1.publish(SET, b"early")
        with member(keys, at, "fusion", "fusion") as fusion, member(keys, at, "robot", "r2") as r2:
            for transport in (fusion, r2):
                transport.subscribe(SET)
            seen, others = Collector(fusion), Collector(r2)
            eventually(seen, lambda s: ("r1", b"early") in s)  # out of the cache of r1
            r1.publish(SET, b"now")
            eventually(seen, lambda s: s == [("r1", b"early"), ("r1", b"now")])
            eventually(others, lambda s: ("r1", b"now") in s)
            r1.subscribe(POSTERIOR)
            fusion.publish(POSTERIOR, b"belief")
            eventually(Collector(r1, POSTERIOR), lambda s: s == [("fusion", b"belief")])
            alive = {change.peer.id for change in eventually(fusion.drain_peer_changes)}
            assert alive == {"r1", "r2"}


def test_a_robot_speaks_under_its_own_name_only_whatever_its_program_does(router: Router, keys: Path) -> None:
    at = router.endpoints
    with member(keys, at, "fusion", "fusion") as fusion, member(keys, at, "robot", "r2") as r2:
        fusion.subscribe(SET)
        seen = Collector(fusion)
        r2.publish(SET, b"mine")
        eventually(seen, lambda s: s == [("r2", b"mine")])
        says(r2, SET, b"forged", "r1")
        says(r2, POSTERIOR, b"forged", "fusion")
        assert r2._session is not None
        token = r2._session.liveliness().declare_token(f"{TEAM}/v1/alive/robot/r1/forged")
        cache = r2._session.declare_queryable(
            f"{TEAM}/v1/set/r1/**", lambda query: query.reply(f"{TEAM}/v1/set/r1", b"forged")
        )
        time.sleep(LONG_ENOUGH_S)
        assert seen() == [("r2", b"mine")]
        assert {change.peer.id for change in fusion.drain_peer_changes()} <= {"r2"}
        with member(keys, at, "swarm", "swarm") as late:
            late.subscribe(SET)
            late.subscribe(POSTERIOR)
            heard = Collector(late)
            eventually(heard, lambda s: ("r2", b"mine") in s)
            time.sleep(LONG_ENOUGH_S)
            assert [item.payload for item in heard.items] == [b"mine"]
        del token, cache


def test_answers_from_a_cache_of_anothers_name_are_not_taken(router: Router, keys: Path) -> None:
    at = router.endpoints
    with member(keys, at, "robot", "r2") as r2, member(keys, at, "robot", "r3") as r3:
        assert r2._session is not None
        assert r3._session is not None
        own = r2._session.declare_queryable(
            f"{TEAM}/v1/set/r2/**",
            lambda query: query.reply(f"{TEAM}/v1/set/r1/@adv/pub/1/1/_", b"forged"),
        )
        time.sleep(0.3)
        replies = list(r3._session.get(f"{TEAM}/v1/set/*/@adv/**", timeout=1.0))
        assert not [reply for reply in replies if reply.ok is not None]
        del own


def test_robots_hear_neither_the_truth_nor_what_is_for_people(router: Router, keys: Path) -> None:
    at = router.endpoints
    with (
        member(keys, at, "robot", "r1") as r1,
        member(keys, at, "robot", "r2") as r2,
        member(keys, at, "swarm", "swarm") as swarm,
        member(keys, at, "status", "status") as status,
    ):
        for topic in (TRUTH, HEALTH, POSE):
            r1.subscribe(topic)
        for topic in (HEALTH, POSE):
            status.subscribe(topic)

        def look() -> set[str]:
            swarm.publish(TRUTH, b"truth")
            r2.publish(HEALTH, b"health")
            r2.publish(POSE, b"pose")
            return {item.topic.name for item in r1.drain()}

        assert eventually(look) == {"pose"}
        eventually(Collector(status, HEALTH), lambda s: ("r2", b"health") in s)
        assert {item.topic.name for item in r1.drain()} <= {"pose"}


def spied(endpoint: str, config: zenoh.Config) -> list[bytes]:
    """What a session that is not of the team sees and gets in; empty if it cannot even be opened."""
    try:
        session = zenoh.open(config)
    except zenoh.ZError:
        return []
    with session:
        heard: list[bytes] = []
        kept = session.declare_subscriber("**", lambda sample: heard.append(sample.payload.to_bytes()))
        time.sleep(LONG_ENOUGH_S)
        del kept
        return heard


def test_without_a_certificate_of_the_team_nothing_gets_in_or_out(
    router: Router, keys: Path, tmp_path: Path
) -> None:
    make_keys(tmp_path / "strangers")
    strangers = tmp_path / "strangers" / "r1"
    own, endpoint = keys / "r1", router.endpoint
    plain = configuration(LinkTable(), "client", connect=(endpoint.replace("tls/", "tcp/"),))
    anonymous = configuration(LinkTable(), "client", connect=(endpoint,))
    anonymous.insert_json5(
        "transport/link/tls", json.dumps({"root_ca_certificate": str(own / "ca.pem"), "enable_mtls": False})
    )
    foreign = Credentials(own / "ca.pem", strangers / "cert.pem", strangers / "key.pem")
    other = configuration(LinkTable(), "client", connect=(endpoint,), keys=foreign)
    for config in (plain, anonymous, other):
        config.insert_json5("connect/timeout_ms", "500")
    with member(keys, router.endpoints, "robot", "r1") as r1:
        for config in (plain, anonymous, other):
            r1.publish(SET, b"secret")
            assert spied(endpoint, config) == []
    trouble = tls_trouble((endpoint,), foreign)
    assert trouble is not None
    assert "refuses" in trouble


def test_a_revoked_robot_gets_nothing_in_and_sees_nothing(keys: Path) -> None:
    workshop = make_keys(keys, robots=3)
    workshop.revoke("r2")
    workshop.write()
    with Router(LinkTable(keys=str(keys))) as router:
        at = router.endpoints
        with member(keys, at, "robot", "r1") as r1, member(keys, at, "robot", "r2") as r2:
            r1.subscribe(SET)
            r2.subscribe(SET)
            for i in range(5):
                r1.publish(SET, b"%d" % i)
                r2.publish(SET, b"%d" % i)
                time.sleep(0.1)
            assert r1.drain() == []
            assert r2.drain() == []
            assert r1.drain_peer_changes() == []


def test_a_router_with_a_strangers_keys_is_told_from_ones_own(keys: Path, tmp_path: Path) -> None:
    make_keys(tmp_path / "strangers")
    stranger = Router(LinkTable(keys=str(tmp_path / "strangers")))
    with stranger, pytest.raises(JoinError, match="is not this team's router"):
        join(keys, stranger.endpoints)


def test_a_router_reached_by_a_name_that_it_has_not_is_told(keys: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.2", 0))
        endpoint = f"tls/127.0.0.2:{probe.getsockname()[1]}"
    router = Router(LinkTable(keys=str(keys), endpoints=[endpoint]))
    with router, pytest.raises(JoinError, match=r"not for 127\.0\.0\.2: .*--hosts 127\.0\.0\.2"):
        join(keys, router.endpoints)


def test_a_router_whose_certificate_expired_is_told(keys: Path) -> None:
    old = keys.parent / "old"
    make_keys(old, days=1.0, ago=2 * DAY)
    assert "the router's certificate has expired" in handshake_with(old)


def test_a_port_that_does_not_speak_tls_and_one_where_nobody_is_are_told_apart(keys: Path) -> None:
    with Router(LinkTable()) as plain:
        port = plain.endpoint.rpartition(":")[2]
        with pytest.raises(LinkError, match=f"tls/127.0.0.1:{port}"):
            join(keys, (f"tls/127.0.0.1:{port}",))
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
        with pytest.raises(LinkError, match="no Zenoh router answers"):
            join(keys, (f"tls/127.0.0.1:{port}",))


def test_the_second_process_of_one_id_is_refused_and_a_watcher_is_not(router: Router, keys: Path) -> None:
    link = LinkTable(keys=str(keys), lease_s=0.3)
    at = router.endpoints
    with member(keys, at, "robot", "r1") as first:
        second = ZenohTransport(link, TEAM, endpoints=at)
        with second, pytest.raises(JoinError, match="another process of the team is robot r1 already"):
            second.open(Peer("robot", "r1", "b2"), lambda: None)
        assert first.drain_peer_changes() == []  # and nobody was disturbed
        with member(keys, at, "watch", "watch"), member(keys, at, "watch", "watch"):
            pass


def test_who_comes_back_after_a_death_takes_the_name_again(router: Router, keys: Path) -> None:
    with member(keys, router.endpoints, "robot", "r1") as first:
        first.close()
        with member(keys, router.endpoints, "robot", "r1") as second:
            assert second.drain_peer_changes() == []


def join(keys: Path, endpoints: tuple[str, ...]) -> None:
    with ZenohTransport(LinkTable(keys=str(keys)), TEAM, endpoints=endpoints) as transport:
        transport.open(Peer("robot", "r1", "b"), lambda: None)


def handshake_with(keys: Path) -> str:
    """What `tls_trouble` says of a server with the router's files of `keys`, by Python's own TLS."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(keys / "router" / "cert.pem", keys / "router" / "key.pem")
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            connection, _ = server.accept()
            with connection, suppress(OSError):
                context.wrap_socket(connection, server_side=True).close()

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        own = keys / "r1"
        files = Credentials(own / "ca.pem", own / "cert.pem", own / "key.pem")
        trouble = tls_trouble((f"tls/127.0.0.1:{server.getsockname()[1]}",), files)
        thread.join(5.0)
    return trouble or ""
