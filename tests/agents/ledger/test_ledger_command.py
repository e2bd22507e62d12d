"""`searchparty ledger` shows what is stored and gives it to other programs as it is."""

import csv
import json
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from agents import cli
from agents.ledger.ledger import Ledger
from agents.wire.messages import LedgerEntry, MeasurementSetMessage
from tests.agents.ledger_story import story
from tests.agents.wire.test_codec import EXAMPLES

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["searchparty", "ledger", *map(str, arguments)])
        monkeypatch.setenv("COLUMNS", "120")
        with pytest.raises(SystemExit) as caught:
            cli.main()
        out, err = capsys.readouterr()
        return int(caught.value.code or 0), out, err

    return call


def stored() -> list[LedgerEntry]:
    """Of r1 numbers 0-3, 6 and 7; of r2 all but one that came 8 s late."""
    entries = list(story()[:60])
    chosen = [e for e in entries if e.sender == "r1" and e.sequence in (0, 1, 2, 3, 6, 7)]
    chosen += [e for e in entries if e.sender == "r2" and e.time > 0.0]
    chosen.sort(key=lambda e: e.time)
    late = next(e for e in chosen if e.sender == "r2")
    chosen.remove(late)
    place = next(i for i, e in enumerate(chosen) if e.time > late.time + 8.0)
    return [*chosen[:place], late, *chosen[place:]]


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    entries = stored()
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        for entry in entries:
            expired = {(entry.sender, entry.boot, entry.sequence): "late"}
            late = ledger.contents().newest is not None and entry.time < ledger.contents().newest - 5.0  # type: ignore[operator]
            ledger.store([entry], expired if late else {})
        ledger.remember("mission", "small")
        ledger.remember("epoch", "1000.0")
    return tmp_path


def test_it_tells_by_sender_and_boot_what_is_there_missing_late_and_expired(
    run: Run, directory: Path
) -> None:
    code, out, _ = run(directory, "--json")
    assert code == 0
    (ledger,) = json.loads(out)["ledgers"]
    assert ledger["sets"] == len(stored())
    assert ledger["mission"] == "small"
    one, two = ledger["sources"]
    assert (one["robot"], one["stored"], one["missing"], one["gaps"]) == ("r1", 6, 2, [[4, 5]])
    assert (two["robot"], two["late"], two["expired"]) == ("r2", 1, {"late": 1})
    assert 7.0 < two["latest_s"] < 11.0
    code, out, _ = run(directory)
    assert code == 0
    assert "2 (4-5)" in out
    assert "1 late" in out


def test_csv_holds_every_number_exactly(run: Run, directory: Path, tmp_path: Path) -> None:
    code, out, _ = run(directory, "--csv", tmp_path / "sets.csv")
    assert code == 0
    assert "sets.csv" in out
    with (tmp_path / "sets.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for entry in stored():
        assert isinstance(entry, MeasurementSetMessage)
        mine = [r for r in rows if r["sender"] == entry.sender and int(r["sequence"]) == entry.sequence]
        assert len(mine) == max(1, len(entry.measurements))
        assert {float(r["capture_time_s"]) for r in mine} == {entry.time}
        assert [float(mine[0][k]) for k in ("x_m", "y_m", "z_m", "yaw_rad")] == entry.pose.tolist()
        assert {int(r["measurements"]) for r in mine} == {len(entry.measurements)}
        if len(entry.measurements):
            assert [[float(r["z1"]), float(r["z2"])] for r in mine] == entry.measurements.tolist()


def test_mcap_can_be_read_by_others(run: Run, directory: Path, tmp_path: Path) -> None:
    """By the reader of Rerun, which is other code than what wrote it, and number by number by MCAP's own."""
    path = tmp_path / "sets.mcap"
    code, _, _ = run(directory, "--mcap", path)
    assert code == 0
    from mcap.reader import make_reader

    with path.open("rb") as file:
        messages = [
            (schema.name if schema else "", channel.topic, message.log_time, json.loads(message.data))
            for schema, channel, message in make_reader(file).iter_messages()
        ]
    expected = sorted(stored(), key=lambda e: e.time)
    assert [m[3]["sequence"] for m in messages] == [e.sequence for e in expected]
    for (schema, topic, at, data), entry in zip(messages, expected, strict=True):
        assert isinstance(entry, MeasurementSetMessage)
        assert (schema, topic) == ("searchparty.MeasurementSet", f"/{entry.sender}/set")
        assert data["measurements"] == entry.measurements.tolist()
        assert list(data["pose"].values()) == entry.pose.tolist()
        assert at == round((1000.0 + entry.time) * 1e9)
    rerun = Path(sys.executable).with_name("rerun")
    told = subprocess.run(
        [rerun, "mcap", "info", path], capture_output=True, text=True, timeout=60, check=True
    ).stdout
    assert f"Messages                 {len(expected)}" in told
    assert "searchparty" in told


def test_statements_of_operators_are_shown_and_exported_too(run: Run, tmp_path: Path) -> None:
    said = EXAMPLES["soft_observation"]
    assert isinstance(said, LedgerEntry)
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        ledger.store([said])
    code, out, _ = run(tmp_path, "--csv", tmp_path / "a.csv", "--mcap", tmp_path / "a.mcap")
    assert code == 0
    assert "r1 (says)" in out
    assert "soft_observation" in (tmp_path / "a.csv").read_text()


def test_several_fusions_of_a_run_are_compared(run: Run, directory: Path) -> None:
    with Ledger(directory / "ledger-fusion-2.sqlite") as ledger:
        ledger.store(sorted(stored(), key=lambda e: -e.time)[5:])
    _, out, _ = run(directory)
    assert "they do not hold the same" in out
    with Ledger(directory / "ledger-fusion-3.sqlite") as ledger:
        ledger.store(sorted(stored(), key=lambda e: -e.time)[5:][::-1])
    (directory / "ledger.sqlite").unlink()
    _, out, _ = run(directory)
    assert "all hold the same entries" in out


def test_it_can_be_looked_at_while_the_fusion_writes(run: Run, tmp_path: Path) -> None:
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        ledger.store(story()[:3])
        code, out, _ = run(tmp_path, "--json")
        ledger.store(story()[3:5])
    assert code == 0
    assert json.loads(out)["ledgers"][0]["sets"] == 3


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "there is no"),
        ("empty directory", "holds no ledger.sqlite"),
        (b"no database at all, but long enough to be looked at" * 99, "it is damaged, or no ledger"),
        (b"", "it is damaged, or no ledger"),
        ("other tables", "it is damaged, or no ledger"),
    ],
)
def test_what_is_no_ledger_is_one_clear_sentence(
    run: Run, tmp_path: Path, content: bytes | str | None, words: str
) -> None:
    place = tmp_path / "run"
    if content is not None:
        place.mkdir()
    if isinstance(content, bytes):
        (place / "ledger.sqlite").write_bytes(content)
    if content == "other tables":
        sqlite3.connect(place / "ledger.sqlite").executescript("CREATE TABLE a (b)")
    code, _, err = run(place)
    assert code == 5
    assert words in err
    assert len(err.strip().splitlines()) == 1


def test_a_damaged_entry_is_one_clear_sentence_that_names_its_sender(run: Run, directory: Path) -> None:
    with sqlite3.connect(directory / "ledger.sqlite") as db:
        db.execute("UPDATE sets SET message = x'00ff' WHERE arrival = 3")
    code, _, err = run(directory, "--csv", directory / "a.csv")
    assert code == 5
    assert "is damaged: an entry of r" in err


def test_a_place_that_cannot_be_written_is_one_clear_sentence(run: Run, directory: Path) -> None:
    code, _, err = run(directory, "--csv", directory / "no" / "such" / "a.csv")
    assert code == 5
    assert "choose another place" in err
