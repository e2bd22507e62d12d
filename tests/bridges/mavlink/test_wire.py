"""Bytes, frames and signatures, checked against pymavlink's own parser and packer."""

import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.errors import DataError, MissionError
from bridges.mavlink.dialect import mavlink
from bridges.mavlink.framing import Framer
from bridges.mavlink.signing import Keys, read_keys
from bridges.mavlink.url import Endpoint, parse_url
from bridges.mavlink.wire import Wire

BEAT = mavlink.MAVLink_heartbeat_message(2, 3, 81, 4, 4, 3)


def position(index: int) -> object:
    return mavlink.MAVLink_local_position_ned_message(index, 1.0, 2.0, 3.0, 0.0, 0.0, -1.0)


def test_pymavlink_reads_what_we_write_and_we_what_it_writes() -> None:
    wire = Wire((7, 191))
    theirs = mavlink.MAVLink(None, 9, 1)
    (message,) = mavlink.MAVLink(None).parse_buffer(bytearray(wire.pack(BEAT)))
    assert (message.get_srcSystem(), message.get_srcComponent(), message.custom_mode) == (7, 191, 4)
    (back,) = wire.parse(bytes(position(5).pack(theirs)))  # type: ignore[attr-defined]
    assert (back.get_srcSystem(), back.time_boot_ms, back.vz) == (9, 5, -1.0)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.lists(st.one_of(st.none(), st.binary(max_size=40)), max_size=12), st.integers(1, 70))
def test_no_good_frame_is_lost_among_garbage_however_the_bytes_are_cut(
    parts: list[bytes | None], cut: int
) -> None:
    wire, framer = Wire((1, 1)), Framer()
    frames = [wire.pack(position(index)) for index, part in enumerate(parts) if part is None]
    upcoming = iter(frames)
    data = b"".join(next(upcoming) if part is None else part for part in parts) + bytes(300)
    found = [frame.data for i in range(0, len(data), cut) for frame in framer.feed(data[i : i + cut])]
    assert [one for one in found if one in frames] == frames


@pytest.mark.parametrize("seed", range(5))
def test_random_bytes_give_no_messages_and_no_exception(seed: int) -> None:
    wire = Wire((1, 1))
    data = np.random.default_rng(seed).integers(0, 256, 20000, dtype=np.uint8).tobytes()
    assert not list(wire.parse(data))
    assert wire.counters["garbage_bytes"] > 10000


def test_lost_frames_are_counted_by_their_numbers_and_frames_that_nobody_heeds_are_not_lost() -> None:
    theirs = Wire((1, 1))
    ours = Wire((1, 191), heed=lambda system, component, message: message == 0)
    for index in range(400):
        data = theirs.pack(BEAT if index % 10 == 0 else position(index))
        if index % 4:
            list(ours.parse(data))
    assert ours.counters["unheeded"] > 200
    assert ours.arrived[1] == 300
    assert ours.missed[1] == pytest.approx(100, abs=1)


def test_messages_of_other_dialects_are_no_losses() -> None:
    theirs, ours = Wire((1, 1)), Wire((1, 191))
    for _ in range(50):
        list(ours.parse(theirs.pack(BEAT)))
        foreign = bytearray(theirs.pack(BEAT))
        foreign[7:10] = (60_001).to_bytes(3, "little")
        list(ours.parse(bytes(foreign)))
    assert ours.counters["unknown_messages"] == 50
    assert ours.missed[1] == 0
    assert ours.arrived[1] == 100


def test_a_broken_checksum_and_a_truncated_datagram_are_counted_and_not_believed() -> None:
    wire = Wire((1, 1))
    data = bytearray(wire.pack(BEAT))
    data[12] ^= 1
    assert not list(wire.parse(bytes(data), whole=True))
    assert wire.counters["broken_frames"] == 1
    assert not list(wire.parse(wire.pack(BEAT)[:-3], whole=True))
    assert len(list(wire.parse(wire.pack(BEAT), whole=True))) == 1


def test_version_1_is_noticed_and_not_believed() -> None:
    old = bytes(BEAT.pack(mavlink.MAVLink(None, 5, 1), force_mavlink1=True))
    wire = Wire((1, 1))
    assert not list(wire.parse(old))
    assert wire.version1 == {5}


def test_what_nobody_heeds_is_not_parsed() -> None:
    wire = Wire((1, 1), heed=lambda system, component, message: message == 0)
    assert [m.get_type() for m in wire.parse(wire.pack(BEAT) + wire.pack(position(1)))] == ["HEARTBEAT"]
    assert wire.counters["unheeded"] == 1


def test_signed_messages_are_believed_by_pymavlink_and_theirs_by_us() -> None:
    secret = bytes(range(32))
    ours, theirs = Wire((1, 191), Keys(secret)), mavlink.MAVLink(None, 1, 1)
    theirs.signing.secret_key, theirs.signing.sign_outgoing = secret, True
    theirs.signing.timestamp = int((time.time() - 1_420_070_400) * 1e5)
    assert theirs.parse_buffer(bytearray(ours.pack(BEAT)))[0].get_signed()
    assert list(ours.parse(bytes(BEAT.pack(theirs))))
    assert ours.counters["rejected.signature"] == 0


@pytest.mark.parametrize("keys", [None, Keys(bytes(32))], ids=["unsigned", "another key"])
def test_unsigned_and_wrongly_signed_messages_are_not_believed(keys: Keys | None) -> None:
    wire = Wire((1, 191), Keys(bytes(range(32))))
    assert not list(wire.parse(Wire((4, 1), keys).pack(BEAT)))
    assert wire.unsigned == {4}


def test_a_replayed_message_is_not_believed_and_a_forged_one_locks_nobody_out() -> None:
    secret = bytes(range(32))
    sender, wire = Wire((4, 1), Keys(secret)), Wire((1, 191), Keys(secret))
    first = sender.pack(BEAT)
    forged = bytearray(sender.pack(BEAT))
    forged[-7] = 0xFF  # a time stamp far ahead, its signature wrong
    assert list(wire.parse(first))
    assert not list(wire.parse(first))
    assert not list(wire.parse(bytes(forged)))
    assert list(wire.parse(sender.pack(BEAT)))
    assert wire.counters["rejected.replayed"] == 1


def test_time_stamps_grow_over_a_restart_with_a_clock_that_went_back(tmp_path: Path) -> None:
    file = tmp_path / "key"
    file.write_text("ab" * 32)
    file.chmod(0o600)
    last = read_keys(file).next_stamp(time.time() + 3600)
    again = read_keys(file)
    assert again.next_stamp(time.time()) > last


def test_key_files_are_checked(tmp_path: Path) -> None:
    file = tmp_path / "key"
    with pytest.raises(DataError, match="cannot read"):
        read_keys(file)
    file.write_text("ab")
    with pytest.raises(DataError, match="chmod 600"):
        read_keys(file)
    file.chmod(0o600)
    with pytest.raises(DataError, match="64 hexadecimal digits"):
        read_keys(file)
    file.write_text("passphrase: correct horse")
    assert len(read_keys(file).secret) == 32
    assert "correct" not in repr(read_keys(file))


@pytest.mark.parametrize(
    ("text", "endpoint"),
    [
        ("udpin:0.0.0.0:14550", Endpoint("udpin", "0.0.0.0", 14550)),
        ("tcp:[::1]:5760", Endpoint("tcp", "::1", 5760)),
        ("serial:/dev/ttyACM0:921600", Endpoint("serial", "/dev/ttyACM0", 921600)),
    ],
)
def test_addresses_are_read(text: str, endpoint: Endpoint) -> None:
    assert parse_url(text) == endpoint


@pytest.mark.parametrize(
    "text", ["", "udp:1.2.3.4:5", "tcp:host", "tcp:host:0", "tcp:host:70000", "udpin::5", "serial:/x:a"]
)
def test_what_is_no_address_is_said_with_examples(text: str) -> None:
    with pytest.raises(MissionError, match=r"udpin:0\.0\.0\.0:14550"):
        parse_url(text)
