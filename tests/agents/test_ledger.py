import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from agents.errors import StorageError
from agents.ledger import Ledger
from tests.agents.test_watermark import measurement_set


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
        "from agents.ledger import Ledger\n"
        "from tests.agents.test_watermark import measurement_set\n"
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
