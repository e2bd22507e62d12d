"""What a team rehearses before it starts is all that it does later: nothing is loaded in flight."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.agents.swarm.test_swarm import write_mission

ROOT = Path(__file__).parents[3]

# To load one kernel from the disk touches the whole compiler: 50 MB of a robot and 20 ms of its time.
PROGRAM = """
import sys
from numba.core.caching import Cache
from agents.mission.mission_file import load
from agents.process.rehearsal import rehearse_fusion, rehearse_robot
from agents.team import Team
from sim.engine.engine import Engine

mission = load(sys.argv[1])
team = Team.of(mission)
for robot in {(str(r.vehicle), str(r.sensor)): r.id for r in mission.robots}.values():
    rehearse_robot(team, robot)
rehearse_fusion(team)
loaded, load_overload = [], Cache.load_overload
def recorded(self, signature, context):
    if "_partners" not in self._name:  # GOSPA, which the launcher counts and no robot
        loaded.append(f"{self._name} {signature}")
    return load_overload(self, signature, context)
Cache.load_overload = recorded
engine = Engine(team, 5)
engine.run()
print(*loaded, sep="\\n", end="")
"""


def loaded_in_flight(mission: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, mission],
        env=os.environ,
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_small_team_loads_no_kernel_after_its_rehearsal(tmp_path: Path) -> None:
    assert loaded_in_flight(write_mission(tmp_path)) == ""


@pytest.mark.parametrize("name", ["quickstart", "tasks", "walls", "crossing", "mavlink_mixed"])
def test_a_mission_loads_no_kernel_after_its_rehearsal(name: str) -> None:
    assert loaded_in_flight(ROOT / "missions" / f"{name}.toml") == ""
