"""Warming up calls every kernel once, and is silent when there was nothing to compile."""

import io
import pickle
from functools import partial
from pathlib import Path

import pytest
from rich.console import Console

from agents.mission.mission_file import load
from agents.process import warm


def leave(path: Path) -> None:
    """Called in other processes, so what it did must be seen on the disk."""
    with path.open("a") as file:
        file.write("once\n")


def fail() -> None:
    raise ValueError("no such kernel")


def test_every_kernel_is_called_once_and_nothing_is_said_when_it_was_quick(tmp_path: Path) -> None:
    text = io.StringIO()
    warm.run(Console(file=text), lambda: [(name, partial(leave, tmp_path / name)) for name in "abcde"], 2)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == dict.fromkeys("abcde", "once\n")
    assert text.getvalue() == ""


def test_a_kernel_that_cannot_be_compiled_is_told() -> None:
    with pytest.raises(ValueError, match="no such kernel"):
        warm.run(Console(file=io.StringIO()), lambda: [("good", print), ("bad", fail)], 2)


def test_every_real_warm_up_can_be_handed_to_another_process() -> None:
    # CI once failed on a lambda here: on a developer's machine a stamp spared the calls, so nobody saw it.
    calls = [*warm.warmups(), *warm.mission_warmups(load("quickstart"))]
    assert len({name for name, _ in calls}) == len(calls) > 30
    for name, call in calls:
        assert pickle.loads(pickle.dumps(call)), name


def test_a_mission_needs_its_own_kernels_only_and_another_seed_needs_no_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    found: list[list[str]] = []
    monkeypatch.setattr(warm, "run", lambda console, find: found.append([name for name, _ in find()]))
    console = Console(file=io.StringIO())
    for seed in (1, 2):
        warm.ensure(console, load("quickstart", seed=seed))
    assert found == [["robot r4", "fusion"]]  # one robot stands for its like
    warm.ensure(console, load("asi_3d"))
    assert len(found) == 2


def test_a_slow_warm_up_says_what_it_did(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warm, "QUIET_S", -1.0)
    text = io.StringIO()
    warm.run(Console(file=text), lambda: [("phd", list), ("kmeans", list)])
    assert "kernels ready after 0 s" in text.getvalue()


def test_a_stamp_spares_the_second_start_the_loading(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    runs: list[Console] = []
    monkeypatch.setattr(warm, "run", lambda console, find: runs.append(console))
    console = Console(file=io.StringIO())
    warm.ensure(console)
    warm.ensure(console)
    assert len(runs) == 1
    for stamp in tmp_path.glob("*.warm"):
        stamp.unlink()
    warm.ensure(console)
    assert len(runs) == 2
