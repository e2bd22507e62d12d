"""Who is believed, and what a user reads when the vehicle is not the one that the mission says."""

import pytest

from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.pilot import Pilot
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.port import LinkState
from bridges.mavlink.wanted import TakeOff, Wanted
from bridges.mavlink.wire import Wire
from sim.mavlink.settings import Settings
from tests.bridges.mavlink.air import ARM, Air


def heartbeat(system: int, component: int = 1, autopilot: int = 3, kind: int = 2) -> Message:
    wire = Wire((system, component))
    (message,) = wire.parse(wire.pack(mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 3, 3)))
    return message


def trouble(config: PilotConfig, *messages: Message, link: LinkState | None = None) -> str:
    pilot = Pilot(config)
    for step in range(100):
        out = pilot.step(step * 0.05, list(messages), Wanted(TakeOff()), 0.0, link)
        assert {message.get_type() for message in out} <= {"HEARTBEAT"}
    return pilot.trouble


def test_our_heartbeat_is_an_onboard_computer_s_once_a_second() -> None:
    pilot = Pilot(PilotConfig(system=7))
    beats = [(t, m) for t in range(100) for m in pilot.step(t * 0.1, [], Wanted())]
    assert len(beats) == 10
    assert all(m.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER for _, m in beats)
    assert all(m.autopilot == mavlink.MAV_AUTOPILOT_INVALID for _, m in beats)
    assert pilot.us == (7, 191)
    assert Pilot(PilotConfig(system=7, source_system=250, source_component=192)).us == (250, 192)


@pytest.mark.parametrize(
    "message",
    [
        heartbeat(1, component=190, autopilot=8, kind=6),
        heartbeat(1, component=1, autopilot=8, kind=2),
        heartbeat(1, component=154, autopilot=8, kind=26),
    ],
    ids=["ground station", "no autopilot", "gimbal"],
)
def test_only_an_autopilot_is_believed(message: Message) -> None:
    assert "no vehicle" in trouble(PilotConfig(system=1), message)


def test_no_vehicle_is_said_in_one_sentence() -> None:
    assert trouble(PilotConfig(url="udpin:0.0.0.0:14550")).startswith(
        "no vehicle is heard at udpin:0.0.0.0:14550"
    )


def test_a_link_that_cannot_be_opened_says_why() -> None:
    link = LinkState(open=False, trouble="Connection refused")
    assert "cannot be opened: Connection refused" in trouble(PilotConfig(), link=link)


def test_a_wrong_system_id_names_those_that_are_there() -> None:
    said = trouble(PilotConfig(system=1), heartbeat(3), heartbeat(4, kind=10))
    assert "system 1 is not at" in said
    assert "3 (copter), 4 (rover)" in said


def test_the_only_vehicle_is_taken_when_any_is_welcome_and_several_are_named() -> None:
    pilot = Pilot(PilotConfig(system=None))
    for step in range(60):
        pilot.step(step * 0.05, [heartbeat(9)], Wanted())
    assert pilot.identity.system == 9
    assert "several vehicles" in trouble(PilotConfig(system=None), heartbeat(3), heartbeat(4))


def test_a_version_1_vehicle_is_told_what_to_change() -> None:
    assert "MAVLink 1" in trouble(PilotConfig(), link=LinkState(version1=frozenset({1})))


def test_a_signing_mismatch_is_told_from_silence_on_either_side() -> None:
    assert "compare the keys" in trouble(PilotConfig(), link=LinkState(unsigned=frozenset({1}), keys=True))
    said = trouble(PilotConfig(), heartbeat(1), link=LinkState(signing=frozenset({1})))
    assert "signs its messages" in said


def test_a_rover_where_a_copter_is_expected_is_refused_with_both() -> None:
    said = trouble(PilotConfig(body="copter"), heartbeat(1, kind=10))
    assert "is a rover" in said
    assert "expects a copter" in said


def test_another_autopilot_than_expected_is_refused_with_both() -> None:
    said = trouble(PilotConfig(autopilot="px4"), heartbeat(1))
    assert "ardupilot" in said
    assert "expects px4" in said


@pytest.mark.parametrize(("autopilot", "kind"), [(3, 1), (12, 10), (0, 2)])
def test_what_nobody_here_flies_is_refused(autopilot: int, kind: int) -> None:
    assert "only these are flown" in trouble(PilotConfig(), heartbeat(1, autopilot=autopilot, kind=kind))


def test_two_vehicles_with_one_id_at_two_addresses_are_refused() -> None:
    link = LinkState(doubled=frozenset({1}))
    assert "two vehicles with system id 1" in trouble(PilotConfig(), heartbeat(1), link=link)


def test_two_vehicles_with_one_id_behind_one_router_are_refused_and_nothing_is_armed() -> None:
    air = Air(Settings())
    other = Air(Settings(clock_offset=500.0, default_streams=True))
    step = air.vehicle.step

    def both(now: float, received: list[tuple[str, bytes]]) -> list[bytes]:
        return [*step(now, received), *other.vehicle.step(now, received)]

    air.vehicle.step = both  # type: ignore[method-assign, assignment]
    air.want(TakeOff())
    air.fly(10.0)
    assert air.pilot.phase == "refused"
    assert "two vehicles with system id 1" in air.report.trouble
    assert not air.report.armed or not air.commands(ARM)


def test_a_version_1_simulated_vehicle_is_refused_over_the_wire() -> None:
    air = Air(Settings(version_1=True))
    air.fly(3.0)
    assert air.wire.version1 == {1}
    assert air.report.position is None


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_what_is_found_to_be_wrong_in_the_air_brings_it_down_and_keeps_it_there(autopilot: str) -> None:
    air = Air(Settings(autopilot=autopilot, ready_after=0.1))  # type: ignore[arg-type]
    air.airborne()
    air.state = lambda: LinkState(doubled=frozenset({1}))  # type: ignore[method-assign]
    assert air.until(lambda: not air.autopilot.armed, 60.0), air.report
    assert air.said().count("two vehicles with system id 1") == 1
    assert air.until(lambda: air.report.phase == "refused", 5.0)
    air.state = LinkState  # type: ignore[method-assign]
    air.fly(10.0)
    assert not air.autopilot.armed  # only a person's act lets it fly again
