"""The ledger's file: its tables, who may write it, and what to say when SQLite refuses."""

import fcntl
import os
import sqlite3
from pathlib import Path
from typing import Literal

from agents.errors import StorageError

Synchronous = Literal["normal", "full"]

BUSY_S = 2.0  # a commit waits this long for another program's
_SCHEMA = """
CREATE TABLE IF NOT EXISTS sets (
    arrival INTEGER PRIMARY KEY,
    robot TEXT NOT NULL,
    boot TEXT NOT NULL,
    sequence INTEGER NOT NULL,
    capture_time REAL NOT NULL,
    message BLOB NOT NULL,
    topic TEXT NOT NULL DEFAULT 'set',
    expired TEXT NOT NULL DEFAULT '',
    UNIQUE (robot, boot, sequence)
);
CREATE INDEX IF NOT EXISTS in_order ON sets (capture_time, robot, boot, sequence);
CREATE TABLE IF NOT EXISTS facts (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS checkpoints (
    capture_time REAL NOT NULL,
    robot TEXT NOT NULL,
    boot TEXT NOT NULL,
    sequence INTEGER NOT NULL,
    entries INTEGER NOT NULL,
    payload BLOB NOT NULL,
    PRIMARY KEY (capture_time, robot, boot, sequence)
);
"""
_ADDED = {"topic": "TEXT NOT NULL DEFAULT 'set'", "expired": "TEXT NOT NULL DEFAULT ''"}  # since the first


def opened(path: Path | str, synchronous: Synchronous) -> sqlite3.Connection:
    """A connection that writes; the tables are made where there are none.

    Raises:
        StorageError: if that cannot be done.
    """
    try:
        db = sqlite3.connect(path, isolation_level=None, timeout=BUSY_S)
        db.execute("PRAGMA journal_mode = WAL")
        db.execute(f"PRAGMA synchronous = {synchronous}")
        columns = {str(name) for (name,) in db.execute("SELECT name FROM pragma_table_info('sets')")}
        for name, form in _ADDED.items():
            if columns and name not in columns:
                db.execute(f"ALTER TABLE sets ADD COLUMN {name} {form}")
        db.executescript(_SCHEMA)
    except sqlite3.Error as error:
        raise explained(error, "open", path) from error
    return db


def explained(error: sqlite3.Error, verb: str, path: Path | str) -> StorageError:
    """What SQLite refused, and what can be done about it."""
    return StorageError(f"cannot {verb} the ledger {path}: {error}; {_advice(error, verb)}")


def _advice(error: sqlite3.Error, verb: str) -> str:
    code = getattr(error, "sqlite_errorname", "")
    if code.startswith(("SQLITE_BUSY", "SQLITE_LOCKED")):
        return "another program holds it: close that, or wait until it is done"
    if code.startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB")) or "no such table" in str(error):
        return "it is damaged, or no ledger: take a copy of it, or another directory with --out"
    if verb == "write":
        return (
            "free some disk space and start the fusion again with the same ledger: "
            "robots offer again what was not acknowledged"
        )
    return "free some disk space, check the permissions of its directory, or choose another with --out"


def locked(path: Path) -> int | None:
    """A lock that says who writes the ledger, and falls with the process; None where it cannot be had."""
    try:
        handle = os.open(path.with_name(path.name + ".lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError:
        return None  # SQLite will say what is wrong with the place
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise StorageError(
            f"cannot open the ledger {path}: another fusion has it open; end that one, or choose another "
            "directory with --out"
        ) from None
    except OSError:  # a file system without locks
        os.close(handle)
        return None
    return handle


def opened_for_reading(path: Path) -> sqlite3.Connection:
    """A connection that only reads, also beside the fusion that writes.

    Raises:
        StorageError: if there is no ledger, or it cannot be read.
    """
    if not path.is_file():
        raise StorageError(f"there is no ledger {path}: give the directory of a run")
    uri = f"{path.resolve().as_uri()}?mode=ro"
    try:
        db = sqlite3.connect(uri, uri=True, isolation_level=None, timeout=BUSY_S)
        try:
            db.execute("SELECT count(*) FROM facts").fetchone()
        except sqlite3.OperationalError as error:
            if not str(error).startswith(("unable to open", "attempt to write")):
                raise
            db.close()  # a place where not even the index of the log can be written
            db = sqlite3.connect(f"{uri}&immutable=1", uri=True, isolation_level=None)
            db.execute("SELECT count(*) FROM facts").fetchone()
    except sqlite3.Error as error:
        raise explained(error, "read", path) from error
    return db
