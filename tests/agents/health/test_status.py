"""A guarded team of real processes: loopback only, its health from outside, no second process of one id."""

import json
import re
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import psutil
import pytest

from agents import cli
from agents.errors import LinkError
from agents.mission.mission_file import load
from bridges.keys.workshop import Workshop
from bridges.zenoh.local_router import Router
from tests.agents.swarm.test_swarm import family, launched, of_run, robot, started, wait_for, write_mission

pytestmark = pytest.mark.processes


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "agents.cli", *arguments]


def said(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*arguments), capture_output=True, text=True, timeout=60, check=False)


def write_guarded(directory: Path) -> Path:
    """The small mission, with keys of its own."""
    path = write_mission(directory, duration=300)
    text = path.read_text().replace("[area]", '[link]\nkeys = "keys"\nlease_s = 1.0\n\n[area]')
    path.write_text(f"stop_when_all_found = false\n{text}")
    workshop = Workshop.open(directory / "keys", load(path), datetime.now(UTC), 30.0)
    workshop.issue([])
    workshop.write()
    return path


def test_a_guarded_swarm_is_healthy_closed_to_the_outside_and_keeps_ids_apart(tmp_path: Path) -> None:
    mission, out = write_guarded(tmp_path), tmp_path / "run"
    with launched(mission, out) as swarm:
        wait_for(lambda: started(out), 60, "the start")
        endpoint = re.findall(r"tls/127\.0\.0\.1:\d+", (out / "fusion.log").read_text())[0]
        here = (str(out / "mission.toml"), "--connect", endpoint)

        members = [psutil.Process(swarm.pid), *family(swarm.pid)]
        sockets = [s for p in members for s in p.net_connections("inet") if s.status == psutil.CONN_LISTEN]
        assert [s.laddr.port for s in sockets] == [int(endpoint.rpartition(":")[2])]
        assert {s.laddr.ip for s in sockets} == {"127.0.0.1"}
        open_ends = [s for p in members for s in p.net_connections("inet") if s.laddr]
        assert {s.laddr.ip for s in open_ends} == {"127.0.0.1"}

        second = subprocess.Popen(command("robot", *here, "--id", "r1"), stderr=subprocess.PIPE, text=True)
        well = said("status", *here, "--json")
        if well.returncode == 1:  # a machine that others keep busy may starve a robot for a while
            well = said("status", *here, "--json", "--seconds", "8")
        assert well.stderr == ""
        report = json.loads(well.stdout)
        assert (report["problems"], well.returncode) == ([], 0)
        robots = {p["id"]: p for p in report["processes"] if p["role"] == "robot"}
        assert set(robots) == {"r1", "r2", "r3"}
        assert robots["r1"]["topics"]["pose"]["rate_ok"] is True
        assert robots["r1"]["memory_mb"] > 50.0
        assert robots["r1"]["clock"]["error_ms"] < 1000.0
        assert len(robots["r1"]["boots"]) == 1
        _, complaint = second.communicate(timeout=30)
        assert second.returncode == 6
        assert "another process of the team is robot r1 already" in complaint.strip().splitlines()[-1]

        for process in [robot(out, "r2"), *(p for p in of_run(out) if "fusion" in p.cmdline())]:
            process.suspend()
        time.sleep(1.5)  # beyond the lease
        ill = said("status", *here)
        assert ill.returncode == 1
        assert "robot r2 is not there" in ill.stdout
        assert "no fusion is alive" in ill.stdout
        assert max(map(len, ill.stdout.splitlines())) <= 100


def test_nobody_there_is_one_sentence(tmp_path: Path) -> None:
    mission = write_mission(tmp_path)
    router = Router(load(mission).link)
    with router, pytest.raises(LinkError, match=r"nobody of the team searchparty is at tcp/127\.0\.0\.1:"):
        cli.app(
            ["status", str(mission), "--connect", router.endpoint, "--seconds", "1"], standalone_mode=False
        )
