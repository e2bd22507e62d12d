"""The ledger: every measurement set and soft observation that the fusion ever accepted, durable in SQLite.

Promise: a set is committed before any watermark that covers it is published. It then survives the death of
the fusion process at any moment (WAL, synchronous NORMAL: the operating system holds the bytes); it may be
lost if the machine itself loses power within the last moments. The primary key (robot, boot, sequence)
makes a second copy impossible. `arrival` keeps the order in which all came, so that a replay is exact.
Soft observations lie among the sets as entries of another topic; no robot and operator have the same name.
"""

import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path

from agents.codec import decode, encode
from agents.errors import StorageError
from agents.messages import LedgerEntry, MeasurementSetMessage
from agents.topics import SET, SOFT_OBSERVATION, Topic

_SCHEMA = """
CREATE TABLE IF NOT EXISTS sets (
    arrival INTEGER PRIMARY KEY,
    robot TEXT NOT NULL,
    boot TEXT NOT NULL,
    sequence INTEGER NOT NULL,
    capture_time REAL NOT NULL,
    message BLOB NOT NULL,
    topic TEXT NOT NULL DEFAULT 'set',
    UNIQUE (robot, boot, sequence)
);
CREATE TABLE IF NOT EXISTS facts (name TEXT PRIMARY KEY, value TEXT NOT NULL);
"""

_TOPICS = {topic.name: topic for topic in (SET, SOFT_OBSERVATION)}


class Ledger:
    """One fusion's store. Use as a context manager."""

    def __init__(self, path: Path | str = ":memory:") -> None:
        self.path = path
        try:
            self._db = sqlite3.connect(path, isolation_level=None)
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = NORMAL")
            self._db.executescript(_SCHEMA)
            columns = self._db.execute("SELECT name FROM pragma_table_info('sets')").fetchall()
            if ("topic",) not in columns:  # of a run before there were soft observations
                self._db.execute("ALTER TABLE sets ADD COLUMN topic TEXT NOT NULL DEFAULT 'set'")
        except sqlite3.Error as error:
            raise StorageError(
                f"cannot open the ledger {path}: {error}; free some disk space, check the permissions of "
                "its directory, or choose another with --out"
            ) from error

    def __repr__(self) -> str:
        return f"Ledger({self.path}, entries={len(self)})"

    def __enter__(self) -> "Ledger":
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __len__(self) -> int:
        return int(self._db.execute("SELECT count(*) FROM sets").fetchone()[0])

    def store(self, entries: Sequence[LedgerEntry]) -> None:
        """Make entries durable; those already there stay as they are.

        Raises:
            StorageError: if the disk does not take them; nothing of the batch is then kept.
        """
        rows = [(e.sender, e.boot, e.sequence, e.time, encode(e), _topic(e).name) for e in entries]
        try:
            self._db.execute("BEGIN IMMEDIATE")
            self._db.executemany(
                "INSERT OR IGNORE INTO sets (robot, boot, sequence, capture_time, message, topic) "
                "VALUES (?, ?, ?, ?, ?, ?)",
                rows,
            )
            self._db.execute("COMMIT")
        except sqlite3.Error as error:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            raise StorageError(
                f"cannot write the ledger {self.path}: {error}; free some disk space and start the fusion "
                "again with the same ledger: robots offer again what was not acknowledged"
            ) from error

    def replay(self, team: str) -> Iterator[LedgerEntry]:
        """All entries in the order of their arrival."""
        rows = self._db.execute("SELECT robot, message, topic FROM sets ORDER BY arrival")
        for sender, payload, topic in rows:
            message = decode(_TOPICS[topic], payload, team=team, sender=sender)
            assert isinstance(message, LedgerEntry)
            yield message

    def fact(self, name: str) -> str | None:
        """A remembered fact, such as the team's epoch."""
        row = self._db.execute("SELECT value FROM facts WHERE name = ?", (name,)).fetchone()
        return None if row is None else str(row[0])

    def remember(self, name: str, value: str) -> None:
        """Keep a fact durable."""
        try:
            self._db.execute("INSERT OR REPLACE INTO facts VALUES (?, ?)", (name, value))
        except sqlite3.Error as error:
            raise StorageError(f"cannot write the ledger {self.path}: {error}") from error

    def close(self) -> None:
        """Safe to call twice."""
        self._db.close()


def _topic(entry: LedgerEntry) -> Topic:
    return SET if isinstance(entry, MeasurementSetMessage) else SOFT_OBSERVATION
