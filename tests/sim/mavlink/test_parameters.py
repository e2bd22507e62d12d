"""Parameters over the wire, each autopilot its own way."""

import struct
from typing import Any

import pytest

from bridges.mavlink.dialect import mavlink
from sim.mavlink.settings import Settings
from tests.sim.mavlink.bench import Bench


def read(bench: Bench, name: str) -> Any:
    bench.say(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    return next((m for m in bench.run(0.1) if m.get_type() == "PARAM_VALUE"), None)


def test_an_ardupilot_sends_integers_as_numbers_and_a_px4_as_their_bytes() -> None:
    cast = read(Bench(Settings()), "FS_OPTIONS")
    assert (cast.param_value, cast.param_type) == (16.0, 6)
    bytewise = read(Bench(Settings(autopilot="px4")), "COM_DL_LOSS_T")
    assert bytewise.param_type == 6
    assert struct.unpack("<i", struct.pack("<f", bytewise.param_value))[0] == 10


def test_a_negative_integer_survives_its_bytes() -> None:
    value = read(Bench(Settings(autopilot="px4")), "COM_FLTMODE1").param_value
    assert struct.unpack("<i", struct.pack("<f", value))[0] == -1


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_the_whole_list_comes_once_each(autopilot: str) -> None:
    bench = Bench(Settings(autopilot=autopilot))  # type: ignore[arg-type]
    bench.say(mavlink.MAVLink_param_request_list_message(1, 1))
    values = [m for m in bench.run(2.0) if m.get_type() == "PARAM_VALUE"]
    assert sorted(m.param_index for m in values) == list(range(values[0].param_count))
    assert len({m.param_id for m in values}) == len(values) > 30


def test_a_set_value_is_told_and_kept_and_changes_what_it_does() -> None:
    bench = Bench(Settings())
    bench.run(2.0)
    bench.say(mavlink.MAVLink_param_set_message(1, 1, b"WPNAV_SPEED", 200.0, 9))
    assert [m.param_value for m in bench.run(0.1) if m.get_type() == "PARAM_VALUE"] == [200.0]
    bench.fly()
    bench.say(bench.position_setpoint(50.0, 0.0, -10.0))
    bench.run(5.0)
    assert bench.pilot.body.velocity[0] == pytest.approx(2.0, abs=0.05)


def test_what_is_no_number_or_no_parameter_changes_nothing() -> None:
    bench = Bench(Settings())
    bench.say(mavlink.MAVLink_param_set_message(1, 1, b"WPNAV_SPEED", float("nan"), 9))
    assert [m.param_value for m in bench.run(0.1) if m.get_type() == "PARAM_VALUE"] == [1000.0]
    assert read(bench, "NO_SUCH_THING") is None
