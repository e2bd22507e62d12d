"""Operators' requests: from a table over the network to those who go there, and mistakes in them."""

from dataclasses import dataclass

import numpy as np
import pytest
from typer.testing import CliRunner

from agents.cli import app
from agents.errors import MissionError
from agents.machine import Heard, Publish
from agents.mission.mission import RequestTable
from agents.mission.mission_file import load
from agents.operator.requester import AGAIN_S, Requester
from agents.wire import codec
from agents.wire.messages import BidMessage, RequestMessage, Wish
from agents.wire.topics import BID, REQUEST
from tests.agents.fakes import mission

TABLE = RequestTable(at_s=2.0, name="door", at=[5.0, 6.0], robots=2)


def bid(robot: str, wishes: list[Wish], held: bool = False, time: float = 3.0) -> BidMessage:
    slots = {"request-door#1": robot} if held else {}
    return BidMessage(
        team="t",
        sender=robot,
        boot="b",
        sequence=0,
        time=time,
        said=time,
        tasks=["request-door"],
        places=np.zeros((1, 2)),
        path=[],
        winning_bids=dict.fromkeys(slots, 1.0),
        winning_agents=slots,
        timestamps={},
        digests={},
        wishes=wishes,
    )


@dataclass
class Desk:
    requester: Requester

    def step(self, now: float, *messages: BidMessage) -> list[Wish]:
        actions = self.requester.step(now, [Heard(BID, message) for message in messages])
        return [a.message.wish for a in actions if isinstance(a, Publish)]  # type: ignore[attr-defined]


def test_a_request_is_asked_again_until_a_robot_passes_it_on_and_then_followed() -> None:
    desk = Desk(Requester(mission(), "op", "b1"))
    desk.requester.plan(2.0, TABLE)
    assert desk.requester.next_wake() == 2.0
    assert desk.step(1.0) == []
    (asked,) = desk.step(2.0)
    assert (asked.name, asked.place, asked.robots, asked.asked) == ("request-door", [5.0, 6.0], 2, 2.0)
    assert desk.step(2.1, bid("r1", [])) == []
    assert desk.step(2.0 + AGAIN_S) == [asked]
    assert desk.step(3.0, bid("r1", [asked])) == []
    assert desk.step(9.0) == []  # the robots have it
    r = desk.requester
    assert (r.known, r.holders) == ({"request-door": {"r1"}}, {"request-door": set()})
    desk.step(9.1, bid("r1", [asked], held=True), bid("r2", [asked], held=True))
    assert r.holders["request-door"] == {"r1", "r2"}
    desk.step(9.2, bid("r1", [asked]))
    assert r.holders["request-door"] == {"r2"}


def test_an_older_request_of_the_same_name_is_no_answer() -> None:
    desk = Desk(Requester(mission(), "op", "b1"))
    desk.requester.plan(2.0, TABLE)
    (asked,) = desk.step(2.0)
    old = Wish(name=asked.name, place=[0.0, 0.0], worth=1.0, robots=1, needs=[], asked=1.0, looked=["r1"])
    desk.step(2.2, bid("r1", [old]))
    assert desk.requester.looked["request-door"] == set()
    assert desk.step(2.0 + AGAIN_S) == [asked]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["door", "--at", "1,x"], "--at: found '1,x'"),
        (["door", "--at", "1,2,3"], "2 values, as many as area.min"),
        (["door", "--at", "1,999"], "inside the area"),
        (["door", "--at", "1,2", "--robots", "4"], "capabilities that 4 of the mission's robots have"),
        (["door", "--at", "1,2", "--needs", "wings"], "no robot"),
        (["two words", "--at", "1,2"], "name"),
        (["door", "--at", "1,2", "--worth", "nan"], "worth"),
        (["door", "--at", "1,2", "--as", "rover"], "process of the team"),
    ],
)
def test_a_request_that_makes_no_sense_is_refused_before_the_network_is_asked(
    arguments: list[str], words: str
) -> None:
    result = CliRunner().invoke(app, ["request", "tasks", *arguments])
    assert isinstance(result.exception, MissionError)
    assert words in str(result.exception)


def test_a_mission_whose_robots_share_no_tasks_takes_no_requests() -> None:
    result = CliRunner().invoke(app, ["request", "quickstart", "door", "--at", "1,2"])
    assert isinstance(result.exception, MissionError)
    assert "cbba" in str(result.exception)


def test_a_misspelt_capability_is_told(tmp_path_factory: pytest.TempPathFactory) -> None:
    text = open_mission().replace('["explore"]', '["explor"]', 1)
    file = tmp_path_factory.mktemp("mission") / "m.toml"
    file.write_text(text)
    with pytest.raises(MissionError, match=r"robots\[0\]\.capabilities\[0\].*explore"):
        load(file)


def open_mission() -> str:
    from agents.mission.mission_file import find

    return find("tasks").read_text()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"place": [float("nan"), 0.0]}, "not_finite"),
        ({"worth": float("inf")}, "not_finite"),
        ({"robots": 0}, "wrong_type"),
        ({"place": [1.0]}, "wrong_type"),
        ({"name": "a b"}, "wrong_type"),
    ],
)
def test_a_damaged_request_is_refused_also_in_a_bid(change: dict[str, object], reason: str) -> None:
    from agents.errors import MalformedMessage

    table = {"name": "request-a", "place": [1.0, 2.0], "worth": 1.0, "robots": 1, "needs": [], "asked": 1.0}
    bad = Wish(**(table | change))  # type: ignore[arg-type]
    header = {"team": "t", "sender": "r1", "boot": "b", "sequence": 0, "time": 1.0}
    alone = RequestMessage(**header, wish=bad)  # type: ignore[arg-type]
    for topic, message in ((REQUEST, alone), (BID, bid("r1", [bad]))):
        with pytest.raises(MalformedMessage) as error:
            codec.decode(topic, codec.encode(message), team="t", sender="r1")
        assert error.value.reason == reason


def test_a_bid_comes_through_as_it_was_sent_and_a_contradictory_one_does_not() -> None:
    from msgspec.structs import replace

    from agents.errors import MalformedMessage

    sent = bid(
        "r1", [Wish(name="request-a", place=[1, 2], worth=1, robots=1, needs=["x"], asked=1)], held=True
    )
    got = codec.decode(BID, codec.encode(sent), team="t", sender="r1")
    assert isinstance(got, BidMessage)
    assert (got.winning_agents, got.wishes) == (sent.winning_agents, sent.wishes)
    assert got.places.shape == (1, 2)
    for wrong in (
        replace(sent, winning_bids={}),
        replace(sent, tasks=["a", "b"]),
        replace(sent, winning_bids={"request-door#1": float("nan")}),
        replace(sent, timestamps={"r1": float("inf")}),
    ):
        with pytest.raises(MalformedMessage):
            codec.decode(BID, codec.encode(wrong), team="t", sender="r1")
