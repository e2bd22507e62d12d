"""Flying the simulated vehicles in virtual time."""

import numpy as np
import pytest

from bridges.mavlink.dialect import mavlink
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.wanted import Drive, GoTo, Hold, Land, Rest, Return, TakeOff
from bridges.mavlink.words import summary
from sim.mavlink.settings import Settings
from tests.bridges.mavlink.air import ARM, Air

ARDUCOPTER, PX4 = Settings(autopilot="ardupilot"), Settings(autopilot="px4")
ROVER = Settings(autopilot="ardupilot", type="rover")
COPTERS = pytest.mark.parametrize("settings", [ARDUCOPTER, PX4], ids=["ardupilot", "px4"])
ALL = pytest.mark.parametrize("settings", [ARDUCOPTER, PX4, ROVER], ids=["copter", "px4", "rover"])
SETPOINT = "SET_POSITION_TARGET_LOCAL_NED"


@ALL
def test_a_place_that_is_wanted_is_reached_from_the_ground_within_a_metre(settings: Settings) -> None:
    air = Air(settings)
    there = np.array([10.0, -6.0, 0.0 if settings.type == "rover" else -7.0])
    air.want(GoTo(there))
    assert air.until(lambda: air.at(there, within=0.3), 60.0), air.said()
    assert air.report.armed
    assert air.report.ours


@ALL
def test_a_vehicle_of_which_nothing_is_wanted_stays_disarmed_on_the_ground(settings: Settings) -> None:
    air = Air(settings)
    for task in (Rest(), Hold(), Land(), Return()):
        air.want(task)
        air.fly(8.0)
        assert air.pilot.phase == "ready"
    assert not air.commands(ARM)
    assert air.count(SETPOINT) == 0


@COPTERS
def test_landing_ends_disarmed_on_the_ground(settings: Settings) -> None:
    air = Air(settings)
    air.airborne(height=5.0)
    air.want(Land())
    assert air.until(lambda: air.pilot.phase == "ready" and not air.report.armed, 40.0), air.said()
    assert abs(air.report.position[2]) < 0.3  # type: ignore[index]


@COPTERS
def test_return_ends_at_home_and_disarmed(settings: Settings) -> None:
    air = Air(settings)
    air.airborne(north=15.0)
    air.want(Return())
    assert air.until(lambda: air.pilot.phase == "ready" and not air.report.armed, 120.0), air.said()
    assert np.linalg.norm(air.report.position) < 1.0  # type: ignore[arg-type]


@COPTERS
def test_take_off_climbs_to_the_height_and_hovers_there(settings: Settings) -> None:
    air = Air(settings, PilotConfig(take_off_height=8.0))
    air.want(TakeOff())
    assert air.until(lambda: air.pilot.phase == "flying", 40.0)
    air.fly(6.0)
    assert air.report.position is not None
    assert air.report.position[2] == pytest.approx(-8.0, abs=1.0)


@COPTERS
def test_a_velocity_is_flown_and_a_hold_stops_it(settings: Settings) -> None:
    air = Air(settings)
    air.airborne()
    air.want(Drive(np.array([2.0, 0.0, 0.0])))
    air.fly(6.0)
    assert air.report.velocity == pytest.approx([2.0, 0.0, 0.0], abs=0.3)
    air.want(Hold())
    air.fly(5.0)
    assert np.linalg.norm(air.report.velocity) < 0.2  # type: ignore[arg-type]
    assert air.pilot.phase == "flying"


@COPTERS
def test_a_yaw_that_is_wanted_is_taken(settings: Settings) -> None:
    air = Air(settings)
    air.airborne()
    air.want(GoTo(np.array([0.0, 0.0, -5.0]), yaw=1.2))
    air.fly(8.0)
    assert air.report.attitude is not None
    assert air.report.attitude[2] == pytest.approx(1.2, abs=0.1)


def test_px4_hears_setpoints_for_a_second_and_a_half_before_the_mode_and_then_without_a_gap() -> None:
    air = Air(PX4)
    air.airborne(north=10.0)
    air.want(Hold())
    air.fly(10.0)
    setpoints = [time for time, message in air.sent if message.get_type() == SETPOINT]
    asked = next(
        t for t, m in air.sent if m.get_type() == "COMMAND_LONG" and m.command == mavlink.MAV_CMD_DO_SET_MODE
    )
    assert asked - setpoints[0] >= 1.5
    assert np.diff(setpoints).max() <= 0.125
    assert air.pilot.phase == "flying"


def test_an_ardupilot_that_streams_nothing_is_asked_for_everything_and_again_after_a_reboot() -> None:
    air = Air(ARDUCOPTER)
    air.fly(5.0)
    assert air.report.position is not None
    first = len(air.commands(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL))
    assert first >= 10
    air.fault("reboot")
    air.fly(20.0)
    assert "started anew" in air.said()
    assert len(air.commands(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)) >= 2 * first - 2
    assert air.pilot.vehicle.age("LOCAL_POSITION_NED", air.now) < 0.5
    air.airborne()


def test_a_px4_that_streams_faster_than_needed_is_slowed_down() -> None:
    air = Air(PX4.but(default_streams=True))
    air.fly(5.0)
    asked = {int(m.param1): m.param2 for m in air.commands(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)}
    assert asked[mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED] == pytest.approx(1e5)
    assert asked[mavlink.MAVLINK_MSG_ID_ATTITUDE] == pytest.approx(1e5)
    heard = air.wire.arrived[1]
    air.fly(5.0)
    assert (air.wire.arrived[1] - heard) / 5.0 < 135  # 195 a second unasked


@COPTERS
def test_nothing_is_armed_before_the_estimator_has_a_position(settings: Settings) -> None:
    air = Air(settings.but(ready_after=12.0))
    air.want(TakeOff())
    air.fly(11.0)
    assert not air.commands(ARM)
    assert air.pilot.phase == "ready"
    assert air.report.reasons
    assert air.until(lambda: air.pilot.phase == "flying", 40.0), air.said()


def test_a_px4_that_stands_still_is_armed_though_its_estimator_calls_that_a_constant_position() -> None:
    air = Air(PX4)
    air.fly(8.0)
    assert air.report.estimator_flags is not None
    assert air.report.estimator_flags & (16 | 128) == 16 | 128
    assert air.report.reasons == ()
    assert "EKF good" in summary(air.report)


def test_a_copter_that_would_arm_without_a_position_is_not_armed() -> None:
    air = Air(ARDUCOPTER)
    air.fault("no_position")
    air.fault("arms_without_position")
    air.want(TakeOff())
    air.fly(20.0)
    assert not air.commands(ARM)
    assert "position" in air.report.trouble


@COPTERS
def test_every_command_is_answered_in_the_end_though_half_of_the_answers_are_lost(settings: Settings) -> None:
    air = Air(settings)
    air.fault("lost_acks", 0.5)
    air.want(GoTo(np.array([5.0, 0.0, -5.0])))
    assert air.until(lambda: air.at([5.0, 0.0, -5.0]), 90.0), air.said()
    assert air.pilot.commands.resent > 0


@COPTERS
def test_a_vehicle_that_takes_its_time_is_waited_for(settings: Settings) -> None:
    air = Air(settings)
    air.fault("in_progress", 2.0)
    air.want(GoTo(np.array([5.0, 0.0, -5.0])))
    assert air.until(lambda: air.at([5.0, 0.0, -5.0]), 90.0), air.said()


@COPTERS
def test_refused_arming_is_shown_with_the_reason_and_tried_only_a_few_times(settings: Settings) -> None:
    air = Air(settings)
    air.fly(6.0)
    air.fault("refuse_arming", "Compass not calibrated")
    air.want(TakeOff())
    air.fly(50.0)
    assert not air.report.armed
    assert "Compass not calibrated" in air.said() + air.report.trouble
    assert len(air.commands(ARM)) <= 4
    assert air.pilot.phase == "ready"


def test_a_mode_that_was_acknowledged_but_does_not_show_is_not_believed() -> None:
    air = Air(ARDUCOPTER)
    air.fault("stuck_mode")
    air.want(TakeOff())
    air.fly(20.0)
    assert not air.commands(ARM)
    assert "does not show" in air.said()


@COPTERS
def test_the_vehicle_s_clock_is_known_to_a_millisecond(settings: Settings) -> None:
    air = Air(settings.but(clock_offset=37.25))
    air.fly(15.0)
    boot = air.pilot.vehicle.boot_times["LOCAL_POSITION_NED"] / 1e3
    assert air.report.captured is not None
    assert air.report.clock_offset == pytest.approx(boot - air.report.captured, abs=0.002)
    assert 0.0 <= air.now - air.report.captured < 0.15


@COPTERS
def test_other_traffic_lost_frames_and_garbage_do_not_keep_it_from_flying(settings: Settings) -> None:
    air = Air(settings)
    air.fault("garbage", 2000.0)
    air.fault("truncated", 0.05)
    air.fault("repeated", 0.1)
    air.want(GoTo(np.array([5.0, 0.0, -5.0])))
    assert air.until(lambda: air.at([5.0, 0.0, -5.0]), 90.0), air.said()
    assert air.wire.counters["garbage_bytes"] > 1000
    assert air.report.link_quality < 1.0


def test_a_take_off_whose_answer_is_lost_goes_on_when_it_is_refused_the_second_time() -> None:
    air = Air(ARDUCOPTER)
    air.want(TakeOff())
    assert air.until(lambda: bool(air.commands(mavlink.MAV_CMD_NAV_TAKEOFF)), 40.0)
    air.fault("lost_acks", 1.0, lasts=2.0)
    assert air.until(lambda: air.pilot.phase == "flying", 30.0), air.said()
    assert len(air.commands(mavlink.MAV_CMD_NAV_TAKEOFF)) > 1
    assert len(air.commands(ARM)) == 1


def test_a_rover_is_driven_where_the_velocity_points_not_where_it_should_look() -> None:
    air = Air(ROVER)
    air.want(Drive(np.array([1.0, 0.0, 0.0]), yaw=1.5))
    assert air.until(lambda: air.count(SETPOINT) > 3, 40.0), air.said()
    masks = {message.type_mask for _, message in air.sent if message.get_type() == SETPOINT}
    assert all(mask & 0x400 and mask & 0x800 for mask in masks)


def test_a_rover_s_home_is_as_high_as_its_origin_whatever_it_says() -> None:
    air = Air(ROVER)
    air.fly(8.0)
    assert air.pilot.vehicle.home is not None
    assert air.pilot.vehicle.home[2] == pytest.approx(0.14)
    assert air.report.origin is not None
    assert air.report.home == (*air.pilot.vehicle.home[:2], air.report.origin[2])
    assert air.report.home[2] == pytest.approx(488.0)


def test_a_rover_returns_stops_and_is_disarmed() -> None:
    air = Air(ROVER)
    air.want(GoTo(np.array([10.0, 0.0, 0.0])))
    assert air.until(lambda: air.at([10.0, 0.0, 0.0]), 40.0), air.said()
    air.want(Return())
    assert air.until(lambda: air.pilot.phase == "ready" and not air.report.armed, 60.0), air.said()
    assert np.linalg.norm(air.report.position) < 2.0  # type: ignore[arg-type]


def test_a_landing_that_is_called_off_flies_on() -> None:
    air = Air(ARDUCOPTER)
    air.airborne(height=8.0)
    air.want(Land())
    air.fly(2.5)
    assert air.pilot.phase == "landing"
    air.want(GoTo(np.array([3.0, 0.0, -8.0])))
    assert air.until(lambda: air.at([3.0, 0.0, -8.0]), 20.0), air.said()
