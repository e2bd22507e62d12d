"""What goes wrong when a fault says so, and only then."""

import math

import pytest

from agents.errors import MissionError
from bridges.mavlink.dialect import mavlink
from sim.mavlink.settings import Fault, Settings
from tests.sim.mavlink.bench import GUIDED, Bench

KEY, OTHER = bytes(range(32)), bytes(32)


def test_a_lost_acknowledgement_leaves_the_command_done_and_a_second_one_may_be_refused() -> None:
    bench = Bench(Settings())
    bench.run(2.0)
    bench.mode(GUIDED)
    bench.command(400, 1)
    bench.fault("lost_acks", end=1.0)
    assert bench.command(22, 0, 0, 0, 0, 0, 0, 10) is None
    bench.run(3.0)
    assert not bench.pilot.body.on_ground
    assert bench.command(22, 0, 0, 0, 0, 0, 0, 10) == 4  # the repeated one, as with a real ArduPilot


def test_in_progress_is_told_until_it_is_done_and_a_repeated_command_is_the_same_one() -> None:
    bench = Bench(Settings())
    bench.run(2.0)
    bench.fault("in_progress", 2.0)
    assert bench.command(400, 1) == 5
    assert bench.command(400, 1) == 5
    bench.run(3.0)
    acks = [m for m in bench.of("COMMAND_ACK") if m.command == 400]
    assert [m.result for m in acks].count(0) == 1
    assert acks[-1].result == 0
    assert [m.progress for m in acks[:-1]] == sorted(m.progress for m in acks[:-1])
    assert bench.pilot.armed


@pytest.mark.parametrize(("autopilot", "result"), [("ardupilot", 4), ("px4", 1)])
def test_refused_arming_says_why(autopilot: str, result: int) -> None:
    bench = Bench(Settings(autopilot=autopilot))  # type: ignore[arg-type]
    bench.run(2.0)
    bench.fault("refuse_arming", "Compass not calibrated")
    assert bench.command(400, 1) == result
    assert "Compass not calibrated" in bench.texts()
    assert not bench.pilot.armed


def test_busy_is_temporarily_rejected_until_it_ends() -> None:
    bench = Bench(Settings())
    bench.run(2.0)
    bench.fault("busy", end=1.0)
    assert bench.command(400, 1) == 1
    bench.run(1.0)
    assert bench.command(400, 1) == 0


def test_a_stuck_mode_is_accepted_and_not_changed_to() -> None:
    bench = Bench(Settings())
    bench.run(2.0)
    bench.fault("stuck_mode")
    assert bench.mode(GUIDED) == 0
    bench.run(2.0)
    assert bench.of("HEARTBEAT")[-1].custom_mode == 0


def test_nan_telemetry_is_nan() -> None:
    bench = Bench(Settings())
    bench.run(2.0)
    bench.ask(32, 10)
    bench.fault("nan_telemetry")
    assert math.isnan([m for m in bench.run(1.0) if m.get_type() == "LOCAL_POSITION_NED"][-1].x)


@pytest.mark.parametrize("kind", ["mute", "no_heartbeat"])
def test_a_heartbeat_may_stop_and_come_back(kind: str) -> None:
    bench = Bench(Settings())
    bench.fault(kind, start=0.05, end=5.0)
    assert all(m.get_type() != "HEARTBEAT" for m in bench.run(4.5))
    assert any(m.get_type() == "HEARTBEAT" for m in bench.run(2.0))


def test_a_deaf_one_goes_on_talking() -> None:
    bench = Bench(Settings())
    bench.run(2.0)
    bench.fault("deaf")
    assert bench.command(400, 1, seconds=2.0) is None
    assert bench.of("HEARTBEAT")


def test_garbage_floods_and_truncation_leave_what_is_whole_readable() -> None:
    bench = Bench(Settings(seed=3))
    bench.fault("garbage", 2000.0)
    bench.fault("flood", 500.0)
    bench.fault("truncated", 0.05)
    bench.run(5.0)
    assert len(bench.of("NAMED_VALUE_FLOAT")) > 200
    assert bench.of("BAD_DATA")


def test_garbage_that_it_hears_is_counted_and_does_no_harm() -> None:
    bench = Bench(Settings())
    bench.run(2.0)
    bench.say_raw(b"\x00\x01garbage" * 20)
    bench.run(0.5)
    assert bench.vehicle.port.rejected > 0
    assert bench.command(400, 1) == 0


def test_version_1_hears_and_speaks_only_that() -> None:
    bench = Bench(Settings(version_1=True))
    bench.run(2.0)
    assert bench.command(400, 1) is None
    assert {m.get_msgbuf()[0] for m in bench.heard} == {0xFE}
    arm = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    bench.say(arm, force_mavlink1=True)
    assert any(m.get_type() == "COMMAND_ACK" for m in bench.run(0.1))


def test_only_frames_signed_with_its_key_are_heard() -> None:
    bench = Bench(Settings(signing_key=KEY))
    bench.run(2.0)
    assert bench.command(400, 1) == 0
    wrong = Bench.parser(255, 190, OTHER)
    silent = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 0, 21196, 0, 0, 0, 0, 0)
    bench.say_raw(silent.pack(wrong) + silent.pack(Bench.parser(255, 190, None)))
    bench.run(0.5)
    assert bench.pilot.armed
    assert bench.vehicle.port.rejected == 2


def test_what_is_for_another_system_is_not_heard() -> None:
    bench = Bench(Settings(system_id=7))
    bench.run(2.0)
    bench.say(mavlink.MAVLink_command_long_message(8, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert not [m for m in bench.run(0.5) if m.get_type() == "COMMAND_ACK"]
    assert {m.get_srcSystem() for m in bench.heard} == {7}


def test_faults_are_read_from_words() -> None:
    assert Fault.parse("lost_acks:0.5@10-20") == Fault("lost_acks", 10.0, 20.0, 0.5)
    assert Fault.parse("operator_mode:LOITER@5").value == "LOITER"
    with pytest.raises(MissionError, match="no fault 'nonsense'"):
        Fault.parse("nonsense")
    with pytest.raises(MissionError, match="times in s"):
        Fault.parse("busy@soon")


@pytest.mark.parametrize("seed", range(3))
def test_the_same_seed_gives_the_same_flight_byte_for_byte(seed: int) -> None:
    def flight() -> list[bytes]:
        bench = Bench(
            Settings(seed=seed, faults=(Fault("garbage", value=300.0), Fault("truncated", value=0.2)))
        )
        said: list[bytes] = []
        step = bench.vehicle.step

        def noted(*arguments: object) -> list[bytes]:
            frames = step(*arguments)  # type: ignore[arg-type]
            said.extend(frames)
            return frames

        bench.vehicle.step = noted  # type: ignore[method-assign]
        bench.ask(32, 10)
        bench.run(5.0)
        return said

    assert flight() == flight()


def test_a_long_status_text_comes_in_pieces_that_join() -> None:
    bench = Bench(Settings())
    bench.run(2.0)
    text = "a pre-arm failure that is longer than the fifty bytes that one message holds, by far"
    bench.fault("refuse_arming", text)
    bench.command(400, 1)
    pieces = bench.of("STATUSTEXT")
    assert len(pieces) == 2
    assert {m.id for m in pieces} == {1}
    assert "".join(m.text for m in pieces) == f"Arm: {text}"


def test_timesync_answers_with_its_own_clock() -> None:
    bench = Bench(Settings(clock_offset=1000.0))
    bench.run(2.0)
    bench.say(mavlink.MAVLink_timesync_message(0, 12345))
    answer = next(m for m in bench.run(0.1) if m.get_type() == "TIMESYNC")
    assert answer.ts1 == 12345
    assert answer.tc1 * 1e-9 == pytest.approx(1002.1, abs=0.15)
