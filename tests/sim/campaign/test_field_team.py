"""Real processes under real signals, one run for all of them: they are slow to start."""

import socket
from pathlib import Path

import msgspec
import pytest

from agents.invariants import check
from agents.invariants.sets import acknowledged, taken
from agents.mission.mission_file import load
from sim.campaign.field_team import FieldTeam

pytestmark = [pytest.mark.processes, pytest.mark.timeout(180)]

PATIENCE_S = 60.0  # of whoever waits for a process; never how long something may take


def free_endpoint() -> str:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"tcp/127.0.0.1:{server.getsockname()[1]}"


def test_killed_stopped_and_cut_off_processes_lose_nothing_and_repeat_nothing(tmp_path: Path) -> None:
    mission = load("campaign")
    planner = {"kind": "maasi", "candidates": {"low": [15, 15], "high": [85, 85], "points": [3, 3]}}
    mission = msgspec.structs.replace(mission, robots=mission.robots[:2], duration_s=600.0, planner=planner)
    with FieldTeam(mission, tmp_path / "run", free_endpoint()) as team:
        for name in ("router", "fusion", "r1", "r2", "watch"):
            team.start(name)
        team.listen()
        everybody = ("fusion", "r1", "r2")
        assert team.until(lambda: team.now() > 0.0 and team.present((*everybody, "watch")), PATIENCE_S)
        team.stop("watch")  # frozen to the end
        team.for_(1.5)

        team.stop("r2")
        team.for_(2.5)  # beyond the lease
        team.go_on("r2")
        assert team.until(lambda: team.present(everybody), PATIENCE_S)

        team.kill("fusion")
        team.kill("r1")
        team.start("fusion")
        team.start("r1")
        assert team.until(lambda: not team.present(everybody), PATIENCE_S)
        assert team.until(lambda: team.present(everybody), PATIENCE_S)

        team.kill("router")
        team.for_(1.5)
        team.start("router")
        assert team.until(lambda: team.present(everybody), PATIENCE_S)
        team.router_is_back()

        def all_in() -> bool:
            """Everything that was said before now is acknowledged: nothing waits for ever."""
            known = acknowledged(team.history)["fusion"]
            return all(i in known for i, (at, _) in taken(team.history).items() if at < now)

        now = team.now()
        assert team.until(all_in, PATIENCE_S)
        history = team.finish()
    report = check(history)
    assert not report.violations, report.violations[0]
    assert report.counts["sets in time"] > 10
    assert report.counts["starts of processes"] == 5
    assert report.counts["posteriors replayed"] == 1
    boots = {fact.boot for fact in history.facts if fact.what == "up" and fact.who == "r1"}
    assert len(boots) == 2
