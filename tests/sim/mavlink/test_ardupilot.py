"""What was measured on ArduPilot 4.6 (../shared/design/MIDDLEWARE.md) holds for the simulated one."""

import math

import pytest

from sim.mavlink.settings import Settings
from tests.sim.mavlink.bench import AUTO, GUIDED, LAND_MODE, RTL, Bench

COPTER = Settings(autopilot="ardupilot")
ROVER = Settings(autopilot="ardupilot", type="rover")


def test_only_heartbeats_are_streamed_until_something_is_asked_for() -> None:
    bench = Bench(COPTER.but(ready_after=0.0))
    bench.run(1.0)  # home and origin are told once
    quiet = {m.get_type() for m in bench.run(5.0)}
    assert quiet == {"HEARTBEAT"}
    assert bench.ask(32, 4.0) == 0
    heard = bench.run(5.0)
    assert 19 <= sum(m.get_type() == "LOCAL_POSITION_NED" for m in heard) <= 21


def test_a_reboot_forgets_what_was_asked_for_and_starts_the_clock_anew() -> None:
    bench = Bench(COPTER)
    bench.run(5.0)
    bench.ask(2, 2.0)
    before = [m for m in bench.run(2.0) if m.get_type() == "SYSTEM_TIME"][-1].time_boot_ms
    assert bench.command(246, 1) == 0
    assert all(m.get_type() != "SYSTEM_TIME" for m in bench.run(3.0))
    bench.ask(2, 2.0)
    assert next(m for m in bench.run(2.0) if m.get_type() == "SYSTEM_TIME").time_boot_ms < before


def test_guided_and_arming_in_it_want_a_position() -> None:
    bench = Bench(COPTER.but(ready_after=5.0))
    assert bench.mode(GUIDED) == 4
    assert "requires position" in bench.texts()
    bench.run(6.0)
    assert bench.mode(GUIDED) == 0
    assert bench.command(400, 1) == 0


def test_an_armed_one_without_a_position_refuses_take_off() -> None:
    bench = Bench(COPTER)
    bench.run(2.0)
    bench.mode(GUIDED)
    bench.fault("no_position")
    bench.fault("arms_without_position")
    assert bench.command(400, 1) == 0
    assert bench.command(22, 0, 0, 0, 0, 0, 0, 10) == 4


def test_take_off_outside_guided_or_in_the_air_fails() -> None:
    bench = Bench(COPTER)
    bench.run(2.0)
    assert bench.command(400, 1) == 0
    assert bench.command(22, 0, 0, 0, 0, 0, 0, 10) == 4
    bench.fly(10.0)
    assert bench.command(22, 0, 0, 0, 0, 0, 0, 10) == 4


def test_unknown_commands_are_unsupported_and_arming_twice_is_accepted() -> None:
    bench = Bench(COPTER)
    bench.run(2.0)
    assert bench.command(31000) == 3
    assert bench.command(400, 1) == 0
    assert bench.command(400, 1) == 0


def test_who_arms_and_does_not_take_off_is_disarmed_after_the_delay() -> None:
    bench = Bench(COPTER)
    bench.run(2.0)
    bench.command(400, 1)
    bench.run(9.0)
    assert bench.pilot.armed
    bench.run(2.0)
    assert not bench.pilot.armed


def test_a_position_is_flown_and_held_without_being_repeated() -> None:
    bench = Bench(COPTER)
    bench.fly()
    bench.say(bench.position_setpoint(20.0, -10.0, -12.0))
    bench.run(20.0)
    assert math.dist(bench.pilot.body.position, (20.0, -10.0, -12.0)) < 0.3


def test_one_ignored_axis_discards_its_whole_group() -> None:
    bench = Bench(COPTER)
    bench.fly()
    bench.say(bench.position_setpoint(20.0, 0.0, -10.0, mask=0b110111111100))
    bench.run(5.0)
    assert math.dist(bench.pilot.body.position, (0.0, 0.0, -10.0)) < 0.5


def test_a_velocity_ends_after_guid_timeout() -> None:
    bench = Bench(COPTER)
    bench.fly()
    bench.say(bench.velocity_setpoint(2.0, 0.0, 0.0))
    bench.run(2.5)
    assert bench.pilot.body.velocity[0] == pytest.approx(2.0, abs=0.1)
    bench.run(4.0)
    assert abs(bench.pilot.body.velocity[0]) < 0.05
    assert 5.0 < bench.pilot.body.position[0] < 8.0


def test_setpoints_outside_guided_move_nothing() -> None:
    bench = Bench(COPTER)
    bench.fly()
    bench.fault("operator_mode", "LOITER")
    bench.run(0.5)
    bench.run(5.0, every=bench.position_setpoint(50.0, 0.0, -10.0))
    assert math.dist(bench.pilot.body.position, (0.0, 0.0, -10.0)) < 0.5
    assert bench.of("HEARTBEAT")[-1].custom_mode == 5


@pytest.mark.parametrize(("source", "lands"), [((255, 190), True), ((1, 191), False)])
def test_the_gcs_failsafe_counts_only_the_heartbeats_of_sysid_mygcs(
    source: tuple[int, int], lands: bool
) -> None:
    bench = Bench(COPTER.but(parameters={"FS_GCS_ENABLE": 5.0}), *source)
    bench.fly(every=bench.heartbeat())
    bench.run(6.0)
    assert bench.pilot.mode == ("LAND" if lands else "GUIDED")


def test_link_loss_lands_five_seconds_after_the_last_heartbeat_and_the_links_return_undoes_nothing() -> None:
    bench = Bench(COPTER.but(parameters={"FS_GCS_ENABLE": 5.0}))
    bench.run(2.0)
    bench.mode(GUIDED)
    bench.command(400, 1)
    bench.command(22, 0, 0, 0, 0, 0, 0, 10)
    bench.run(12.0, every=bench.heartbeat())
    bench.run(4.8)
    assert bench.pilot.mode == "GUIDED"
    bench.run(0.5)
    assert bench.pilot.mode == "LAND"
    bench.run(2.0, every=bench.heartbeat())
    assert bench.pilot.mode == "LAND"
    assert "GCS Failsafe" in bench.texts()


def test_land_comes_down_and_disarms() -> None:
    bench = Bench(COPTER)
    bench.fly()
    assert bench.mode(LAND_MODE) == 0
    bench.run(40.0)
    assert bench.pilot.body.on_ground
    assert not bench.pilot.armed


def test_return_rises_goes_home_and_lands_there() -> None:
    bench = Bench(COPTER)
    bench.fly()
    bench.say(bench.position_setpoint(30.0, 0.0, -10.0))
    bench.run(10.0)
    assert bench.mode(RTL) == 0
    bench.run(6.0)
    assert -bench.pilot.body.position[2] > 13.0
    bench.run(60.0)
    assert math.dist(bench.pilot.body.position, (0.0, 0.0, 0.0)) < 0.6
    assert not bench.pilot.armed


def test_disarming_in_the_air_is_refused_unless_forced() -> None:
    bench = Bench(COPTER)
    bench.fly()
    assert bench.command(400, 0) == 4
    assert bench.command(400, 0, 21196) == 0
    bench.run(3.0)
    assert bench.pilot.body.on_ground


def test_a_low_battery_returns_if_it_is_told_to() -> None:
    bench = Bench(COPTER.but(parameters={"BATT_LOW_VOLT": 10.8, "BATT_FS_LOW_ACT": 2.0}))
    bench.fly()
    bench.fault("battery", 20.0)
    bench.run(1.0)
    assert bench.pilot.mode == "RTL"
    assert "Battery 1 is low" in bench.texts()
    assert bench.of("HEARTBEAT")[-1].system_status == 5


def test_losing_the_position_in_the_air_lands() -> None:
    bench = Bench(COPTER)
    bench.fly()
    bench.fault("no_position")
    bench.run(1.0)
    assert bench.pilot.mode == "LAND"


def test_a_destination_beyond_an_enabled_fence_is_silently_not_flown_to() -> None:
    bench = Bench(COPTER.but(parameters={"FENCE_ENABLE": 1.0, "FENCE_RADIUS": 50.0}))
    bench.fly()
    bench.say(bench.position_setpoint(60.0, 0.0, -10.0))
    bench.run(5.0)
    assert math.dist(bench.pilot.body.position, (0.0, 0.0, -10.0)) < 0.5
    assert bench.pilot.mode == "GUIDED"


def test_auto_without_a_mission_is_refused() -> None:
    bench = Bench(COPTER)
    bench.run(2.0)
    assert bench.mode(AUTO) == 4


def test_a_rover_drives_to_a_position_and_knows_no_take_off() -> None:
    bench = Bench(ROVER)
    bench.run(2.0)
    assert bench.mode(15) == 0
    assert bench.command(400, 1) == 0
    assert bench.command(22, 0, 0, 0, 0, 0, 0, 10) == 3
    bench.say(bench.position_setpoint(10.0, 5.0, 0.0))
    bench.run(20.0)
    assert math.dist(bench.pilot.body.position, (10.0, 5.0, 0.0)) < 0.5
    assert bench.of("HEARTBEAT")[-1].type == 10


def test_an_unfinished_estimator_says_so_in_its_flags() -> None:
    bench = Bench(COPTER.but(ready_after=3.0))
    bench.ask(193, 5.0)
    flags = [m.flags for m in bench.run(5.0) if m.get_type() == "EKF_STATUS_REPORT"]
    assert not flags[0] & 16
    assert flags[0] & 128
    assert flags[-1] & 16
    assert not flags[-1] & 128
