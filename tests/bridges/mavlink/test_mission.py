"""A search mission with autopilots in it, as a user starts it: real processes, simulated vehicles."""

import subprocess
from pathlib import Path

import pytest

from tests.agents.swarm.test_swarm import command, summary_of
from tests.bridges.mavlink.fleet import STARTS, copters, write_mission

pytestmark = pytest.mark.processes


def test_two_copters_of_two_autopilots_find_all_targets_and_land(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with copters("ardupilot", "px4") as fleet:
        mission = write_mission(tmp_path, fleet)
        ended = subprocess.run(
            command(mission, out), capture_output=True, text=True, timeout=110, check=False
        )
        logs = "".join(path.read_text() for path in out.glob("r?.log"))
        assert ended.returncode == 0, ended.stdout + ended.stderr + logs
        summary = summary_of(out)
        assert summary["all_found"]
        vehicles = summary["vehicles"]
        assert isinstance(vehicles, dict)
        assert set(vehicles) == {"r1", "r2"}
        assert sum(vehicle["waypoints"] for vehicle in vehicles.values()) > 0, (vehicles, logs)
        for robot, vehicle in vehicles.items():
            assert not vehicle["waypoints"] or vehicle["waypoint_worst_m"] < 1.0, (robot, vehicle)
            assert "3D fix, EKF good, link 100%" in vehicle["words"]
            assert "does not show" not in logs
        for robot, served in fleet.items():
            # Nothing is left flying unattended: they come down by themselves, with nobody on the link.
            assert served.ask(lambda autopilot: autopilot.mode) == "LAND", (robot, logs)
            low = STARTS[robot][2] - 2.0
            assert served.wait_for(lambda autopilot, low=low: -autopilot.body.position[2] < low, 20.0), robot


def test_a_mission_that_one_vehicle_cannot_fly_is_not_begun_by_any(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with copters("ardupilot", "px4") as fleet:
        mission = write_mission(tmp_path, fleet, more={"r2": 'body = "rover"'})
        ended = subprocess.run(command(mission, out), capture_output=True, text=True, timeout=60, check=False)
        assert ended.returncode == 3, ended.stdout + ended.stderr
        assert "system 2 is a copter, but the mission expects a rover" in ended.stderr
        for served in fleet.values():
            assert not served.ask(lambda autopilot: autopilot.armed)
            assert served.ask(lambda autopilot: autopilot.body.on_ground)
