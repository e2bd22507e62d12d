"""`searchparty watch` between real processes, and its parts alone."""

import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader

from agents.machine import Heard
from agents.mission.mission import LinkTable
from agents.mission.mission_file import load
from agents.swarm.status_board import StatusBoard
from agents.swarm.status_table import TeamStatus
from agents.wire import codec
from agents.wire.topics import POSE, TOPICS
from agents.wire.transport import Peer, PeerChange
from bridges.rerun import watch
from bridges.rerun.blueprint import EVENTS, FOUND
from bridges.zenoh.local_router import Router
from bridges.zenoh.transport import ZenohTransport
from tests.bridges.rerun_story import Story, mission

QUICKSTART = Path(__file__).parents[3] / "missions" / "quickstart.toml"


def play(transport: ZenohTransport, story: Story) -> None:
    """Publish a story as one process: the codec wants the sender that the key names."""
    for topic, message in story.messages():
        if message.sender == "fusion":
            transport.publish(TOPICS[topic], codec.encode(message))


@pytest.mark.processes
def test_watch_records_what_it_hears_and_ends_on_a_signal(tmp_path: Path) -> None:
    loaded = load(QUICKSTART)
    view = tmp_path / "view.rrd"
    with Router(LinkTable()) as router:
        command = [sys.executable, "-m", "agents.cli", "watch", str(QUICKSTART)]
        options = ["--connect", router.endpoint, "--record", str(view), "--view", "none", "--quiet"]
        log = (tmp_path / "log").open("w")
        with (
            log,
            subprocess.Popen([*command, *options], stdout=log, stderr=log) as process,
            ZenohTransport(loaded.link, loaded.team, endpoints=router.endpoints) as transport,
        ):
            try:
                transport.open(Peer("fusion", "fusion", "b1"), lambda: None)
                watching = _wait_for_watcher(transport, process)
                if watching:
                    play(transport, Story(loaded, duration=20.0))
                    time.sleep(2.0)
                process.send_signal(signal.SIGTERM)
                status = process.wait(20)
            finally:
                process.kill()

    assert watching, (tmp_path / "log").read_text()
    assert status == 0, (tmp_path / "log").read_text()
    entities = {chunk.entity_path.strip("/") for chunk in RrdReader(view).stream()}
    assert {FOUND, f"{EVENTS}/fusion"} <= entities


def _wait_for_watcher(transport: ZenohTransport, process: "subprocess.Popen[bytes]") -> bool:
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline and process.poll() is None:
        if any(change.peer.role == "watch" for change in transport.drain_peer_changes()):
            time.sleep(1.0)  # it subscribes after it joins
            return True
        time.sleep(0.05)
    return False


class SlowView:
    """A view whose viewer takes nothing until it is told to."""

    def __init__(self) -> None:
        self.go = threading.Event()
        self.seen: list[Any] = []

    def on_message(self, topic_name: str, message: Any) -> None:
        self.go.wait(10.0)
        self.seen.append(message)

    def on_peer(self, change: PeerChange) -> None:
        self.seen.append(change)

    def show(self, now: float | None) -> None:
        pass

    def close(self, timeout: float) -> None:
        self.go.set()


def heard(count: int) -> list[Heard]:
    message = next(msg for topic, msg in Story(mission(2)).messages() if topic == "pose")
    return [Heard(POSE, message)] * count


def test_slow_viewer_costs_messages_and_neither_memory_nor_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watch, "_QUEUE", 100)
    view = SlowView()
    drawer = watch.Drawer(view, print)  # type: ignore[arg-type]

    for _ in range(50):
        drawer.put(heard(10), 0.0)

    assert drawer.dropped >= 200  # the thread may have taken some of the queue meanwhile
    drawer.close(0.3)


def test_picture_that_fails_does_not_end_the_drawing() -> None:
    complaints: list[str] = []
    view = SlowView()
    view.go.set()
    calls = iter([ValueError("odd"), None])

    def show(now: float | None) -> None:
        if (error := next(calls, None)) is not None:
            raise error

    view.show = show  # type: ignore[method-assign]
    drawer = watch.Drawer(view, complaints.append)  # type: ignore[arg-type]
    drawer.put(heard(1), 0.0)
    deadline = time.monotonic() + 10.0
    while not complaints and time.monotonic() < deadline:
        time.sleep(0.01)
    drawer.put(heard(1), 0.0)
    drawer.close(5.0)

    assert complaints == ["could not draw: ValueError: odd"]
    assert len(view.seen) == 2


def board_after(dimension: int = 2) -> tuple[StatusBoard, TeamStatus]:
    story = Story(mission(dimension), duration=40.0)
    board = StatusBoard(story.mission)
    for robot in story.mission.robots:
        board.on_peer(PeerChange(Peer("robot", robot.id, "b1"), True))
    board.on_peer(PeerChange(Peer("fusion", "fusion", "b1"), True))
    for topic, message in story.messages():
        board.on_message(topic, message, wall=message.time)
    return board, board.status(wall=40.0, team_time=40.0)


def test_board_knows_the_team_from_its_messages() -> None:
    _, status = board_after()
    rows = {row.id: row for row in status.processes}

    assert list(rows) == ["r1", "r2", "r3", "r4", "fusion"]
    assert status.total == 10
    assert status.found > 0
    assert rows["r1"].travelled_m is not None
    assert rows["r1"].travelled_m > 10.0
    assert rows["r1"].sets_stored == 40
    assert rows["fusion"].state == "running"
    assert all(row.alive for row in rows.values())


def test_board_tells_a_death_a_return_and_who_never_came() -> None:
    story = Story(mission(2))
    board = StatusBoard(story.mission)
    board.on_peer(PeerChange(Peer("robot", "r1", "b1"), True))
    board.on_peer(PeerChange(Peer("robot", "r1", "b1"), False))
    dead = {row.id: row for row in board.status(0.0, None).processes}
    board.on_peer(PeerChange(Peer("robot", "r1", "b2"), True))
    back = {row.id: row for row in board.status(0.0, None).processes}

    assert not dead["r1"].alive
    assert dead["r2"].state == "not heard yet"
    assert back["r1"].alive
    assert back["r1"].restarts == 1
