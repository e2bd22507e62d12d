import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from agents.errors import StorageError
from agents.ledger.history import Checkpoint, identity, key
from agents.ledger.ledger import Ledger
from agents.wire.codec import encode
from agents.wire.messages import Watermark
from tests.agents.fusion.test_watermark import measurement_set


def test_a_set_is_stored_once_however_often_it_comes(tmp_path: Path) -> None:
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        ledger.store([measurement_set(0), measurement_set(1)])
        ledger.store([measurement_set(1), measurement_set(0)])
        assert len(ledger) == 2


def test_replay_gives_the_sets_in_the_order_of_their_arrival(tmp_path: Path) -> None:
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        ledger.store([measurement_set(2), measurement_set(0)])
        ledger.store([measurement_set(1)])
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        assert [s.sequence for s in ledger.replay("t")] == [2, 0, 1]


def test_facts_are_remembered_over_a_restart(tmp_path: Path) -> None:
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        assert ledger.fact("epoch") is None
        ledger.remember("epoch", "12.5")
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        assert ledger.fact("epoch") == "12.5"


def test_what_was_stored_survives_sigkill(tmp_path: Path) -> None:
    path = tmp_path / "ledger.sqlite"
    program = (
        "import os, signal\n"
        "from agents.ledger.ledger import Ledger\n"
        "from tests.agents.fusion.test_watermark import measurement_set\n"
        f"ledger = Ledger({str(path)!r})\n"
        "ledger.store([measurement_set(0)])\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], check=False, timeout=60)
    assert ended.returncode == -9
    with Ledger(path) as ledger:
        assert [s.sequence for s in ledger.replay("t")] == [0]


def test_an_unwritable_place_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="cannot open the ledger"):
        Ledger(tmp_path / "missing" / "ledger.sqlite")


def test_a_disk_that_takes_no_more_keeps_what_was_there(tmp_path: Path) -> None:
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        ledger.store([measurement_set(0)])
        pages = ledger._db.execute("PRAGMA page_count").fetchone()[0]
        ledger._db.execute(f"PRAGMA max_page_count = {pages}")
        with pytest.raises(StorageError, match="free some disk space"):
            ledger.store([measurement_set(i) for i in range(1, 5000)])
        assert len(ledger) == 1


def test_two_readers_and_a_writer_do_not_wait_for_each_other(tmp_path: Path) -> None:
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        ledger.store([measurement_set(0)])
        reader = sqlite3.connect(path)
        assert reader.execute("SELECT count(*) FROM sets").fetchone() == (1,)
        ledger.store([measurement_set(1)])
        assert reader.execute("SELECT count(*) FROM sets").fetchone() == (2,)
        reader.close()


def test_two_fusions_on_one_ledger_are_one_clear_error(tmp_path: Path) -> None:
    with Ledger(tmp_path / "ledger.sqlite"), pytest.raises(StorageError, match="another fusion has it open"):
        Ledger(tmp_path / "ledger.sqlite")
    with Ledger(tmp_path / "ledger.sqlite"):
        pass  # and the lock falls with the one that had it


def test_a_ledger_held_by_another_program_is_one_clear_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("agents.ledger.ledger_file.BUSY_S", 0.05)
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        other = sqlite3.connect(tmp_path / "ledger.sqlite", isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(StorageError, match="another program holds it: close that"):
            ledger.store([measurement_set(0)])
        other.execute("ROLLBACK")
        other.close()
        ledger.store([measurement_set(0)])
        assert len(ledger) == 1


@pytest.mark.parametrize(
    "content", [b"this is no database, whatever its name says" * 200, b"SQLite format 3\0" * 99]
)
def test_a_damaged_ledger_is_one_clear_error(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "ledger.sqlite").write_bytes(content)
    with pytest.raises(StorageError, match="damaged, or no ledger"):
        Ledger(tmp_path / "ledger.sqlite")


@pytest.mark.parametrize(("synchronous", "level"), [("normal", 1), ("full", 2)])
def test_the_choice_of_durability_reaches_the_database(tmp_path: Path, synchronous: str, level: int) -> None:
    with Ledger(tmp_path / "ledger.sqlite", synchronous=synchronous) as ledger:  # type: ignore[arg-type]
        assert ledger._db.execute("PRAGMA synchronous").fetchone() == (level,)
        assert ledger._db.execute("PRAGMA journal_mode").fetchone() == ("wal",)


def test_a_ledger_of_the_first_version_is_read_and_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "ledger.sqlite"
    old = sqlite3.connect(path)
    old.executescript(
        "CREATE TABLE sets (arrival INTEGER PRIMARY KEY, robot TEXT NOT NULL, boot TEXT NOT NULL, "
        "sequence INTEGER NOT NULL, capture_time REAL NOT NULL, message BLOB NOT NULL, "
        "UNIQUE (robot, boot, sequence)); CREATE TABLE facts (name TEXT PRIMARY KEY, value TEXT NOT NULL);"
    )
    one = measurement_set(3)
    old.execute(
        "INSERT INTO sets VALUES (1, ?, ?, ?, ?, ?)", (one.sender, one.boot, 3, one.time, encode(one))
    )
    old.commit()
    old.close()
    with Ledger(path, read_only=True) as ledger:
        assert [row.sequence for row in ledger.rows()] == [3]
        assert [entry.sequence for entry in ledger.replay()] == [3]
    with Ledger(path) as ledger:
        ledger.store([measurement_set(4)])
        assert [entry.sequence for entry in ledger.between(None, None, 10)] == [3, 4]


def test_entries_are_read_in_the_order_of_their_keys_between_two_of_them() -> None:
    entries = [measurement_set(n, robot=r) for n in range(6) for r in ("r2", "r1")]
    with Ledger() as ledger:
        ledger.store(entries[::-1], {identity(entries[4]): "late"})
        whole = ledger.between(None, None, 100)
        places = [key(entry) for entry in whole]
        assert places == sorted(places)
        assert len(places) == len(entries) - 1  # what expired does not apply
        assert [key(e) for e in ledger.between(places[2], places[7], 3)] == places[3:6]
        assert [key(e) for e in ledger.between(places[2], places[4], 100)] == places[3:5]
        assert [e.sequence for e in ledger.of("r1/b1", 2, 4, 2)] == [2, 3]


def test_contents_are_told_without_reading_entries() -> None:
    with Ledger() as ledger:
        ledger.store([measurement_set(n) for n in (0, 1, 4, 5)], {("r1", "b1", 5): "late"})
        contents = ledger.contents()
    assert contents.watermarks == {"r1/b1": Watermark(upto=1, beyond=[(4, 5)])}
    assert contents.expired == {"r1/b1": Watermark(upto=-1, beyond=[(5, 5)])}
    assert (contents.sets, contents.statements, contents.newest) == (3, 0, 4.0)


def test_a_checkpoint_falls_in_the_transaction_in_which_an_entry_comes_before_it(tmp_path: Path) -> None:
    checkpoints = [Checkpoint((float(t), "r1", "b1", t), t, b"state") for t in (10, 20, 30)]
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        for checkpoint in checkpoints:
            ledger.keep(checkpoint, [c.key for c in checkpoints])
        ledger.store([measurement_set(40)])
        assert ledger.checkpoints() == checkpoints
        ledger.store([measurement_set(25)])
        assert ledger.checkpoints() == checkpoints[:2]
        ledger.store([measurement_set(5)], {("r1", "b1", 5): "late"})  # changes nothing
    with Ledger(path) as ledger:
        assert ledger.checkpoints() == checkpoints[:2]
        ledger.store([], revived=[("r1", "b1", 5)])
        assert ledger.checkpoints() == []


def test_only_the_checkpoints_that_are_wanted_stay() -> None:
    checkpoints = [Checkpoint((float(t), "r1", "b1", t), t, b"state") for t in range(5)]
    with Ledger() as ledger:
        for checkpoint in checkpoints:
            ledger.keep(checkpoint, [checkpoints[0].key, checkpoint.key])
        assert [c.entries for c in ledger.checkpoints()] == [0, 4]
