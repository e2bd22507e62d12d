"""`searchparty observe` against a real team, and what it says where that makes no sense."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from agents.ledger.ledger import Ledger
from agents.wire.messages import SoftObservationMessage
from tests.agents.swarm.test_swarm import launched, started, wait_for, write_mission


def observe(mission: Path, *arguments: str, endpoint: str = "tcp/127.0.0.1:1") -> tuple[int, str]:
    ended = subprocess.run(
        [sys.executable, "-m", "agents.cli", "observe", str(mission), *arguments, "--connect", endpoint],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=60,
    )
    return ended.returncode, ended.stdout


def listening_mission(directory: Path) -> Path:
    path = write_mission(directory, duration=300, robots=1)
    text = path.read_text()
    text = text.replace('kind = "smc_phd"\nparticles = 2000\nexpected_targets = 4.0', 'kind = "mixtures"')
    path.write_text(text)
    return path


@pytest.mark.processes
def test_a_running_team_takes_a_statement_once_and_refuses_another_with_its_reason(tmp_path: Path) -> None:
    mission, out = listening_mission(tmp_path), tmp_path / "run"
    with launched(mission, out) as swarm:
        wait_for(lambda: started(out), 60, "the start")
        (endpoint,) = set(re.findall(r"tcp/127\.0\.0\.1:\d+", (out / "fusion.log").read_text()))
        status, text = observe(out / "mission.toml", "near", "--at", "60,60", endpoint=endpoint)
        assert status == 0, text
        assert "taken: operator says: something is near (60, 60), within 10 m" in text
        status, text = observe(
            out / "mission.toml", "near", "--at", "60,60", "--target", "cone 3", endpoint=endpoint
        )
        assert status == 1, text
        assert "expected one of those not found yet" in text
        swarm.terminate()
        swarm.wait(20)
    with Ledger(out / "ledger.sqlite") as ledger:
        kept = [entry for entry in ledger.replay("searchparty") if isinstance(entry, SoftObservationMessage)]
    assert [(entry.relation, entry.sequence) for entry in kept] == [("near", 0)]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("near",), "at: "),
        (("beside", "--at", "1,2"), "relation: "),
        (("near", "--at", "1;2"), "--at: "),
        (("near", "--at", "nan,2"), "at"),
        (("near", "--at", "1,2", "--at", "3,4"), "allowed are 1"),
        (("around", "--at", "1,2", "--radius", "9", "--outer", "5"), "outer_m"),
        (("inside", "--at", "0,0", "--at", "9,9", "--at", "9,0", "--at", "0,9"), "corners"),
        (("near", "--at", "1,2", "--slope", "0"), "slope"),
        (("near", "--at", "1,2", "--as", "r1"), "--as"),
    ],
)
def test_what_makes_no_sense_is_told_before_anything_is_sent(
    tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    status, text = observe(listening_mission(tmp_path), *arguments)
    assert status == 2, text
    assert words in text
    assert "Traceback" not in text


def test_a_filter_that_takes_no_statements_and_a_network_that_is_not_there_are_named(tmp_path: Path) -> None:
    mission = listening_mission(tmp_path)
    status, text = observe(mission, "near", "--at", "1,2")
    assert status == 3, text
    mission.write_text(mission.read_text().replace('kind = "mixtures"', 'kind = "lmb"'))
    status, text = observe(mission, "near", "--at", "1,2")
    assert status == 2, text
    assert "takes no soft observations" in text
