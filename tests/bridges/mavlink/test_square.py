"""The test square ends on the ground, and says how near it came to its corners."""

import pytest

from bridges.mavlink.dialect import mavlink
from bridges.mavlink.pilot_config import Fallbacks, PilotConfig
from bridges.mavlink.square import SquareFlight
from sim.mavlink.settings import Settings
from tests.bridges.mavlink.air import Air

CONFIG = PilotConfig(
    system=1, take_off_height=4.0, fallbacks=Fallbacks(on_pose_stale="land", on_robot_silent="land")
)


def ready(autopilot: str = "ardupilot", body: str = "copter", **more: object) -> Air:
    bench = Air(Settings(autopilot=autopilot, type=body, ready_after=0.1, **more), CONFIG)  # type: ignore[arg-type]
    assert bench.until(lambda: bench.report.phase == "ready" and not bench.report.reasons, 20.0), bench.report
    return bench


def fly(bench: Air, flight: SquareFlight, seconds: float = 400.0) -> None:
    """Until it is over."""

    def over() -> bool:
        bench.want(flight.task(bench.now, bench.report))
        return flight.over

    assert bench.until(over, seconds), (flight, bench.report)


def fly_to(bench: Air, flight: SquareFlight, corners: int) -> None:
    """Until so many corners are reached."""

    def there() -> bool:
        bench.want(flight.task(bench.now, bench.report))
        return len(flight.corners) == corners

    assert bench.until(there, 200.0), (flight, bench.report)


@pytest.mark.parametrize(
    ("autopilot", "body"), [("ardupilot", "copter"), ("px4", "copter"), ("ardupilot", "rover")]
)
def test_it_goes_round_and_is_disarmed_where_it_began(autopilot: str, body: str) -> None:
    bench, flight = ready(autopilot, body), SquareFlight(10.0)
    track = []

    def over() -> bool:
        bench.want(flight.task(bench.now, bench.report))
        track.append((len(flight.corners), *bench.autopilot.body.position))
        return flight.over

    assert bench.until(over, 400.0), (flight, bench.report)
    assert flight.good, flight
    assert not bench.report.armed
    reach = 2.5 if body == "rover" else 1.0
    for number, (north, east) in enumerate(((10, 0), (10, 10), (0, 10), (0, 0))):
        corner = flight.corners[number]
        leg = [place for done, *place in track if done == number]
        true = min(((x - north) ** 2 + (y - east) ** 2) ** 0.5 for x, y, _ in leg[1 if number else 0 :])
        assert corner.reached
        assert true <= reach
        assert corner.nearest == pytest.approx(true, abs=0.25)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("corners", [0, 2])
def test_an_interruption_lands_it_from_wherever_it_is(autopilot: str, corners: int) -> None:
    bench, flight = ready(autopilot), SquareFlight(10.0)
    fly_to(bench, flight, corners)
    bench.until(lambda: bench.report.armed, 10.0)
    flight.stop(bench.now, "interrupted")
    fly(bench, flight)
    assert (flight.good, flight.trouble) == (False, "interrupted")
    assert not bench.autopilot.armed
    assert not bench.report.in_air


@pytest.mark.parametrize(
    ("fault", "value", "words"),
    [
        ("nan_telemetry", 1.0, ""),
        ("battery", 10.0, ""),
        ("operator_mode", "LOITER", "somebody took it over"),
        ("disarm", 1.0, ""),
    ],
)
def test_what_goes_wrong_on_the_way_ends_it(fault: str, value: float | str, words: str) -> None:
    bench, flight = ready(), SquareFlight(10.0)
    fly_to(bench, flight, 1)
    bench.fault(fault, value, 400.0)
    fly(bench, flight)
    assert not flight.good
    assert flight.trouble
    assert words in flight.trouble
    taken = fault == "operator_mode"
    assert bench.autopilot.armed == taken  # what somebody else flies stays theirs
    since = bench.now
    bench.want(flight.task(bench.now, bench.report))
    bench.fly(5.0)
    assert bench.count("SET_POSITION_TARGET_LOCAL_NED", since) == 0


def test_a_heartbeat_that_stops_in_the_air_is_waited_for_and_the_vehicle_then_landed() -> None:
    bench, flight = ready(), SquareFlight(10.0)
    fly_to(bench, flight, 1)
    bench.fault("mute", lasts=12.0)
    fly(bench, flight)
    assert "no position from it" in flight.trouble
    assert not bench.autopilot.armed


def test_a_heartbeat_that_never_comes_back_is_given_up_with_nothing_armed_on_the_ground() -> None:
    bench, flight = ready(), SquareFlight(10.0)
    bench.want(flight.task(bench.now, bench.report))
    assert bench.until(lambda: bool(bench.commands(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)), 10.0)
    bench.fault("mute")
    begin = bench.now
    fly(bench, flight)
    assert "no heartbeat from system 1" in flight.trouble
    assert bench.now - begin < 30.0
    assert not bench.autopilot.armed


def test_a_vehicle_that_refuses_to_arm_is_given_up_with_its_own_words() -> None:
    bench, flight = ready(), SquareFlight(10.0)
    bench.fault("refuse_arming", "Arm: Gyros inconsistent")
    fly(bench, flight)
    assert "not started" in flight.trouble
    assert "Gyros inconsistent" in flight.trouble
    assert not bench.autopilot.armed
    assert flight.corners == []


def test_a_corner_that_cannot_be_reached_is_told_with_the_distance_and_it_lands() -> None:
    bench, flight = ready(), SquareFlight(10.0)
    fly_to(bench, flight, 1)
    bench.autopilot.guidance.goto = lambda *_: None  # it hears no place any more
    fly(bench, flight)
    assert "corner north-east was not reached" in flight.trouble
    assert [corner.reached for corner in flight.corners] == [True, False]
    assert not bench.autopilot.armed
