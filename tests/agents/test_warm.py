"""Warming up calls every kernel once, and is silent when there was nothing to compile."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from agents import warm


def test_every_kernel_is_called_once_and_nothing_is_said_when_it_was_quick() -> None:
    called: list[str] = []
    text = io.StringIO()
    warm.run(Console(file=text), lambda: [(name, lambda name=name: called.append(name)) for name in "abc"])
    assert called == ["a", "b", "c"]
    assert text.getvalue() == ""


def test_a_slow_warm_up_says_what_it_did(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warm, "QUIET_S", -1.0)
    text = io.StringIO()
    warm.run(Console(file=text), lambda: [("phd", lambda: None), ("kmeans", lambda: None)])
    assert "2 kernels ready after 0 s" in text.getvalue()


def test_a_stamp_spares_the_second_start_the_loading(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    runs: list[Console] = []
    monkeypatch.setattr(warm, "run", runs.append)
    console = Console(file=io.StringIO())
    warm.ensure(console)
    warm.ensure(console)
    assert len(runs) == 1
    for stamp in tmp_path.glob("*.warm"):
        stamp.unlink()
    warm.ensure(console)
    assert len(runs) == 2
