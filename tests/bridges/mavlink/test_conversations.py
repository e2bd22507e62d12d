"""Commands, parameters and clocks, each against a few lines that answer."""

import struct

import numpy as np
import pytest

from bridges.mavlink.commands import WORDS, Command, Commands, Outcome
from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.parameters import TRIES, Parameters, decode
from bridges.mavlink.setpoints import position_setpoint, velocity_setpoint
from bridges.mavlink.timesync import TimeSync
from bridges.mavlink.vehicle_state import VehicleReport, body_of
from bridges.mavlink.wire import Wire
from estimator.arrays import FloatArray

US = (1, 191)
ARM = Command(400, "arm", (1.0,))


def ack(result: int, command: int = 400, extra: int = 0, target: tuple[int, int] = US) -> Message:
    return mavlink.MAVLink_command_ack_message(command, result, 0, extra, *target)


def run(
    commands: Commands, until: float, texts: list[tuple[float, str]] | None = None
) -> tuple[list[Message], list[Outcome]]:
    sent, ended = [], []
    for tick in range(int(until / 0.05)):
        out, over = commands.step(tick * 0.05, texts or [])
        sent += out
        ended += over
    return sent, ended


def test_an_unanswered_command_is_asked_again_with_a_growing_confirmation_and_then_given_up() -> None:
    commands = Commands(1)
    commands.ask(ARM)
    sent, ended = run(commands, 10.0)
    assert [message.confirmation for message in sent] == [0, 1, 2, 3, 4]
    assert ended == [Outcome(ARM, None, "arm: no answer after 5 tries")]
    assert not commands.busy


@pytest.mark.parametrize("result", [result for result in WORDS if result not in (0, 5)])
def test_every_refusal_becomes_words_with_the_text_that_explains_it(result: int) -> None:
    commands = Commands(1)
    commands.ask(ARM)
    commands.step(0.0, [])
    assert commands.hear(0.1, ack(result, extra=7), US) is None
    assert commands.step(0.2, [])[1] == []
    ((outcome),) = commands.step(0.5, [(-5.0, "old news"), (0.12, "PreArm: Hardware safety switch")])[1]
    assert outcome.words == f"arm: {WORDS[result]} (7): PreArm: Hardware safety switch"
    assert not outcome.ok


def test_in_progress_is_waited_for_without_asking_again() -> None:
    commands = Commands(1)
    commands.ask(ARM)
    commands.step(0.0, [])
    for time in (0.1, 3.0, 6.0):
        assert commands.hear(time, ack(5), US) is None
        assert commands.step(time + 2.9, []) == ([], [])
    outcome = commands.hear(9.0, ack(0), US)
    assert outcome is not None
    assert outcome.ok


def test_answers_to_others_and_to_nothing_change_nothing() -> None:
    commands = Commands(1)
    commands.ask(ARM)
    commands.step(0.0, [])
    assert commands.hear(0.1, ack(0, target=(255, 190)), US) is None
    assert commands.hear(0.1, ack(0, command=22), US) is None
    assert commands.stray == 1
    assert commands.busy


def test_commands_of_one_number_wait_for_each_other_and_urgent_ones_go_first() -> None:
    commands = Commands(1, width=2)
    for index in range(3):
        commands.ask(Command(511, f"stream {index}", (float(index),)))
    commands.ask(ARM, urgent=True)
    first = commands.step(0.0, [])[0]
    assert [message.command for message in first] == [400, 511]
    commands.hear(0.1, ack(0, command=511), US)
    assert [message.param1 for message in commands.step(0.1, [])[0]] == [1.0]


def test_a_place_goes_as_command_int() -> None:
    message = Command(192, "go", (1, 2, 3, 4), place=(473977420, 85455940, 12.5)).message(3, 1, 0)
    assert message.get_type() == "COMMAND_INT"
    assert (message.x, message.y, message.z, message.target_system) == (473977420, 85455940, 12.5, 3)


@pytest.mark.parametrize(("kind", "form"), [(1, "<B"), (2, "<b"), (4, "<h"), (5, "<I"), (6, "<i")])
@pytest.mark.parametrize("value", [0, 1, 5, 100])
def test_integers_are_read_as_each_autopilot_writes_them(kind: int, form: str, value: int) -> None:
    raw = struct.unpack("<f", struct.pack(form, value).ljust(4, b"\0"))[0]
    assert decode(raw, kind, bytewise=True) == value
    assert decode(float(value), kind, bytewise=False) == value


def test_parameters_are_asked_a_few_at_a_time_and_those_it_lacks_are_given_up() -> None:
    parameters = Parameters(1)
    parameters.read(tuple(f"P{index}" for index in range(8)))
    asked: list[str] = []
    for tick in range(200):
        for question in parameters.step(tick * 0.05):
            name = str(question.param_id)
            asked.append(name)
            if name != "P3":
                parameters.hear(mavlink.MAVLink_param_value_message(name.encode(), 2.5, 9, 8, 0), False)
    assert parameters.done
    assert parameters.missing == {"P3"}
    assert asked.count("P3") == TRIES
    assert set(parameters.values.values()) == {2.5}
    assert len(parameters.values) == 7


@pytest.mark.parametrize("offset", [-5000.0, 0.25, 1e5])
def test_the_offset_of_a_clock_is_found_though_some_answers_take_long(offset: float) -> None:
    random = np.random.default_rng(3)
    sync = TimeSync(1)
    for tick in range(600):
        now = 50.0 + 0.1 * tick
        for question in sync.step(now):
            trip = 0.004 if random.random() < 0.5 else random.uniform(0.02, 0.4)
            there = (now + (0.002 if trip == 0.004 else trip * 0.9) + offset + 1e4) * 1e9
            sync.hear(now + trip, mavlink.MAVLink_timesync_message(int(there), question.ts1))
    assert sync.offset == pytest.approx(offset + 1e4, abs=0.002)
    assert sync.captured(120.0 + offset + 1e4, 120.05) == pytest.approx(120.0, abs=0.002)
    assert sync.captured(120.0 + offset + 1e4, 119.9) == 119.9  # not from the future


def test_a_question_of_the_time_is_answered_and_an_answer_to_others_is_not_used() -> None:
    sync = TimeSync(1)
    (answer,) = sync.hear(12.5, mavlink.MAVLink_timesync_message(0, 777))
    assert (answer.tc1, answer.ts1) == (12_500_000_000, 777)
    sync.hear(12.5, mavlink.MAVLink_timesync_message(int(1e9), int(1.7e18)))
    assert sync.offset is None


@pytest.mark.parametrize(("yaw", "masks"), [(None, (3576, 3527)), (0.5, (2552, 2503))])
def test_type_masks_are_those_that_both_autopilots_document(
    yaw: float | None, masks: tuple[int, int]
) -> None:
    vector: FloatArray = np.array([1.0, 2.0, -3.0])
    place, speed = position_setpoint((1, 1), 0, vector, yaw), velocity_setpoint((1, 1), 0, vector, yaw)
    assert (place.type_mask, speed.type_mask) == masks
    assert (place.x, place.y, place.z) == (speed.vx, speed.vy, speed.vz) == (1.0, 2.0, -3.0)


def hear(report: VehicleReport, *messages: Message) -> None:
    wire = Wire((1, 1))
    for message in messages:
        (parsed,) = wire.parse(wire.pack(message))
        report.hear(1.0, parsed)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_telemetry_that_is_no_number_is_not_believed(bad: float) -> None:
    report = VehicleReport()
    hear(report, mavlink.MAVLink_local_position_ned_message(1, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0))
    hear(report, mavlink.MAVLink_local_position_ned_message(2, 1.0, bad, 3.0, 0.0, 0.0, 0.0))
    hear(report, mavlink.MAVLink_attitude_message(2, bad, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert report.position is not None
    assert report.position.tolist() == [1.0, 2.0, 3.0]
    assert report.attitude is None
    assert report.counters["not_a_number"] == 2


def test_a_long_status_text_is_put_together_again() -> None:
    report = VehicleReport()
    long = "PreArm: " + "x" * 60
    hear(
        report,
        mavlink.MAVLink_statustext_message(3, long[:50].encode(), 9, 0),
        mavlink.MAVLink_statustext_message(3, long[50:].encode(), 9, 1),
        mavlink.MAVLink_statustext_message(6, "caf\x07\xe9".encode("latin-1")),
    )
    assert [text.text for text in report.texts] == [long, "caf?\N{REPLACEMENT CHARACTER}"]


def test_a_text_that_fills_its_last_piece_is_told_when_the_next_begins_and_marks_are_left_out() -> None:
    full = "Preflight Fail: " + "x" * 34
    report = VehicleReport()
    hear(
        report,
        mavlink.MAVLink_statustext_message(2, full.encode(), 4, 0),
        mavlink.MAVLink_statustext_message(4, b"Failsafe activated\t", 5, 0),
    )
    assert [(text.severity, text.text) for text in report.texts] == [(2, full), (4, "Failsafe activated")]


def test_bodies_have_names() -> None:
    assert [body_of(kind) for kind in (2, 13, 10, 1, 250)] == [
        "copter",
        "copter",
        "rover",
        "fixed wing",
        "type 250",
    ]
