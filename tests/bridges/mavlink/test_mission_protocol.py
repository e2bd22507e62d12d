"""Plans go up and come back whole, over bad links too, or the old one stands and a sentence says why."""

import math

import pytest

from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.mission_items import RESULTS, Item, PlanKind, waypoint
from bridges.mavlink.mission_protocol import Clear, Conversation, Download, Upload, keeps_home_first
from bridges.mavlink.pilot_config import PilotConfig
from sim.mavlink.settings import Settings
from tests.bridges.mavlink.air import Air

VEHICLE, US = (1, 1), (1, 191)
ROUTE = [waypoint(47.3977 + 1e-4 * i, 8.5456 - 1e-4 * i, 20.0 + i, hold=float(i)) for i in range(8)]
RING = [(47.397, 8.545), (47.397, 8.546), (47.398, 8.546), (47.398, 8.545)]
FENCE = [Item(5001, *place, params=(4.0, 0.0, 0.0, 0.0), frame=0) for place in RING]


def air(autopilot: str, seed: int = 0) -> Air:
    made = Air(
        Settings(autopilot=autopilot, ready_after=0.1, seed=seed),  # type: ignore[arg-type]
        PilotConfig(system=1, fly=False),
    )
    assert made.until(lambda: made.report.phase == "ready", 10.0), made.report
    return made


def run(bench: Air, errand: Conversation, seconds: float = 60.0) -> None:
    bench.pilot.run(errand)
    assert bench.until(lambda: errand.done, seconds), errand


def upload(bench: Air, items: list[Item], kind: PlanKind) -> Upload:
    made = Upload(items, kind, VEHICLE, US, keeps_home_first(bench.report.autopilot))
    run(bench, made)
    return made


def download(bench: Air, kind: PlanKind) -> list[Item]:
    made = Download(kind, VEHICLE, US, keeps_home_first(bench.report.autopilot))
    run(bench, made)
    assert made.trouble == ""
    return made.items


def same(found: list[Item], wanted: list[Item]) -> bool:
    return len(found) == len(wanted) and all(
        (a.command, a.frame, a.z) == (b.command, b.frame, b.z)
        and math.isclose(a.x, b.x, abs_tol=6e-8)
        and math.isclose(a.y, b.y, abs_tol=6e-8)
        and all(math.isnan(q) if math.isnan(p) else p == q for p, q in zip(a.params, b.params, strict=True))
        for a, b in zip(found, wanted, strict=True)
    )


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_missions_and_fences_come_back_as_they_went_up(autopilot: str) -> None:
    bench = air(autopilot)
    for items, kind in ((ROUTE, PlanKind.MISSION), (FENCE, PlanKind.FENCE)):
        assert upload(bench, items, kind).trouble == ""
        on_board = bench.autopilot.plans.items[int(kind)]
        assert [(one.command, round(one.x, 7)) for one in on_board] == [
            (one.command, round(one.x, 7)) for one in items
        ]
        assert same(download(bench, kind), items)
    run(bench, Clear(PlanKind.FENCE, VEHICLE, US))
    assert bench.autopilot.plans.items[1] == []
    assert same(download(bench, PlanKind.MISSION), ROUTE)
    assert upload(bench, [], PlanKind.MISSION).trouble == ""
    assert download(bench, PlanKind.MISSION) == []


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("seed", range(4))
def test_a_link_that_loses_a_fifth_of_all_messages_only_takes_longer(autopilot: str, seed: int) -> None:
    bench = air(autopilot, seed)
    bench.fault("lost_messages", 0.2)
    sent = upload(bench, ROUTE, PlanKind.MISSION)
    assert sent.trouble == "", f"{sent}; repeat with seed {seed}"
    assert sent.progress == 1.0
    assert same(download(bench, PlanKind.MISSION), ROUTE), f"repeat with seed {seed}"


def test_where_only_the_last_acknowledgement_is_lost_the_plan_is_offered_again() -> None:
    errand = Upload([ROUTE[0]], PlanKind.MISSION, VEHICLE, US)
    assert [m.get_type() for m in errand.step(0.0, [])] == ["MISSION_COUNT"]
    (item,) = errand.step(0.1, [said(mavlink.MAVLink_mission_request_int_message(*US, 0, 0))])
    assert item.get_type() == "MISSION_ITEM_INT"
    assert errand.step(1.0, []) == []
    assert [m.get_type() for m in errand.step(1.7, [])] == ["MISSION_COUNT"]
    errand.step(1.8, [said(mavlink.MAVLink_mission_ack_message(*US, 0, 0))])
    assert (errand.done, errand.trouble) == (True, "")


def said(message: Message, system: int = 1, component: int = 1) -> Message:
    message._header.srcSystem, message._header.srcComponent = system, component
    return message


@pytest.mark.parametrize("result", sorted(RESULTS))
def test_every_refusal_becomes_words(result: int) -> None:
    errand = Upload(ROUTE, PlanKind.MISSION, VEHICLE, US)
    errand.step(0.0, [])
    errand.step(0.1, [said(mavlink.MAVLink_mission_ack_message(*US, result, 0))])
    assert errand.done
    assert errand.trouble == f"upload of the mission: {RESULTS[result]}"


@pytest.mark.parametrize(
    "stray",
    [
        said(mavlink.MAVLink_mission_ack_message(*US, 1, 1)),  # of the fence
        said(mavlink.MAVLink_mission_ack_message(255, 190, 1, 0)),  # a ground station's
        said(mavlink.MAVLink_mission_ack_message(*US, 1, 0), 2),  # another vehicle's
        said(mavlink.MAVLink_mission_ack_message(*US, 0, 0)),  # of an upload before
        said(mavlink.MAVLink_mission_count_message(*US, 3, 0)),
    ],
)
def test_what_is_said_to_others_or_came_late_decides_nothing(stray: Message) -> None:
    errand = Upload(ROUTE, PlanKind.MISSION, VEHICLE, US)
    errand.step(0.0, [])
    assert errand.step(0.1, [stray]) == []
    assert not errand.done


def test_a_silent_vehicle_is_asked_six_times_and_then_given_up() -> None:
    for errand in (
        Upload(ROUTE, PlanKind.MISSION, VEHICLE, US),
        Download(PlanKind.FENCE, VEHICLE, US),
        Clear(PlanKind.RALLY, VEHICLE, US),
    ):
        sent = [message for tick in range(400) for message in errand.step(tick * 0.05, [])]
        assert len(sent) == 6
        assert errand.done
        assert errand.trouble.endswith("no answer after 6 tries")
        assert errand.step(100.0, []) == []


def test_a_refused_plan_leaves_the_old_one_on_board() -> None:
    bench = air("px4")
    upload(bench, ROUTE[:3], PlanKind.MISSION)
    bad = [*ROUTE, Item(31000, 1.0, 2.0, 3.0)]
    assert "unknown to this autopilot" in upload(bench, bad, PlanKind.MISSION).trouble
    assert same(download(bench, PlanKind.MISSION), ROUTE[:3])


def test_a_vehicle_that_asks_for_nonsense_or_boasts_is_given_up() -> None:
    errand = Upload(ROUTE, PlanKind.MISSION, VEHICLE, US)
    errand.step(0.0, [said(mavlink.MAVLink_mission_request_int_message(*US, 77, 0))])
    assert "asked for item 77 of 8" in errand.trouble
    reading = Download(PlanKind.MISSION, VEHICLE, US)
    reading.step(0.0, [said(mavlink.MAVLink_mission_count_message(*US, 60000, 0))])
    assert "60000 items" in reading.trouble
