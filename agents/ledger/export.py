"""A ledger's entries as files that other programs read: CSV, and MCAP for robotics tools."""

import csv
import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import msgspec

from agents.errors import SearchpartyError, StorageError
from agents.ledger.ledger import Ledger, Row
from agents.wire.messages import LedgerEntry, MeasurementSetMessage

COLUMNS = (
    *("arrival", "kind", "sender", "boot", "sequence", "capture_time_s", "expired"),
    *("x_m", "y_m", "z_m", "yaw_rad", "measurements", "measurement"),
)
_POSE = {
    "type": "object",
    "properties": {name: {"type": "number"} for name in ("x", "y", "z", "yaw")},
}
_HEAD = {
    "arrival": {"type": "integer"},
    "sender": {"type": "string"},
    "boot": {"type": "string"},
    "sequence": {"type": "integer"},
    "capture_time": {"type": "number", "description": "team seconds"},
    "expired": {"type": "string", "description": "why it is not applied; empty if it is"},
}
_SCHEMAS: dict[str, dict[str, Any]] = {
    "set": {
        "title": "searchparty.MeasurementSet",
        "type": "object",
        "properties": {
            **_HEAD,
            "pose": _POSE,
            "measurements": {"type": "array", "items": {"type": "array", "items": {"type": "number"}}},
        },
    },
    "soft_observation": {
        "title": "searchparty.SoftObservation",
        "type": "object",
        "properties": {**_HEAD, "said": {"type": "object"}},
    },
}


def write_csv(ledger: Ledger, path: Path) -> int:
    """One row for each measurement, and one for each empty set or statement; how many rows.

    Raises:
        StorageError: if the file cannot be written, or the ledger read.
    """
    with _writing(path), path.open("w", newline="") as file:
        return _csv(ledger, file)


def _csv(ledger: Ledger, file: TextIO) -> int:
    pairs = list(_entries(ledger))
    width = max(
        (e.measurements.shape[1] for _, e in pairs if isinstance(e, MeasurementSetMessage)), default=0
    )
    writer = csv.writer(file)
    writer.writerow([*COLUMNS, *(f"z{i + 1}" for i in range(width))])
    count = 0
    for row, entry in pairs:
        head = [
            row.arrival,
            row.topic,
            row.robot,
            row.boot,
            row.sequence,
            repr(row.capture_time),
            row.expired,
        ]
        if isinstance(entry, MeasurementSetMessage):
            pose = [repr(float(x)) for x in entry.pose]
            lines = [[i, *map(repr, z)] for i, z in enumerate(entry.measurements.tolist())] or [[""]]
            rows = [[*head, *pose, len(entry.measurements), *line] for line in lines]
        else:
            rows = [head]
        writer.writerows(rows)
        count += len(rows)
    return count


def write_mcap(ledger: Ledger, path: Path) -> int:
    """One JSON message for each entry, on a channel per sender, by capture time; how many.

    Raises:
        SearchpartyError: if the package mcap is not installed.
        StorageError: if the file cannot be written, or the ledger read.
    """
    try:
        import mcap.writer  # noqa: F401, PLC0415 - an extra
    except ImportError:
        raise SearchpartyError("writing MCAP needs the extra mcap: pip install 'searchparty[mcap]'") from None
    with _writing(path), path.open("wb") as file:
        return _mcap(ledger, file)


def _mcap(ledger: Ledger, file: BinaryIO) -> int:
    from mcap.writer import CompressionType, Writer  # noqa: PLC0415

    epoch, speed = float(ledger.fact("epoch") or 0.0), float(ledger.fact("speed") or 1.0)
    writer = Writer(file, compression=CompressionType.NONE)
    writer.start(profile="", library="searchparty")
    facts = {name: ledger.fact(name) or "" for name in ("mission", "fusion", "seed", "epoch", "speed")}
    writer.add_metadata("searchparty", facts)
    schemas = {
        name: writer.register_schema(schema["title"], "jsonschema", json.dumps(schema).encode())
        for name, schema in _SCHEMAS.items()
    }
    channels: dict[str, int] = {}
    count = 0
    for row, entry in sorted(_entries(ledger), key=lambda pair: pair[0].capture_time):
        topic = f"/{row.robot}/{row.topic}"
        if topic not in channels:
            channels[topic] = writer.register_channel(topic, "json", schemas[row.topic])
        at = round((epoch + row.capture_time / speed) * 1e9)
        data = json.dumps(_plain(row, entry)).encode()
        writer.add_message(channels[topic], log_time=at, publish_time=at, sequence=row.sequence, data=data)
        count += 1
    writer.finish()  # type: ignore[no-untyped-call]
    return count


def _plain(row: Row, entry: LedgerEntry) -> dict[str, Any]:
    head = {
        "arrival": row.arrival,
        "sender": row.robot,
        "boot": row.boot,
        "sequence": row.sequence,
        "capture_time": row.capture_time,
        "expired": row.expired,
    }
    if isinstance(entry, MeasurementSetMessage):
        pose = dict(zip(("x", "y", "z", "yaw"), entry.pose.tolist(), strict=True))
        return {**head, "pose": pose, "measurements": entry.measurements.tolist()}
    said = msgspec.structs.asdict(entry)
    known = {"version", "team", "sender", "boot", "sequence", "time"}
    said = {name: value for name, value in said.items() if name not in known}
    return {**head, "said": {**said, "points": entry.points.tolist()}}


def _entries(ledger: Ledger) -> Iterable[tuple[Row, LedgerEntry]]:
    return zip(ledger.rows(), ledger.replay(), strict=True)


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StorageError(f"cannot write {path}: {error.strerror}; choose another place") from error
