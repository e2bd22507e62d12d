"""Keys and guarded sessions for tests."""

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

from agents.mission.mission import LinkTable
from agents.wire.transport import Peer
from bridges.keys.workshop import Workshop
from bridges.zenoh.transport import ZenohTransport
from tests.agents.fakes import mission

TEAM = "t"  # of the fake mission
DAY = timedelta(days=1)


def make_keys(
    directory: Path,
    *,
    robots: int = 2,
    days: float = 30.0,
    ago: timedelta = timedelta(0),
    hosts: list[str] | None = None,
) -> Workshop:
    """The keys of the fake team, as `searchparty keys` would have made them a while ago."""
    workshop = Workshop.open(directory, mission(robots), datetime.now(UTC) - ago, days)
    workshop.issue(hosts or [])
    workshop.write()
    return workshop


@contextmanager
def member(
    keys: Path, endpoints: tuple[str, ...], role: str, name: str, identity: str | None = None
) -> Iterator[ZenohTransport]:
    """A session of a process, with the keys of `identity` if that is another's."""
    with ZenohTransport(LinkTable(keys=str(keys)), TEAM, endpoints=endpoints) as transport:
        if identity is not None:
            disguise(keys, name, identity)
        transport.open(Peer(role, name, f"{name}-boot"), lambda: None)
        yield transport


def disguise(keys: Path, name: str, identity: str) -> None:
    """Put the keys of another process into the place of a process's own."""
    for file in ("cert.pem", "key.pem"):
        (keys / name / file).write_bytes((keys / identity / file).read_bytes())
