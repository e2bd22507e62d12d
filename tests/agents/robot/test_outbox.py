"""A robot's sets that no fusion has are there after its death, and only they."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from agents.errors import StorageError
from agents.robot.outbox import Outbox
from tests.agents.fusion.test_watermark import measurement_set


def opened(path: Path, run: str = "run 1", **options: str) -> Outbox:
    return Outbox(path, team="t", robot="r1", run=run, **options)  # type: ignore[arg-type]


def left(path: Path, run: str = "run 1") -> list[tuple[str, int]]:
    with opened(path, run) as outbox:
        return [(message.boot, message.sequence) for message in outbox.left]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "robots" / "r1.outbox"


def test_what_was_added_and_not_released_is_there_again_as_it_was(path: Path) -> None:
    with opened(path) as outbox:
        outbox.add([measurement_set(0), measurement_set(1)])
        outbox.add([measurement_set(2)])
        outbox.release([("b1", 1), ("b1", 77)])
    with opened(path) as outbox:
        outbox.add([measurement_set(0, boot="b2")])
    assert left(path) == [("b1", 0), ("b1", 2), ("b2", 0)]


def test_what_was_added_survives_sigkill(path: Path) -> None:
    program = (
        "import os, signal\n"
        "from pathlib import Path\n"
        "from agents.robot.outbox import Outbox\n"
        "from tests.agents.fusion.test_watermark import measurement_set\n"
        f"outbox = Outbox(Path({str(path)!r}), team='t', robot='r1', run='run 1')\n"
        "outbox.add([measurement_set(0)])\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], check=False, timeout=60)
    assert ended.returncode == -signal.SIGKILL
    assert left(path) == [("b1", 0)]


@pytest.mark.parametrize("cut", range(1, 60, 7))
def test_a_record_cut_short_by_a_death_is_left_out_and_no_other(path: Path, cut: int) -> None:
    with opened(path) as outbox:
        outbox.add([measurement_set(0)])
        whole = path.stat().st_size
        outbox.add([measurement_set(1)])
        assert path.stat().st_size > whole + 60
    os.truncate(path, whole + cut)
    with opened(path) as outbox:
        assert outbox.damaged == cut
        assert len(outbox) == 1
        outbox.add([measurement_set(2)])
    assert left(path) == [("b1", 0), ("b1", 2)]


def test_the_sets_of_another_run_are_put_aside_and_not_lost(path: Path) -> None:
    with opened(path, "run 1") as outbox:
        outbox.add([measurement_set(0)])
    with opened(path, "run 2") as outbox:
        assert outbox.left == []
        assert outbox.put_aside is not None
        aside = outbox.put_aside
    assert left(aside, "run 1") == [("b1", 0)]


def test_the_file_does_not_grow_with_time(path: Path) -> None:
    with opened(path) as outbox:
        for sequence in range(3000):
            outbox.add([measurement_set(sequence)])
            outbox.release([("b1", sequence - 5)])
        assert path.stat().st_size < 100_000
    assert [sequence for _, sequence in left(path)] == list(range(2995, 3000))


def test_full_flushes_every_record_to_the_disk_and_normal_none(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flushed: list[int] = []
    monkeypatch.setattr("os.fdatasync", flushed.append)
    with opened(path) as outbox:
        outbox.add([measurement_set(0)])
    assert not flushed
    with opened(path, synchronous="full") as outbox:
        outbox.add([measurement_set(1)])
        outbox.add([measurement_set(2)])
    assert len(flushed) == 2


def test_two_processes_of_one_robot_are_one_clear_error(path: Path) -> None:
    with opened(path), pytest.raises(StorageError, match="open in another process"):
        opened(path)
    assert left(path) == []


def test_a_place_that_cannot_be_written_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="choose another directory with --out"):
        opened(tmp_path / "file" / "r1.outbox")


def test_anothers_sets_are_one_clear_error(path: Path) -> None:
    with opened(path) as outbox:
        outbox.add([measurement_set(0, robot="r2")])
    with pytest.raises(StorageError, match="no measurement set of r1"):
        opened(path)
