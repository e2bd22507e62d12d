"""A run's history survives being written, and being torn."""

from pathlib import Path

import pytest

from agents.errors import DataError
from agents.invariants import RunHistory
from agents.invariants.history import FILE, Size, Used
from agents.ledger.ledger import Ledger
from agents.swarm.run_directory import RunDirectory
from tests.agents.invariants.stories import Story, mission, posterior_of, set_of


def kept(directory: Path) -> RunHistory:
    story = Story()
    story.say(1.0, "set", set_of("r1", 0, 1.0))
    story.say(1.1, "posterior", posterior_of([set_of("r1", 0, 1.0)], 0))
    story.places(1.0, r1=(0.0, 1.0, 2.0), r2=(5.0, 6.0, 7.0))
    story.history.used.append(Used(1.0, "r1", "pose", "r2", 0.5))
    story.history.sizes.append(Size(1.0, "r1", "b0", "queue of pose", 3.0, 256.0))
    story.history.tell(2.0, "cut", "r1", other="r2")
    run = RunDirectory.create(mission(), directory)
    with Ledger(run.ledger) as ledger:
        ledger.store([set_of("r1", 0, 1.0)])
    story.history.write(directory)
    return story.history


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    written, read = kept(tmp_path), RunHistory.read(tmp_path)
    assert (read.driver, read.seed) == ("virtual", mission().seed)
    assert read.facts == written.facts
    assert read.places == written.places
    assert (read.used, read.sizes) == (written.used, written.sizes)
    assert [(s.at, s.topic, s.message.sender) for s in read.said] == [
        (1.0, "set", "r1"),
        (1.1, "posterior", "fusion"),
    ]
    assert [entry.sequence for entry in read.ledgers["fusion"]] == [0]


def test_a_torn_end_costs_the_last_record_only(tmp_path: Path) -> None:
    written = kept(tmp_path)
    file = tmp_path / FILE
    file.write_bytes(file.read_bytes()[:-3])
    read = RunHistory.read(tmp_path)
    assert len(read.sizes) == len(written.sizes) - 1
    assert read.facts == written.facts


@pytest.mark.parametrize("spoil", [b"\xff" * 40, b"\x04\x00\x00\x00abcd"])
def test_what_is_no_history_is_told_so(tmp_path: Path, spoil: bytes) -> None:
    kept(tmp_path)
    (tmp_path / FILE).write_bytes(b"\x02\x00\x00\x00\x91\xc1" if spoil[0] == 255 else spoil)
    with pytest.raises(DataError, match="no run's history"):
        RunHistory.read(tmp_path)


def test_an_empty_directory_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"mission\.toml"):
        RunHistory.read(tmp_path)
