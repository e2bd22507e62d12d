"""The mission protocol, step by step as the MAVLink developer guide describes it."""

import math
from typing import Any

import pytest

from bridges.mavlink.dialect import mavlink
from sim.mavlink.plans import Item, sound_fence
from sim.mavlink.settings import Settings
from tests.sim.mavlink.bench import AUTO, GUIDED, Bench

AUTOPILOTS = ["ardupilot", "px4"]


def place(bench: Bench, north: float, east: float) -> tuple[int, int]:
    latitude, longitude = bench.pilot.projection.to_degrees(north, east)
    return round(latitude * 1e7), round(longitude * 1e7)


def item(
    bench: Bench, seq: int, command: int, where: tuple[int, int, float], kind: int = 0, *params: float
) -> Any:
    frame = 3 if kind == 0 else 0
    filled = [*params, *[0.0] * (4 - len(params))]
    return mavlink.MAVLink_mission_item_int_message(1, 1, seq, frame, command, 0, 1, *filled, *where, kind)


def upload(bench: Bench, items: list[Any], kind: int = 0, lose: frozenset[int] = frozenset()) -> int | None:
    """The result; of the requests in `lose`, the first is not answered."""
    bench.say(mavlink.MAVLink_mission_count_message(1, 1, len(items), kind))
    lost = set(lose)
    for _ in range(100):
        for message in bench.run(0.1):
            if message.get_type() == "MISSION_ACK":
                return int(message.type)
            if message.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                if message.seq in lost:
                    lost.discard(message.seq)
                else:
                    bench.say(items[message.seq])
    return None


def square(bench: Bench) -> list[Any]:
    """Take-off and three corners, with the item for home that ArduPilot wants first."""
    home = 1 if bench.pilot.wire_autopilot == 3 else 0
    corners = [(20.0, 0.0), (20.0, 20.0), (0.0, 20.0)]
    items = [item(bench, 0, 16, (0, 0, 0.0))] if home else []
    items.append(item(bench, home, 22, (0, 0, 10.0)))
    items += [item(bench, home + 1 + i, 16, (*place(bench, *c), 10.0)) for i, c in enumerate(corners)]
    return items


def download(bench: Bench, kind: int = 0) -> list[Any]:
    bench.say(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
    count = next(m.count for m in bench.run(0.2) if m.get_type() == "MISSION_COUNT")
    for seq in range(count):
        bench.say(mavlink.MAVLink_mission_request_int_message(1, 1, seq, kind))
    return [m for m in bench.run(0.2) if m.get_type() == "MISSION_ITEM_INT"]


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_what_was_uploaded_is_downloaded(autopilot: str) -> None:
    bench = Bench(Settings(autopilot=autopilot))  # type: ignore[arg-type]
    bench.run(2.0)
    items = square(bench)
    assert upload(bench, items) == 0
    back = download(bench)
    home = bench.pilot.home_is_item_0
    assert [m.command for m in back] == [m.command for m in items]
    assert [(m.x, m.y, m.z) for m in back[home:]] == [(m.x, m.y, m.z) for m in items[home:]]
    if home:
        assert back[0].z == bench.pilot.settings.home[2]  # whatever was sent as item 0, it is home


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_lost_item_is_asked_for_again(autopilot: str) -> None:
    bench = Bench(Settings(autopilot=autopilot))  # type: ignore[arg-type]
    bench.run(2.0)
    assert upload(bench, square(bench), lose=frozenset({0, 2})) == 0


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_an_upload_that_falls_silent_leaves_the_old_plan(autopilot: str) -> None:
    bench = Bench(Settings(autopilot=autopilot))  # type: ignore[arg-type]
    bench.run(2.0)
    assert upload(bench, square(bench)) == 0
    before = download(bench)
    bench.say(mavlink.MAVLink_mission_count_message(1, 1, 9, 0))
    acks = [m.type for m in bench.run(10.0) if m.get_type() == "MISSION_ACK"]
    assert acks == [15]
    assert [m.command for m in download(bench)] == [m.command for m in before]


@pytest.mark.parametrize(
    ("command", "where", "result"),
    [(16, (0, 0, math.nan), 5), (16, (950_000_000, 0, 1.0), 5), (31010, (0, 0, 1.0), 3)],
)
def test_an_impossible_item_ends_the_upload_with_its_reason(
    command: int, where: tuple[int, int, float], result: int
) -> None:
    bench = Bench(Settings(autopilot="px4"))
    bench.run(2.0)
    assert upload(bench, [item(bench, 0, command, where)]) == result


def test_an_ardupilot_flies_its_mission_in_auto() -> None:
    bench = Bench(Settings())
    bench.run(2.0)
    assert upload(bench, square(bench)) == 0
    assert bench.mode(GUIDED) == 0
    assert bench.command(400, 1) == 0
    assert bench.mode(AUTO) == 0
    bench.run(60.0)
    assert math.dist(bench.pilot.body.position, (0.0, 20.0, -10.0)) < 0.5
    assert [m.seq for m in bench.of("MISSION_ITEM_REACHED")] == [1, 2, 3, 4]


def test_a_px4_flies_its_mission_and_holds_at_the_end() -> None:
    bench = Bench(Settings(autopilot="px4"))
    bench.run(2.0)
    assert upload(bench, square(bench)) == 0
    assert bench.command(400, 1) == 0
    assert bench.command(300) == 0
    bench.run(60.0)
    assert math.dist(bench.pilot.body.position, (0.0, 20.0, -10.0)) < 0.5
    assert bench.pilot.mode == "HOLD"
    assert [m.seq for m in bench.of("MISSION_ITEM_REACHED")] == [0, 1, 2, 3]


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_leaving_an_uploaded_fence_strikes(autopilot: str) -> None:
    parameters = {"FENCE_ENABLE": 1.0} if autopilot == "ardupilot" else {"GF_ACTION": 3.0}
    bench = Bench(Settings(autopilot=autopilot, parameters=parameters))  # type: ignore[arg-type]
    bench.run(2.0)
    ring = [(-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0)]
    items = [item(bench, i, 5001, (*place(bench, *c), 0.0), 1, 4.0) for i, c in enumerate(ring)]
    assert upload(bench, items, kind=1) == 0
    bench.fly()
    if autopilot == "ardupilot":
        bench.run(11.0, every=bench.velocity_setpoint(3.0, 0.0, 0.0))
    else:
        bench.run(2.0, every=bench.velocity_setpoint(3.0, 0.0, 0.0))
        bench.mode(6)
        bench.run(11.0, every=bench.velocity_setpoint(3.0, 0.0, 0.0))
    assert bench.pilot.mode == "RTL"


def vertex(count: float, command: int = 5001) -> Item:
    return Item(0, command, (count, 0.0, 0.0, 0.0), 47.0, 8.0, 0.0)


def test_a_fence_with_a_vertex_missing_is_refused_and_the_old_one_stands() -> None:
    assert sound_fence([vertex(3)] * 3)
    assert sound_fence([vertex(3)] * 3 + [vertex(4, 5002)] * 4 + [vertex(50.0, 5003)])
    assert not sound_fence([vertex(4)] * 3)
    assert not sound_fence([vertex(2)] * 2)
    assert not sound_fence([vertex(0.0, 5003)])
    bench = Bench(Settings())
    bench.run(2.0)
    good = [item(bench, i, 5001, (470000000 + i, 85000000 + i * i, 0.0), 1, 3.0) for i in range(3)]
    assert upload(bench, good, kind=1) == 0
    assert upload(bench, good[:2], kind=1) == 5
    assert len(download(bench, 1)) == 3
