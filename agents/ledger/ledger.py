"""The ledger: every measurement set and soft observation that a fusion ever accepted, durable in SQLite.

Promise: an entry is committed before any watermark that covers it is published, and the primary key (robot,
boot, sequence) makes a second copy impossible. With synchronous "normal" what is committed survives the
death of the process at any moment (the operating system holds the bytes), and may be lost if the machine
itself loses power within the last moments; the file stays sound. With "full" it is on the disk before it is
acknowledged, and survives that too, for the price of one flush of the disk per batch of sets.

The estimate is a function of the entries that did not expire, in the order of their keys. Checkpoints are
states of it; one is dropped in the same transaction in which an entry comes that belongs before it, so that
those in the file always hold. `arrival` keeps the order in which all came. Soft observations lie among the
sets as entries of another topic; no robot and operator have the same name.
"""

import os
import sqlite3
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import msgpack

from agents.errors import MalformedMessage, StorageError
from agents.fusion.watermark import of_numbers, source
from agents.ledger.history import Checkpoint, Contents, Identity, Key, identity
from agents.ledger.ledger_file import Synchronous, explained, locked, opened, opened_for_reading
from agents.wire.codec import decode, encode
from agents.wire.messages import LedgerEntry, MeasurementSetMessage
from agents.wire.topics import SET, SOFT_OBSERVATION, Topic

_KEY = "(capture_time, robot, boot, sequence)"
_TOPICS = {topic.name: topic for topic in (SET, SOFT_OBSERVATION)}


class Row(NamedTuple):
    """One entry as it lies in the file."""

    arrival: int
    robot: str
    boot: str
    sequence: int
    capture_time: float
    topic: str
    expired: str  # why it is not applied; "" if it is
    message: bytes


class Ledger:
    """One fusion's store, an `agents.ledger.history.History`. Use as a context manager."""

    def __init__(
        self,
        path: Path | str = ":memory:",
        *,
        synchronous: Synchronous = "normal",
        read_only: bool = False,
    ) -> None:
        """Open the file, or begin it.

        Raises:
            StorageError: if that cannot be done, or another fusion has it open.
        """
        self.path = path
        self._team: str | None = None
        self._last_checkpoint = float("-inf")
        if read_only:
            self._lock, self._db = None, opened_for_reading(Path(path))
            return
        self._lock = None if path == ":memory:" else locked(Path(path))
        try:
            self._db = opened(path, synchronous)
            with self._explaining("open"):
                (newest,) = self._db.execute("SELECT max(capture_time) FROM checkpoints").fetchone()
        except StorageError:
            self._unlock()
            raise
        if newest is not None:
            self._last_checkpoint = float(newest)

    def __repr__(self) -> str:
        return f"Ledger({self.path}, entries={len(self)})"

    def __enter__(self) -> "Ledger":
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __len__(self) -> int:
        with self._explaining("read"):
            return int(self._db.execute("SELECT count(*) FROM sets").fetchone()[0])

    # Writing

    def store(
        self,
        entries: Sequence[LedgerEntry],
        expired: Mapping[Identity, str] | None = None,
        revived: Collection[Identity] = (),
    ) -> None:
        """Make entries durable; those already there stay as they are. Those that `expired` do not apply.

        `revived` ones had expired, and apply from now on.

        Raises:
            StorageError: if the disk does not take them; nothing of the batch is then kept.
        """
        reasons = expired or {}
        rows = [(*_plain(entry), encode(entry), reasons.get(identity(entry), "")) for entry in entries]
        applied = [entry.time for entry in entries if identity(entry) not in reasons]
        with self._explaining("write"), self._transaction():
            self._db.executemany(
                "INSERT OR IGNORE INTO sets (robot, boot, sequence, capture_time, topic, message, expired) "
                "VALUES (?, ?, ?, ?, ?, ?, ?)",
                rows,
            )
            for one in revived:
                where = "robot = ? AND boot = ? AND sequence = ?"
                self._db.execute(f"UPDATE sets SET expired = '' WHERE {where}", one)
                found = self._db.execute(f"SELECT capture_time FROM sets WHERE {where}", one).fetchone()
                applied += [] if found is None else [found[0]]
            if applied and min(applied) <= self._last_checkpoint:
                first = min(applied)
                self._db.execute("DELETE FROM checkpoints WHERE capture_time >= ?", (first,))
                self._last_checkpoint = min(self._last_checkpoint, first)

    def keep(self, checkpoint: Checkpoint, kept: Sequence[Key]) -> None:
        """Make a checkpoint durable, and drop those that are not among the keys `kept`.

        Raises:
            StorageError: if the disk does not take it.
        """
        with self._explaining("write"), self._transaction():
            wanted = {*kept, checkpoint.key}
            here = self._db.execute("SELECT capture_time, robot, boot, sequence FROM checkpoints").fetchall()
            gone = [place for place in here if place not in wanted]
            self._db.executemany(f"DELETE FROM checkpoints WHERE {_KEY} = (?, ?, ?, ?)", gone)
            self._db.execute(
                "INSERT OR REPLACE INTO checkpoints VALUES (?, ?, ?, ?, ?, ?)",
                (*checkpoint.key, checkpoint.entries, checkpoint.payload),
            )
        self._last_checkpoint = max(self._last_checkpoint, checkpoint.key[0])

    def remember(self, name: str, value: str) -> None:
        """Keep a fact durable, such as the team's epoch."""
        with self._explaining("write"):
            self._db.execute("INSERT OR REPLACE INTO facts VALUES (?, ?)", (name, value))

    # Reading

    def fact(self, name: str) -> str | None:
        """A remembered fact."""
        with self._explaining("read"):
            row = self._db.execute("SELECT value FROM facts WHERE name = ?", (name,)).fetchone()
        return None if row is None else str(row[0])

    def rows(self) -> Iterator[Row]:
        """All entries in the order of their arrival, as they lie there."""
        with self._explaining("read"):
            columns = {str(n) for (n,) in self._db.execute("SELECT name FROM pragma_table_info('sets')")}
            chosen = [
                name if name in columns else {"topic": "'set'", "expired": "''"}[name] for name in Row._fields
            ]
            for row in self._db.execute(f"SELECT {', '.join(chosen)} FROM sets ORDER BY arrival"):
                yield Row(*row)

    def replay(self, team: str | None = None) -> Iterator[LedgerEntry]:
        """All entries in the order of their arrival, the expired ones too."""
        for row in self.rows():
            yield self._entry(row.robot, row.message, row.topic, team)

    def contents(self) -> Contents:
        numbers: dict[str, list[int]] = {}
        expired: dict[str, list[int]] = {}
        counts = dict.fromkeys(_TOPICS, 0)
        with self._explaining("read"):
            query = "SELECT robot, boot, sequence, topic, expired FROM sets ORDER BY robot, boot, sequence"
            for robot, boot, sequence, topic, reason in self._db.execute(query):
                name = source(robot, boot)
                numbers.setdefault(name, []).append(sequence)
                if reason:
                    expired.setdefault(name, []).append(sequence)
                else:
                    counts[topic] += 1
            newest = self._db.execute("SELECT max(capture_time) FROM sets WHERE expired = ''").fetchone()[0]
        return Contents(
            {name: of_numbers(found) for name, found in numbers.items()},
            {name: of_numbers(found) for name, found in expired.items()},
            counts[SET.name],
            counts[SOFT_OBSERVATION.name],
            newest,
        )

    def checkpoints(self) -> list[Checkpoint]:
        with self._explaining("read"):
            rows = self._db.execute(f"SELECT * FROM checkpoints ORDER BY {_KEY[1:-1]}").fetchall()
        return [Checkpoint((time, robot, boot, seq), n, blob) for time, robot, boot, seq, n, blob in rows]

    def between(self, after: Key | None, upto: Key | None, limit: int) -> list[LedgerEntry]:
        bounds = [(f"{_KEY} > (?, ?, ?, ?)", after), (f"{_KEY} <= (?, ?, ?, ?)", upto)]
        where = " AND ".join(["expired = ''", *(text for text, bound in bounds if bound is not None)])
        values = [value for _, bound in bounds if bound is not None for value in bound]
        return self._found(f"{where} ORDER BY {_KEY[1:-1]} LIMIT {limit}", values)

    def of(self, name: str, first: int, last: int, limit: int) -> list[LedgerEntry]:
        robot, _, boot = name.partition("/")
        where = "robot = ? AND boot = ? AND sequence BETWEEN ? AND ? ORDER BY sequence"
        return self._found(f"{where} LIMIT {limit}", [robot, boot, first, last])

    def _found(self, where: str, values: Sequence[Any]) -> list[LedgerEntry]:
        with self._explaining("read"):
            rows = self._db.execute(
                f"SELECT robot, message, topic FROM sets WHERE {where}", values
            ).fetchall()
        return [self._entry(*row) for row in rows]

    def _entry(self, sender: str, payload: bytes, topic: str, team: str | None = None) -> LedgerEntry:
        try:
            if self._team is None:
                self._team = team or str(msgpack.unpackb(payload)["team"])
            message = decode(_TOPICS[topic], payload, team=self._team, sender=sender)
        except (MalformedMessage, KeyError, ValueError, TypeError) as error:
            raise StorageError(
                f"the ledger {self.path} is damaged: an entry of {sender} cannot be read ({error}); "
                "go on with a copy of it, or begin a new one with another --out"
            ) from None
        assert isinstance(message, LedgerEntry)
        return message

    def close(self) -> None:
        """Safe to call twice."""
        self._db.close()
        self._unlock()

    def _unlock(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._db.execute("COMMIT")
        except BaseException:
            with suppress(sqlite3.Error):
                if self._db.in_transaction:
                    self._db.execute("ROLLBACK")
            raise

    @contextmanager
    def _explaining(self, verb: str) -> Iterator[None]:
        """Say of what SQLite refuses what can be done about it."""
        try:
            yield
        except sqlite3.Error as error:
            raise explained(error, verb, self.path) from error


def _plain(entry: LedgerEntry) -> tuple[str, str, int, float, str]:
    return entry.sender, entry.boot, entry.sequence, entry.time, _topic(entry).name


def _topic(entry: LedgerEntry) -> Topic:
    return SET if isinstance(entry, MeasurementSetMessage) else SOFT_OBSERVATION
