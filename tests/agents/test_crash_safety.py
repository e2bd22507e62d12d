"""SIGKILL at named points: nothing acknowledged is lost, nothing counts twice, and the bits are the same."""

import hashlib
import json
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from agents.wire.messages import LedgerEntry
from tests.agents.dying_fusion import POINTS, disturbed
from tests.agents.ledger_story import Stage, story, team

pytestmark = pytest.mark.processes


def entries() -> list[LedgerEntry]:
    return [entry for entry in story() if entry.time < 25.0]


def lives(directory: Path, *deaths: str) -> dict[str, Any]:
    (directory / "story").write_bytes(pickle.dumps(entries()))
    files = [str(directory / "ledger.sqlite"), str(directory / "story")]
    program = [sys.executable, "-m", "tests.agents.dying_fusion", *files, *deaths]
    ended = subprocess.run(program, capture_output=True, text=True, timeout=110, check=False)
    assert ended.returncode == 0, ended.stderr
    told: dict[str, Any] = json.loads(ended.stdout)
    return told


def test_a_fusion_killed_at_every_named_point_comes_to_the_same_bits(tmp_path: Path) -> None:
    undisturbed = Stage(team())
    undisturbed.hear(entries())
    deaths = [
        f"{point}:{2 if point == 'while settling' else 5 + i % 3}"
        for i, point in enumerate(POINTS)
        if "checkpoint" not in point
    ]
    deaths += [f"{point}:1" for point in POINTS if "checkpoint" in point]
    told = lives(tmp_path, *deaths)
    assert told["deaths"] == [9] * len(deaths), "some life did not come to its point"
    assert told["restored"] > 20
    assert told["sets"] == told["stored"] == told["unique"] == len(entries())
    assert told["posterior"] == hashlib.sha256(undisturbed.posterior()).hexdigest()


def test_the_disturbance_is_one() -> None:
    """Late sets go beyond the window, so that there is something on its way to be killed on."""
    stage = Stage(team())
    settled = 0
    for entry in disturbed(entries()):
        stage.hear([entry])
        settled += stage.fusion.estimate.settling
    assert settled > 1
