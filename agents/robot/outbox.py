"""A robot's own measurement sets that no fusion has acknowledged, on the robot's disk.

A robot that dies and starts again has a new boot id and counts anew; the sets of its earlier boots lie here
until a watermark covers them, and are offered again as they were. A set is written before it is sent.

The file is a log: records of a length, a checksum and MessagePack. What was written in full survives the
death of the process ("normal"), and, flushed after each record, a power cut ("full"). A record that was cut
short by a death is the last one and is left out. The log is written anew when most of it is of the past.
The first record says of which run it is; what another run left is put aside under another name.
"""

import fcntl
import os
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import msgpack

from agents.errors import MalformedMessage, StorageError
from agents.ledger.ledger_file import Synchronous
from agents.wire.codec import decode, encode
from agents.wire.messages import MeasurementSetMessage
from agents.wire.topics import SET

_HEAD = struct.Struct("<II")  # bytes of the record, their CRC-32
_COMPACT_BYTES = 65_536  # a smaller file is never written anew

Place = tuple[str, int]  # boot, sequence


class Outbox:
    """The sets of one robot in one run. Use as a context manager."""

    def __init__(
        self, path: Path, *, team: str, robot: str, run: str, synchronous: Synchronous = "normal"
    ) -> None:
        """Open the file, or begin it. `run` is what no other run of the team has.

        Raises:
            StorageError: if that cannot be done, or another process has it open.
        """
        self.path = path
        self.put_aside: Path | None = None  # where the sets of another run are now
        self.damaged = 0  # bytes at the end that were no record
        self._full = synchronous == "full"
        self._kept: dict[Place, bytes] = {}
        self._first = msgpack.packb(["run", run])
        self._handle = -1
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._lock = _locked(path)
            self._begin(run)
        except OSError as error:
            raise self._refused("open", error) from error
        self.left = [self._message(team, robot, payload) for payload in self._kept.values()]

    def __repr__(self) -> str:
        return f"Outbox({self.path}, kept={len(self._kept)})"

    def __len__(self) -> int:
        return len(self._kept)

    def __enter__(self) -> "Outbox":
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def add(self, messages: Sequence[MeasurementSetMessage]) -> None:
        """Make sets durable.

        Raises:
            StorageError: if the disk does not take them.
        """
        payloads = {(m.boot, m.sequence): encode(m) for m in messages}
        self._write([_record(["set", *place, payload]) for place, payload in payloads.items()])
        self._kept.update(payloads)

    def release(self, places: Iterable[Place]) -> None:
        """Forget sets that a fusion has.

        Raises:
            StorageError: if the disk does not take that.
        """
        gone = [place for place in places if self._kept.pop(place, None) is not None]
        if not gone:
            return
        if os.fstat(self._handle).st_size > _COMPACT_BYTES + 4 * sum(map(len, self._kept.values())):
            self._write_anew()
        else:
            self._write([_record(["gone", *place]) for place in gone])

    def close(self) -> None:
        """Safe to call twice."""
        for handle in (self._handle, self._lock):
            if handle >= 0:
                os.close(handle)
        self._handle = self._lock = -1

    def _begin(self, run: str) -> None:
        data = self.path.read_bytes() if self.path.exists() else b""
        whole, theirs = 0, None
        for end, record in _records(data):
            whole = end
            if record[0] == "run":
                theirs = record[1]
            elif record[0] == "set":
                self._kept[record[1], record[2]] = record[3]
            elif record[0] == "gone":
                self._kept.pop((record[1], record[2]), None)
        self.damaged = len(data) - whole
        if theirs != run and self._kept:
            self.put_aside = self.path.with_name(f"{self.path.name}.{theirs or 'unknown'}")
            os.replace(self.path, self.put_aside)
        if theirs != run:
            self._kept.clear()
        self._write_anew()

    def _write_anew(self) -> None:
        """A file of what is kept, in place of the old one at once."""
        fresh = self.path.with_name(self.path.name + ".new")
        records = [
            _framed(self._first),
            *(_record(["set", *p, payload]) for p, payload in self._kept.items()),
        ]
        try:
            handle = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND | os.O_CLOEXEC, 0o644)
            _write_all(handle, b"".join(records))
            if self._full:
                os.fsync(handle)
            os.replace(fresh, self.path)
        except OSError as error:
            raise self._refused("write", error) from error
        if self._handle >= 0:
            os.close(self._handle)
        self._handle = handle

    def _write(self, records: Sequence[bytes]) -> None:
        try:
            _write_all(self._handle, b"".join(records))
            if self._full:
                os.fdatasync(self._handle)
        except OSError as error:
            raise self._refused("write", error) from error

    def _message(self, team: str, robot: str, payload: bytes) -> MeasurementSetMessage:
        try:
            message = decode(SET, payload, team=team, sender=robot)
        except MalformedMessage as error:
            raise StorageError(
                f"{self.path} holds what is no measurement set of {robot} in team {team} ({error}): "
                "remove it, or choose another directory with --out"
            ) from None
        assert isinstance(message, MeasurementSetMessage)
        return message

    def _refused(self, verb: str, error: OSError) -> StorageError:
        return StorageError(
            f"cannot {verb} {self.path}, which keeps the robot's sets: {error.strerror}; free some disk "
            "space, or choose another directory with --out"
        )


def _record(values: list[Any]) -> bytes:
    return _framed(msgpack.packb(values))


def _framed(packed: bytes) -> bytes:
    return _HEAD.pack(len(packed), zlib.crc32(packed)) + packed


def _records(data: bytes) -> Iterator[tuple[int, list[Any]]]:
    """The whole records, each with where it ends; nothing after the first that is not."""
    place = 0
    while place + _HEAD.size <= len(data):
        size, checksum = _HEAD.unpack_from(data, place)
        end = place + _HEAD.size + size
        packed = data[place + _HEAD.size : end]
        if len(packed) < size or zlib.crc32(packed) != checksum:
            return
        yield end, msgpack.unpackb(packed)
        place = end


def _write_all(handle: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(handle, view) :]


def _locked(path: Path) -> int:
    handle = os.open(path.with_name(path.name + ".lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise StorageError(
            f"{path} is open in another process, which is this robot too: end that one, "
            "or choose another directory with --out"
        ) from None
    return handle
