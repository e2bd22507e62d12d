"""Who gives way to whom: operators, failsafes, fences, lost links."""

import numpy as np
import pytest

from bridges.mavlink.dialect import mavlink
from bridges.mavlink.pilot_config import Fallbacks, PilotConfig
from bridges.mavlink.wanted import GoTo, Hold, TakeOff, Wanted
from bridges.mavlink.wire import Wire
from estimator.arrays import FloatArray
from sim.mavlink.settings import Settings
from tests.bridges.mavlink.air import ARM, STEP, Air

ARDUCOPTER, PX4 = Settings(autopilot="ardupilot"), Settings(autopilot="px4")
COPTERS = pytest.mark.parametrize("settings", [ARDUCOPTER, PX4], ids=["ardupilot", "px4"])
SETPOINT = "SET_POSITION_TARGET_LOCAL_NED"
PLACE = GoTo(np.array([0.0, 0.0, -5.0]))


def operator_mode(settings: Settings) -> str:
    return "LOITER" if settings.autopilot == "ardupilot" else "POSCTL"


@COPTERS
def test_an_operator_who_changes_the_mode_has_it_at_once_and_for_good(settings: Settings) -> None:
    air = Air(settings)
    air.airborne()
    air.fault("operator_mode", operator_mode(settings))
    assert air.until(lambda: air.pilot.phase == "taken over", 2.0)
    since = air.now
    air.fly(20.0)
    assert air.count(SETPOINT, since) == 0
    assert not air.commands(mavlink.MAV_CMD_DO_SET_MODE, since)
    assert "somebody took it over" in air.said()
    assert not air.report.ours


@COPTERS
def test_only_an_explicit_resume_takes_it_back(settings: Settings) -> None:
    air = Air(settings)
    air.airborne()
    air.fault("operator_mode", "HOLD" if settings.autopilot == "px4" else "BRAKE")
    air.fly(5.0)
    assert air.pilot.phase == "taken over"
    air.pilot.resume(air.now)
    air.want(GoTo(np.array([5.0, 0.0, -5.0])))
    assert air.until(lambda: air.at([5.0, 0.0, -5.0]), 30.0), air.said()


@COPTERS
def test_a_vehicle_found_flying_is_left_alone_until_resumed(settings: Settings) -> None:
    before = Air(settings)
    before.airborne()
    air = Air(settings)
    air.vehicle, air.now = before.vehicle, before.now
    air.want(PLACE)
    air.fly(10.0)
    assert air.pilot.phase == "taken over"
    assert "already armed" in air.report.trouble
    assert air.count(SETPOINT) == 0


@COPTERS
def test_a_disarmed_vehicle_is_not_armed_again(settings: Settings) -> None:
    air = Air(settings)
    air.airborne()
    since = air.now
    air.fault("disarm")
    air.fly(20.0)
    assert air.pilot.phase == "taken over"
    assert "disarmed" in air.said()
    assert not air.commands(ARM, since)


@COPTERS
def test_a_low_battery_brings_it_home_and_it_stays_there(settings: Settings) -> None:
    air = Air(settings)
    air.airborne(north=10.0)
    since = air.now
    air.fault("battery", 15.0)
    assert air.until(lambda: air.pilot.phase == "ready" and not air.report.armed, 90.0), air.said()
    air.fly(15.0)
    assert not air.report.armed
    assert np.linalg.norm(air.report.position) < 1.0  # type: ignore[arg-type]
    assert "battery" in air.said()
    assert all(message.param1 == 0 for message in air.commands(ARM, since))


@COPTERS
def test_a_silent_robot_s_vehicle_returns(settings: Settings) -> None:
    air = Air(settings)
    air.airborne(north=10.0)
    air.robot_age = 5.0
    assert air.until(lambda: air.report.mode == "RTL", 5.0), air.said()
    assert "silent" in air.said()


@COPTERS
def test_a_lost_team_is_answered_as_the_mission_says_and_undone_when_it_is_back(settings: Settings) -> None:
    config = PilotConfig(fallbacks=Fallbacks(team_lost_s=10.0, on_team_lost="hold"))
    air = Air(settings, config)
    air.airborne()
    far = np.array([60.0, 0.0, -5.0])
    air.wanted = Wanted(GoTo(far), team_age=11.0)
    air.fly(8.0)
    assert air.at([0.0, 0.0, -5.0])
    air.wanted = Wanted(GoTo(far))
    assert air.until(lambda: air.at(far), 60.0)


@COPTERS
def test_without_a_position_it_stands_still(settings: Settings) -> None:
    air = Air(settings)
    air.airborne()
    air.want(GoTo(np.array([80.0, 0.0, -5.0])))
    air.fly(2.0)
    air.fault("nan_telemetry")
    air.fly(4.0)
    assert air.pilot.vehicle.counters["not_a_number"] > 0
    assert np.isfinite(air.report.position).all()
    last = [message for _, message in air.sent if message.get_type() == SETPOINT][-1]
    assert last.type_mask & 0x007 == 0x007
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
    assert "no position" in air.said()


@COPTERS
def test_nothing_but_heartbeats_is_sent_over_a_link_that_hears_nothing(settings: Settings) -> None:
    air = Air(settings)
    air.airborne()
    air.fault("mute", lasts=12.0)
    air.fly(6.0)
    assert air.pilot.phase == "lost"
    since = air.now
    air.fly(5.0)
    kinds = {message.get_type() for time, message in air.sent if time > since}
    assert kinds == {"HEARTBEAT"}


def test_an_ardupilot_that_held_its_place_is_flown_on_when_the_link_is_back() -> None:
    air = Air(ARDUCOPTER)
    air.airborne()
    air.cut = True
    air.fly(8.0)
    assert air.pilot.phase == "lost"
    air.cut = False
    air.want(GoTo(np.array([6.0, 0.0, -5.0])))
    assert air.until(lambda: air.at([6.0, 0.0, -5.0]), 30.0), air.said()


def test_a_px4_that_left_offboard_while_the_link_was_away_is_not_taken_back() -> None:
    air = Air(PX4)
    air.airborne()
    air.cut = True
    air.fly(8.0)
    air.cut = False
    since = air.now
    air.fly(5.0)
    assert air.pilot.phase == "taken over"
    assert not air.commands(mavlink.MAV_CMD_DO_SET_MODE, since)


def inside(position: FloatArray) -> str | None:
    return "outside the fence" if position[0] > 20.0 else None


@COPTERS
def test_a_setpoint_outside_the_fence_is_never_sent(settings: Settings) -> None:
    air = Air(settings, PilotConfig(permit=inside))
    air.airborne()
    air.want(GoTo(np.array([30.0, 0.0, -5.0])))
    air.fly(10.0)
    sent = [message.x for _, message in air.sent if message.get_type() == SETPOINT]
    assert max(sent) <= 20.0
    assert air.at([0.0, 0.0, -5.0])
    assert "outside the fence" in air.report.trouble
    assert air.said().count("outside the fence") == 1


@COPTERS
def test_a_mission_outside_the_fence_arms_nothing(settings: Settings) -> None:
    air = Air(settings, PilotConfig(permit=inside))
    air.want(GoTo(np.array([30.0, 0.0, -5.0])))
    air.fly(15.0)
    assert not air.commands(ARM)
    assert "outside the fence" in air.report.trouble


@pytest.mark.parametrize("bad", [np.array([np.nan, 0, -5]), np.array([np.inf, 0, -5]), np.zeros(2)])
def test_a_place_that_is_none_is_not_flown_to(bad: FloatArray) -> None:
    air = Air(ARDUCOPTER)
    air.airborne()
    air.want(GoTo(bad))
    air.fly(3.0)
    assert air.at([0.0, 0.0, -5.0])
    assert "which is none" in air.said()


@COPTERS
def test_the_autopilot_s_failsafes_are_reported_and_never_written(settings: Settings) -> None:
    air = Air(settings)
    air.fly(8.0)
    causes = {one.cause for one in air.report.failsafes}
    assert {"ground link", "setpoints", "low battery", "fence"} <= causes
    assert air.count("PARAM_SET") == 0


def test_a_failsafe_that_the_mission_relies_on_and_that_is_off_keeps_it_on_the_ground() -> None:
    config = PilotConfig(failsafes={"ground link": "land"})
    air = Air(ARDUCOPTER, config)
    air.want(TakeOff())
    air.fly(15.0)
    assert not air.commands(ARM)
    assert '"land" for ground link' in air.report.trouble
    assert "FS_GCS_ENABLE = 0: none" in air.report.trouble
    right = Air(ARDUCOPTER.but(parameters={"FS_GCS_ENABLE": 5.0}), config)
    right.want(TakeOff())
    assert right.until(lambda: right.pilot.phase == "flying", 30.0), right.report.trouble


@pytest.mark.parametrize("action", ["hold", "land"])
def test_the_graver_fallback_wins(action: str) -> None:
    fallbacks = Fallbacks(team_lost_s=1.0, on_team_lost="hold", on_robot_silent=action)  # type: ignore[arg-type]
    air = Air(ARDUCOPTER, PilotConfig(fallbacks=fallbacks))
    air.airborne()
    air.wanted, air.robot_age = Wanted(Hold(), team_age=5.0), 5.0
    air.fly(4.0)
    assert air.pilot.phase == ("landing" if action == "land" else "flying")


def deaf(air: Air, seconds: float) -> None:
    """The robot's process has died: nobody sends any more."""
    for _ in range(round(seconds / STEP)):
        air.now += STEP
        air.vehicle.step(air.now, [])


def test_when_the_robot_dies_an_ardupilot_flies_to_its_last_setpoint_and_holds_there() -> None:
    air = Air(ARDUCOPTER)
    air.airborne()
    air.want(GoTo(np.array([12.0, 0.0, -5.0])))
    air.fly(1.0)
    deaf(air, 20.0)
    assert air.autopilot.mode == "GUIDED"
    air.fly(1.0)
    assert air.at([12.0, 0.0, -5.0])


def test_when_the_robot_dies_a_px4_leaves_offboard_after_a_second() -> None:
    air = Air(PX4)
    air.airborne()
    deaf(air, 0.7)
    assert air.autopilot.mode == "OFFBOARD"
    deaf(air, 0.8)
    assert air.autopilot.mode != "OFFBOARD"


@COPTERS
def test_a_heartbeat_that_stops_while_it_is_being_armed_arms_nothing_more(settings: Settings) -> None:
    air = Air(settings)
    air.want(TakeOff())
    assert air.until(lambda: bool(air.commands(ARM)), 20.0)
    air.fault("mute")
    air.fly(6.0)
    since = air.now
    air.fly(15.0)
    assert air.pilot.phase == "lost"
    assert not air.commands(ARM, since)
    assert not air.commands(mavlink.MAV_CMD_NAV_TAKEOFF)
    assert abs(air.autopilot.body.position[2]) < 0.5


@pytest.mark.parametrize("seed", range(4))
def test_no_message_whatever_its_numbers_raises_anything_or_puts_what_is_no_number_into_the_state(
    seed: int,
) -> None:
    random = np.random.default_rng(seed)
    air = Air(ARDUCOPTER if seed % 2 else PX4)
    air.fly(5.0)
    wire = Wire((1, 1))
    kinds = [kind for kind in mavlink.mavlink_map.values() if kind.msgname != "HEARTBEAT"]
    for kind in kinds:
        size = kind.unpacker.size
        values = kind.unpacker.unpack(random.integers(0, 256, size, dtype=np.uint8).tobytes())
        data = kind.unpacker.pack(*values)
        message = mavlink.MAVLink_message(kind.id, kind.msgname)
        frame = message._pack(wire._packer, kind.crc_extra, data)
        received = list(wire.parse(frame))
        assert len(received) == 1
        air.now += 0.01
        air.pilot.step(air.now, received, Wanted(Hold()))
    report = air.report
    for value in (report.position, report.velocity, report.attitude, report.captured, report.where):
        assert value is None or np.isfinite(value).all(), f"repeat with seed {seed}"
