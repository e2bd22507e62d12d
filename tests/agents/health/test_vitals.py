"""Alive, at its rate, valid: per topic and peer, and what a whole team's health makes of it."""

import msgspec
import numpy as np
import pytest

from agents.health.histogram import Histogram
from agents.health.team_health import HealthBoard, TeamHealth
from agents.health.vitals import Stream, Vitals
from agents.wire.messages import HealthMessage, Message, PoseMessage
from agents.wire.transport import Peer, PeerChange
from tests.agents.fakes import mission

PEERS = {"r1": "robot"}
HEAD = {"team": "t", "time": 0.0}


def pose(sequence: int, boot: str = "b", sender: str = "r1") -> Message:
    return PoseMessage(
        **HEAD,
        sender=sender,
        boot=boot,
        sequence=sequence,
        pose=np.zeros(4),
        velocity=np.zeros(3),
        state="moving",
        travelled=0.0,
    )


def health(sequence: int, sender: str = "r1", **counters: int) -> HealthMessage:
    return HealthMessage(
        **HEAD,
        sender=sender,
        boot="b",
        sequence=sequence,
        role="robot",
        state="moving",
        counters=counters,
        gauges={"memory_mb": 150.0, "queue.pose": 3.0, "clock_offset_ms": 1.0, "late_ms.pose": 7.0},
        histograms={"plan_ms": Histogram().counts},
    )


def of(rows: list[Stream], topic: str) -> Stream:
    (row,) = [row for row in rows if row.topic == topic]
    return row


def said(vitals: Vitals, hz: float, seconds: float) -> None:
    for i in range(int(hz * seconds)):
        vitals.heard("pose", pose(i), i / hz, 0.01)


@pytest.mark.parametrize(("hz", "right"), [(5.0, True), (4.0, True), (3.0, False), (0.5, False)])
def test_a_rate_is_right_from_seven_tenths_of_the_usual_one_on(hz: float, right: bool) -> None:
    vitals = Vitals(mission(1), 0.0)
    said(vitals, hz, 20.0)
    row = of(vitals.streams(20.0, 1.0, PEERS), "pose")
    assert row.rate_ok is right
    assert row.usual_hz == 5.0
    assert row.rate_hz == pytest.approx(hz, rel=0.1)


def test_what_a_queue_replaced_by_newer_ones_counts_as_said() -> None:
    vitals = Vitals(mission(1), 0.0)
    for i in range(20):  # of five poses a second only each fifth was looked at
        vitals.heard("pose", pose(5 * i), float(i))
    assert of(vitals.streams(19.5, 1.0, PEERS), "pose").rate_hz == pytest.approx(5.0)


def test_a_mission_with_another_period_and_a_faster_team_have_other_usual_rates() -> None:
    vitals = Vitals(mission(1, settings={"pose_period_s": 0.5}), 0.0)
    said(vitals, 2.0, 20.0)
    assert of(vitals.streams(20.0, 1.0, PEERS), "pose").rate_ok
    assert of(vitals.streams(20.0, 4.0, PEERS), "pose").usual_hz == 8.0
    assert not of(vitals.streams(20.0, 4.0, PEERS), "pose").rate_ok


def test_who_is_alive_and_says_nothing_is_not_at_its_rate_after_a_while() -> None:
    vitals = Vitals(mission(1), 100.0)
    assert of(vitals.streams(101.0, 1.0, PEERS), "pose").rate_ok  # it may have just come
    assert not of(vitals.streams(103.0, 1.0, PEERS), "pose").rate_ok
    assert vitals.streams(103.0, 1.0, {}) == []  # of who is not there nothing is expected


def test_what_fell_silent_is_neither_at_its_rate_nor_after_its_age_valid() -> None:
    vitals = Vitals(mission(1), 0.0)
    said(vitals, 5.0, 10.0)
    fresh, silent = (of(vitals.streams(at, 1.0, PEERS), "pose") for at in (10.0, 13.0))
    assert (fresh.rate_ok, fresh.valid) == (True, True)
    assert (silent.rate_ok, silent.valid) == (False, False)  # a pose counts for 2 s
    assert silent.age_s == pytest.approx(3.2)


def test_a_refused_message_makes_a_stream_invalid_until_a_good_one_comes() -> None:
    vitals = Vitals(mission(1), 0.0)
    said(vitals, 5.0, 2.0)
    vitals.refused("pose", "r1", 1.9)
    row = of(vitals.streams(2.0, 1.0, PEERS), "pose")
    assert (row.valid, row.refused) == (False, 1)
    vitals.heard("pose", pose(11), 2.1)
    assert of(vitals.streams(2.2, 1.0, PEERS), "pose").valid


def test_a_new_boot_begins_its_rate_anew() -> None:
    vitals = Vitals(mission(1), 0.0)
    said(vitals, 5.0, 10.0)
    for i in range(5):
        vitals.heard("pose", pose(i, "b2"), 10.0 + 0.2 * i)
    row = of(vitals.streams(11.0, 1.0, PEERS), "pose")
    assert row.rate_hz == pytest.approx(5.0)
    assert row.rate_ok


def test_gauges_tell_the_greatest_lateness_once_and_who_is_not_heard() -> None:
    vitals = Vitals(mission(2), 0.0)
    said(vitals, 5.0, 10.0)
    vitals.heard("pose", pose(50), 10.0, 0.25)
    peers = {**PEERS, "r2": "robot"}
    assert vitals.gauges(10.0, 1.0, peers) == {"late_ms.pose": 250.0, "silent.pose": 1.0}
    assert vitals.gauges(10.0, 1.0, PEERS) == {}


def team(seconds: float = 10.0) -> tuple[HealthBoard, Vitals]:
    """A board that heard a robot and a fusion, both well."""
    vitals = Vitals(mission(1), 0.0)
    board = HealthBoard(mission(1), vitals)
    for role, name in (("robot", "r1"), ("fusion", "fusion")):
        board.on_peer(PeerChange(Peer(role, name, "b"), True))
    for i in range(int(5 * seconds)):
        vitals.heard("pose", pose(i), 0.2 * i)
        for name in ("r1", "fusion"):
            for topic in ("health", "posterior", "picture", "start") if name == "fusion" else ("health",):
                vitals.heard(topic, health(i // 5, name), 0.2 * i)
    board.on_message(health(0))
    return board, vitals


def report(board: HealthBoard, wall: float = 10.0) -> TeamHealth:
    return board.report(wall, 1.0, 42.0)


def test_a_team_that_is_well_is_healthy_and_says_so_in_json() -> None:
    board, _ = team()
    plain = msgspec.to_builtins(report(board))
    assert plain["healthy"] is True
    assert plain["problems"] == []
    (robot,) = [p for p in plain["processes"] if p["id"] == "r1"]
    assert robot["queues"] == {"pose": 3}
    assert robot["memory_mb"] == 150.0
    assert robot["clock"]["offset_ms"] == 1.0
    assert robot["late_ms"] == {"pose": 7.0}
    assert robot["topics"]["pose"] | {"age_s": None, "rate_hz": None} == {
        "alive": True,
        "rate_ok": True,
        "valid": True,
        "rate_hz": None,
        "usual_hz": 5.0,
        "age_s": None,
        "late_ms": None,
        "refused": 0,
    }


def test_each_trouble_is_a_sentence() -> None:
    board, vitals = team()
    board.on_peer(PeerChange(Peer("fusion", "fusion", "b"), False))
    assert "no fusion is alive: robots go on with what they know" in report(board).problems
    board, _ = team()
    board.on_peer(PeerChange(Peer("robot", "r1", "b"), False))
    assert report(board).problems == ["robot r1 is not there"]
    board, _ = team()
    board.on_peer(PeerChange(Peer("robot", "r1", "b2"), True))
    assert report(board).problems == ["2 processes are robot r1: b, b2"]
    board, _ = team()
    board.on_message(health(1, **{"rejected.not_finite": 4, "link.dropped.set": 2}))
    assert report(board).problems == [
        "r1 dropped 2 messages of set",
        "r1 refused 4 messages (not_finite)",
    ]
    board, vitals = team()
    vitals.refused("pose", "r1", 10.0)
    assert report(board).problems == ["what r1 says on pose is not used: 1 refused"]
    board, _ = team()
    assert "r1 says nothing on pose, usual is 5.0 Hz" in report(board, 20.0).problems


def test_what_was_refused_before_one_looked_is_counted_but_no_trouble_now() -> None:
    board, _ = team()
    fresh = HealthBoard(mission(1), board._vitals)
    fresh.on_peer(PeerChange(Peer("robot", "r1", "b"), True))
    fresh.on_peer(PeerChange(Peer("fusion", "fusion", "b"), True))
    fresh.on_message(health(7, **{"rejected.not_finite": 4}))
    fresh.on_message(health(8, **{"rejected.not_finite": 4}))
    said_now = fresh.report(10.0, 1.0, None)
    assert said_now.problems == []
    assert said_now.processes[0].rejected == {"not_finite": 4}
