"""The whole team as real processes over a real network."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

MISSION = """
name = "small"
seed = 3
duration_s = {duration}
match_m = 3.0
restart = {{ robot = "{restart}" }}

[area]
min = [0, 0]
max = [120, 120]

[world]
kind = "uniform"
targets = 4
spacing_m = 20.0

[filter]
kind = "smc_phd"
particles = 2000
expected_targets = 4.0

[found]
radius_m = 0.8
mass = 0.8
gate_m = 5.0

[exploration]
points = [13, 13]

[planner]
kind = "maasi"
candidates = {{ low = [15, 15], high = [105, 105], points = [4, 4] }}

[settings]
separation_m = 3.0
"""
ROBOT = """
[[robots]]
id = "r{i}"
start = [{x}, {y}, {z}]
vehicle = {{ kind = "quadrotor", speed_m_s = 10.0, acceleration_m_s2 = 5.0 }}

[robots.sensor]
kind = "range_bearing"
period_s = 1.0
reach_m = [15, 15]
range_sigma_m = 0.7
bearing_sigma_deg = 0.5
"""
STARTS = [(5, 5, 5), (115, 5, 10), (115, 115, 15)]

pytestmark = pytest.mark.processes


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    return write_mission(tmp_path)


def write_mission(directory: Path, *, duration: float = 120, restart: str = "never", robots: int = 3) -> Path:
    text = MISSION.format(duration=duration, restart=restart)
    for i, (x, y, z) in enumerate(STARTS[:robots]):
        text += ROBOT.format(i=i + 1, x=x, y=y, z=z)
    path = directory / "small.toml"
    path.write_text(text)
    return path


def command(mission: Path, out: Path, *options: str) -> list[str]:
    return [
        sys.executable,
        "-m",
        "agents.cli",
        "swarm",
        str(mission),
        "--out",
        str(out),
        "--view",
        "none",
        *options,
    ]


@contextmanager
def launched(mission: Path, out: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """A running swarm that is surely gone afterwards."""
    process = subprocess.Popen(
        command(mission, out, *options), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        yield process
    finally:
        for member in family(process.pid):
            member.kill()
        process.kill()
        process.wait(10)


def family(pid: int) -> list[psutil.Process]:
    try:
        return psutil.Process(pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return []


def of_run(out: Path) -> list[psutil.Process]:
    """All processes that work for a run, whoever their parent is."""
    members = []
    for process in psutil.process_iter(["cmdline", "status"]):
        line = process.info["cmdline"] or []
        if str(out / "mission.toml") in line and process.info["status"] != psutil.STATUS_ZOMBIE:
            members.append(process)
    return members


def robot(out: Path, name: str) -> psutil.Process:
    (found,) = [p for p in of_run(out) if name in p.cmdline()]
    return found


def wait_for(condition: object, seconds: float, what: str) -> None:
    assert callable(condition)
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"{what} did not happen within {seconds} s"
        time.sleep(0.05)


def started(out: Path) -> bool:
    logs = list(out.glob("r*.log"))
    return bool(logs) and all("joined as boot" in log.read_text() for log in logs)


def summary_of(out: Path) -> dict[str, object]:
    result: dict[str, object] = json.loads((out / "summary.json").read_text())
    return result


def test_a_team_of_processes_finds_every_target_and_keeps_its_records(mission: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    # All is found within seconds: it is recorded since what starts the clock waits for the viewer.
    ended = subprocess.run(
        command(mission, out, "--speed", "5"), capture_output=True, text=True, timeout=110, check=False
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "4 of 4 targets found" in ended.stdout
    summary = summary_of(out)
    assert summary["driver"] == "processes"
    assert summary["all_found"] is True
    assert summary["false_found"] == 0
    messages = summary["messages"]
    assert isinstance(messages, dict)
    assert messages["rejected"] == 0
    assert messages["lost"] == 0
    names = {path.name for path in out.iterdir()}
    assert {"mission.toml", "summary.json", "ledger.sqlite", "view.rrd", "fusion.log", "r1.log"} <= names
    assert (out / "view.rrd").stat().st_size > 10_000
    assert not of_run(out)


def test_a_killed_robot_is_told_of_and_the_others_find_all_targets(mission: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    with launched(mission, out, "--speed", "2") as swarm:
        wait_for(lambda: started(out), 60, "the start")
        time.sleep(0.5)
        robot(out, "r2").kill()
        output, _ = swarm.communicate(timeout=100)
    assert swarm.returncode == 0, output
    assert "r2 died (SIGKILL)" in output
    assert "r2 is gone" in (out / "fusion.log").read_text()
    assert summary_of(out)["all_found"] is True


def test_a_killed_robot_is_started_again_if_the_mission_says_so(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, restart="always")
    out = tmp_path / "run"
    with launched(mission, out, "--speed", "1") as swarm:
        wait_for(lambda: started(out), 60, "the start")
        first = robot(out, "r2")
        first.kill()
        log = out / "r2.log"
        wait_for(lambda: log.read_text().count("joined as boot") == 2, 60, "the second boot")
        swarm.send_signal(signal.SIGTERM)
        swarm.communicate(timeout=20)
    boots = {line.split()[-1] for line in log.read_text().splitlines() if "joined as boot" in line}
    assert len(boots) == 2


def test_a_killed_fusion_goes_on_with_its_ledger(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, duration=300)
    out = tmp_path / "run"
    with launched(mission, out, "--speed", "1") as swarm:
        wait_for(lambda: started(out), 60, "the start")
        time.sleep(2.0)
        robot(out, "fusion").kill()
        output, _ = swarm.communicate(timeout=110)
    assert swarm.returncode == 0, output
    assert "goes on with a ledger of" in (out / "fusion.log").read_text()
    summary = summary_of(out)
    assert summary["all_found"] is True
    messages = summary["messages"]
    assert isinstance(messages, dict)
    assert messages["sets_not_applied"] == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_ended_swarm_leaves_its_summary_and_no_process(mission: Path, tmp_path: Path, number: int) -> None:
    out = tmp_path / "run"
    with launched(mission, out) as swarm:
        wait_for(lambda: started(out), 60, "the start")
        swarm.send_signal(number)
        swarm.communicate(timeout=20)
        assert not of_run(out)
    assert swarm.returncode == 1
    assert summary_of(out)["all_found"] is False


def test_a_swarm_killed_by_sigkill_leaves_no_orphan(mission: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    with launched(mission, out) as swarm:
        wait_for(lambda: started(out), 60, "the start")
        os.kill(swarm.pid, signal.SIGKILL)
        swarm.wait(10)
        wait_for(lambda: not of_run(out), 20, "the end of all children")


def test_a_second_run_into_the_same_directory_is_refused(mission: Path, tmp_path: Path) -> None:
    (tmp_path / "ledger.sqlite").touch()
    ended = subprocess.run(
        command(mission, tmp_path), capture_output=True, text=True, timeout=60, check=False
    )
    assert ended.returncode == 5
    assert "holds another run" in ended.stderr
    assert "Traceback" not in ended.stderr
