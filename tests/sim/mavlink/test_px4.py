"""What was measured on PX4 1.16 (../shared/design/MIDDLEWARE.md) holds for the simulated one."""

import math

import pytest

from bridges.mavlink.dialect import mavlink
from sim.mavlink.settings import Settings
from tests.sim.mavlink.bench import Bench

PX4 = Settings(autopilot="px4")
OFFBOARD, HOLD, RTL, LAND = (6.0,), (4.0, 3.0), (4.0, 5.0), (4.0, 6.0)


def offboard(bench: Bench, setpoint: object) -> None:
    bench.run(2.0, every=setpoint)
    assert bench.mode(*OFFBOARD) == 0
    bench.run(0.5, every=setpoint)
    assert bench.pilot.mode == "OFFBOARD"


@pytest.mark.parametrize("streamed", [0.0, 1.0])
def test_offboard_without_enough_setpoints_before_is_acknowledged_and_left(streamed: float) -> None:
    bench = Bench(PX4)
    bench.fly()
    setpoint = bench.position_setpoint(5.0, 0.0, -10.0)
    bench.run(streamed, every=setpoint)
    assert bench.mode(*OFFBOARD) == 0
    bench.run(0.5, every=setpoint)
    assert bench.pilot.mode == "HOLD"
    assert "No offboard control signal" in bench.texts()


def test_offboard_is_left_a_second_after_the_last_setpoint() -> None:
    bench = Bench(PX4)
    bench.fly()
    offboard(bench, bench.position_setpoint(5.0, 0.0, -10.0))
    bench.run(0.8)
    assert bench.pilot.mode == "OFFBOARD"
    bench.run(0.4)
    assert bench.pilot.mode == "POSCTL"
    assert bench.of("HEARTBEAT")[-1].custom_mode == 3 << 16
    bench.run(20.0)
    assert bench.pilot.body.on_ground  # nobody holds its sticks


@pytest.mark.parametrize(("action", "mode"), [(3.0, "RTL"), (4.0, "LAND"), (5.0, "HOLD")])
def test_what_offboard_loss_does_is_a_parameter(action: float, mode: str) -> None:
    bench = Bench(PX4.but(parameters={"COM_OBL_RC_ACT": action}))
    bench.fly()
    offboard(bench, bench.position_setpoint(0.0, 0.0, -10.0))
    bench.run(1.5)
    assert bench.pilot.mode == mode


def test_offboard_positions_are_flown_axis_by_axis() -> None:
    bench = Bench(PX4)
    bench.fly()
    offboard(bench, bench.position_setpoint(0.0, 0.0, -10.0))
    bench.run(15.0, every=bench.position_setpoint(20.0, 99.0, -12.0, mask=0b110111111010))
    assert math.dist(bench.pilot.body.position, (20.0, 0.0, -12.0)) < 0.3


def test_offboard_velocities_are_flown_while_they_come() -> None:
    bench = Bench(PX4)
    bench.fly()
    setpoint = bench.velocity_setpoint(0.0, 3.0, 0.0)
    offboard(bench, setpoint)
    bench.run(5.0, every=setpoint)
    assert bench.pilot.body.velocity[1] == pytest.approx(3.0, abs=0.1)


def test_velocities_in_the_body_frame_turn_with_it() -> None:
    bench = Bench(PX4.but(heading_deg=90.0))
    bench.fly()
    forward = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 8, 0b110111000111, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    )
    offboard(bench, forward)
    bench.run(4.0, every=forward)
    north, east, _ = bench.pilot.body.velocity
    assert (north, east) == pytest.approx((0.0, 2.0), abs=0.1)


def test_take_off_altitude_is_amsl_and_its_default_a_parameter() -> None:
    bench = Bench(PX4)
    bench.fly(7.0)
    other = Bench(PX4)
    other.run(2.0)
    other.command(400, 1)
    nan = math.nan
    assert other.command(22, nan, nan, nan, nan, nan, nan, nan) == 0
    other.run(10.0)
    assert -other.pilot.body.position[2] == pytest.approx(2.5, abs=0.1)


def test_texts_go_to_a_ground_station_only_not_to_a_companion_alone() -> None:
    bench = Bench(PX4.but(ready_after=60.0), station=False)
    assert bench.command(400, 1) == 1
    assert bench.texts() == ""
    bench.say(bench.heartbeat())
    assert bench.command(400, 1) == 1
    assert "Arming denied" in bench.texts()


def test_arming_without_a_position_is_refused_with_the_reason() -> None:
    bench = Bench(PX4.but(ready_after=60.0))
    assert bench.command(400, 1) == 1
    assert "No valid position estimate" in bench.texts()
    assert "Arming denied" in bench.texts()


def test_reposition_goes_to_degrees_and_metres_amsl() -> None:
    bench = Bench(PX4)
    bench.fly()
    latitude, longitude, _ = bench.pilot.geodetic((20.0, 15.0, 0.0))
    place = (round(latitude * 1e7), round(longitude * 1e7), 503.0)
    bench.say(mavlink.MAVLink_command_int_message(1, 1, 0, 192, 0, 0, -1.0, 1.0, 0.0, math.nan, *place))
    bench.run(15.0)
    assert math.dist(bench.pilot.body.position, (20.0, 15.0, -15.0)) < 0.3


def test_the_data_link_failsafe_counts_any_ground_station() -> None:
    bench = Bench(PX4.but(parameters={"NAV_DLL_ACT": 2.0}), system=42, station=False)
    bench.fly(every=bench.heartbeat())
    bench.run(9.5)
    assert bench.pilot.mode == "HOLD"
    bench.run(1.0)
    assert bench.pilot.mode == "RTL"


@pytest.mark.parametrize(
    ("left", "action", "mode"), [(6.0, 3.0, "RTL"), (4.0, 3.0, "LAND"), (6.0, 0.0, "HOLD")]
)
def test_a_critical_battery_does_what_com_low_bat_act_says(left: float, action: float, mode: str) -> None:
    bench = Bench(PX4.but(parameters={"COM_LOW_BAT_ACT": action}))
    bench.fly()
    bench.fault("battery", left)
    bench.run(1.0)
    assert bench.pilot.mode == mode
    assert "battery level" in bench.texts()


def test_landing_disarms_two_seconds_after_touching_down() -> None:
    bench = Bench(PX4)
    bench.fly(3.0)
    assert bench.mode(*LAND) == 0
    bench.run(20.0)
    assert bench.pilot.body.on_ground
    assert not bench.pilot.armed
    assert "Disarmed by landing" in bench.texts()


def test_a_mode_that_does_not_exist_is_denied() -> None:
    bench = Bench(PX4)
    assert bench.mode(9.0) == 2


def test_its_onboard_link_streams_unasked_only_where_that_is_wanted() -> None:
    bench = Bench(PX4.but(default_streams=True))
    kinds = {m.get_type() for m in bench.run(3.0)}
    assert {"ATTITUDE", "LOCAL_POSITION_NED", "SYS_STATUS", "EXTENDED_SYS_STATE"} <= kinds
