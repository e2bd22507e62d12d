"""A robot process whose sensor is the example detector of docs/mavlink.md finds what that sees."""

import json
import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from agents.clock import VirtualClock
from agents.machine import Action, Publish
from agents.mission.mission import Mission
from agents.mission.mission_file import load
from agents.robot.body import RobotBody
from agents.robot.plan_request import RobotSetup
from agents.robot.robot import Robot
from agents.team import Team
from agents.wire.messages import MeasurementSetMessage

ROOT = Path(__file__).resolve().parents[3]
MISSION = """
name = "detector"
seed = 1
duration_s = 40
area = { min = [0, 0], max = [40, 40] }
world = { kind = "fixed", positions = [[18, 10]] }
filter = { kind = "smc_phd", particles = 2000, expected_targets = 2.0 }
found = { radius_m = 1.5, mass = 0.6 }
planner = { kind = "maasi", candidates = { low = [6, 10], high = [6.1, 10.1], points = [2, 2] } }
[[robots]]
id = "r1"
start = [6, 10, 5]
vehicle = { kind = "point_mass", speed_m_s = 0.5 }
[robots.sensor]
kind = "udp_detections"
port = %d
[robots.sensor.model]
kind = "range_bearing"
period_s = 0.2
range_sigma_m = 0.5
bearing_sigma_deg = 3.0
gain = 0.95
reach_m = [50, 50]
"""


def example() -> str:
    """The sender of the docs, as it stands there."""
    page = (ROOT / "docs" / "mavlink.md").read_text()
    found = re.search(r"```python\n(.*?)```", page, re.DOTALL)
    assert found is not None
    return found[1]


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def mission(tmp_path: Path, port: int) -> Mission:
    path = tmp_path / "detector.toml"
    path.write_text(MISSION % port)
    return load(str(path))


def test_the_example_is_as_short_as_it_says_and_sees_one_thing() -> None:
    text = example()
    assert len(text.splitlines()) <= 30
    assert "[[12.0, 0.0]]" in text  # 12 m ahead: what the mission below has there


def test_sets_of_a_robot_s_detector_are_published_with_their_capture_time(
    mission: Mission, port: int
) -> None:
    team, clock = Team.of(mission), VirtualClock()
    world = team.world(1)
    sensor = team.listen("r1", 1, world, now=0.0, speed=1.0)
    assert sensor is not None
    sent: list[MeasurementSetMessage] = []

    def perform(action: Action) -> None:
        if isinstance(action, Publish) and isinstance(action.message, MeasurementSetMessage):
            sent.append(action.message)

    setup = RobotSetup(
        mission=mission,
        robot="r1",
        boot="b1",
        vehicle=team.vehicle_models["r1"],
        sensors=team.sensor_models,
        periods=team.measure_periods,
        area=team.area,
    )
    body = RobotBody(Robot(setup, 0.0), team.vehicle("r1", 1, world), sensor, clock, perform)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        for tick in range(100):
            clock.advance_to(0.1 * tick)
            if tick == 50:
                peer.sendto(_packed({"v": 1, "age_s": 1.3, "z": [[12.0, 0.0]]}), ("127.0.0.1", port))
                peer.sendto(b"rubbish", ("127.0.0.1", port))
                peer.sendto(_packed({"v": 1, "age_s": 1.0, "z": []}), ("127.0.0.1", port))
            body.step([])
    body.close()
    sets = {message.time: message for message in sent}  # they are offered again until somebody has them
    first, second = sets.values()  # and none for all the times when nothing came
    assert first.time == pytest.approx(5.0 - 1.3, abs=0.5)
    assert second.time - first.time == pytest.approx(0.3, abs=0.1)
    assert first.measurements.tolist() == [[12.0, 0.0]]
    assert second.measurements.shape == (0, 2)
    assert first.pose[:2] == pytest.approx(np.array([6.0, 10.0]), abs=0.1)
    assert sensor.counters()["detections.refused.not_msgpack"] == 1


def _packed(table: dict[str, object]) -> bytes:
    import msgpack

    return bytes(msgpack.packb(table))


@pytest.mark.processes
def test_a_team_finds_what_the_example_detector_sees(mission: Mission, port: int, tmp_path: Path) -> None:
    script = tmp_path / "detector.py"
    script.write_text(example())
    sender = subprocess.Popen([sys.executable, str(script), "127.0.0.1", str(port)])
    try:
        run = subprocess.run(
            [
                *(sys.executable, "-m", "agents", "swarm", str(tmp_path / "detector.toml")),
                *("--view", "none", "--out", str(tmp_path / "run")),
            ],
            capture_output=True,
            text=True,
            timeout=100.0,
            check=False,
        )
    finally:
        sender.kill()
        sender.wait()
    assert run.returncode == 0, run.stdout + run.stderr
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["targets_found"] == 1
    assert np.array(summary["found"][0]) == pytest.approx([18.0, 10.0], abs=1.0)
