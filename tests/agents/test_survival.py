"""Real processes on a real network, some of which are killed: no set is lost, and targets are still found."""

import signal
import time
from pathlib import Path

import psutil
import pytest

from agents.ledger.ledger import Ledger
from agents.robot.outbox import Outbox
from tests.agents.swarm.test_swarm import (
    launched,
    of_run,
    robot,
    started,
    summary_of,
    wait_for,
    write_mission,
)

pytestmark = pytest.mark.processes


def fusion_of(out: Path, name: str) -> psutil.Process:
    (found,) = [p for p in of_run(out) if _id(p) == name]
    return found


def _id(process: psutil.Process) -> str:
    words = process.cmdline()
    return words[words.index("--id") + 1] if "fusion" in words and "--id" in words else ""


def edited(path: Path, *changes: tuple[str, str]) -> Path:
    text = path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return path


def test_two_fusions_of_which_one_is_killed_and_a_killed_robot_lose_no_set(tmp_path: Path) -> None:
    mission = edited(
        write_mission(tmp_path, duration=600, restart="always"),
        ("seed = 3", "seed = 3\nstop_when_all_found = false"),
        ("[settings]", "[fusion]\nreplicas = 2\n\n[settings]"),
    )
    out = tmp_path / "run"
    with launched(mission, out, "--speed", "2") as swarm:
        wait_for(lambda: started(out), 60, "the start")
        time.sleep(1.5)
        fusion_of(out, "fusion").kill()
        time.sleep(0.2)
        robot(out, "r2").kill()
        said = {name: out / f"{name}.log" for name in ("r2", "fusion", "fusion-2")}
        wait_for(lambda: said["r2"].read_text().count("joined as boot") == 2, 60, "the second boot")
        wait_for(lambda: "goes on with a ledger of" in said["fusion"].read_text(), 60, "the fusion")
        time.sleep(6.0)
        swarm.send_signal(signal.SIGTERM)
        output, _ = swarm.communicate(timeout=20)
    assert "fusion died (SIGKILL); will be started again" in output
    assert "joins the team that fusion has started" in said["fusion-2"].read_text()
    with Ledger(out / "ledger.sqlite", read_only=True) as ledger:
        settled = max(row.capture_time for row in ledger.rows()) - 5.0  # the last may have reached one of two
    held = []
    for name in ("ledger.sqlite", "ledger-fusion-2.sqlite"):
        with Ledger(out / name, read_only=True) as ledger:
            rows = [row for row in ledger.rows() if row.capture_time < settled]
            held.append(sorted((row.robot, row.boot, row.sequence, row.message) for row in rows))
    assert held[0] == held[1]
    boots = {(who, boot) for who, boot, _, _ in held[0]}
    assert len(boots) == 4  # r2 has two
    for stream in boots:
        numbers = [n for who, boot, n, _ in held[0] if (who, boot) == stream]
        assert numbers == list(range(len(numbers))), f"{stream} has gaps"


def test_robots_find_all_targets_after_the_only_fusion_is_killed_for_good(tmp_path: Path) -> None:
    mission = edited(
        write_mission(tmp_path, duration=120),
        ('restart = { robot = "never" }', 'restart = { fusion = "never" }'),
    )
    out = tmp_path / "run"
    with launched(mission, out, "--speed", "2") as swarm:
        wait_for(lambda: started(out), 60, "the start")
        robot(out, "fusion").kill()
        output, _ = swarm.communicate(timeout=100)
    assert swarm.returncode == 0, output
    assert "fusion died (SIGKILL); the others go on" in output
    assert "no fusion: as r" in output
    summary = summary_of(out)
    assert summary["all_found"] is True
    assert str(summary["estimate_of"]).startswith("r")
    memory = summary["memory_mb"]
    assert isinstance(memory, dict)
    assert max(mb for who, mb in memory.items() if who.startswith("robot")) < 200
    with Outbox(out / "r1.outbox", team="searchparty", robot="r1", run="a later one") as outbox:
        assert outbox.put_aside is not None  # what waited for a fusion is not thrown away
