"""The process table and the commands made from it."""

import sys
from pathlib import Path

import msgspec
import pytest

from agents.mission.mission import FusionTable, Mission, RestartTable
from agents.swarm.processes import PROCESSES, Launch, commands

MISSION = msgspec.convert(
    {
        "name": "m",
        "area": {"min": [0, 0], "max": [1, 1]},
        "world": {"kind": "w"},
        "filter": {"kind": "f"},
        "planner": {"kind": "p"},
        "robots": [
            {"id": robot, "start": [0, 0], "vehicle": {"kind": "v"}, "sensor": {"kind": "s"}}
            for robot in ("r1", "r2")
        ],
    },
    Mission,
)
LAUNCH = Launch(Path("run/mission.toml"), Path("run"), ("tcp/127.0.0.1:1", "tcp/127.0.0.1:2"), 2.0, "spawn")


def test_a_swarm_is_the_viewer_one_process_per_robot_and_then_the_fusion_which_starts_the_clock() -> None:
    assert [(c.name, c.role, c.after) for c in commands(MISSION, LAUNCH)] == [
        ("watch", "watch", ""),
        ("r1", "robot", ""),
        ("r2", "robot", ""),
        ("fusion", "fusion", "watch"),
    ]


def test_a_command_is_what_a_person_would_type() -> None:
    watch, robot, _, fusion = commands(MISSION, LAUNCH)
    connect = ("--connect", "tcp/127.0.0.1:1", "--connect", "tcp/127.0.0.1:2")
    prefix = (sys.executable, "-P", "-m", "agents.cli")
    assert robot.argv == (*prefix, "robot", "run/mission.toml", "--id", "r1", "--out", "run", *connect)
    assert fusion.argv == (
        *(*prefix, "fusion", "run/mission.toml", "--id", "fusion", "--out", "run", *connect),
        *("--speed", "2"),
    )
    assert watch.argv[4:] == ("watch", "run/mission.toml", "--out", "run", *connect, "--view", "spawn")


def test_a_mission_with_replicas_has_as_many_fusions() -> None:
    mission = msgspec.structs.replace(MISSION, fusion=FusionTable(replicas=3))
    assert [c.name for c in commands(mission, LAUNCH) if c.role == "fusion"] == [
        "fusion",
        "fusion-2",
        "fusion-3",
    ]


@pytest.mark.parametrize("robot", ["never", "always"])
def test_restarts_are_as_the_mission_says(robot: str) -> None:
    table = msgspec.convert({"robot": robot, "fusion": "never"}, RestartTable)
    made = commands(msgspec.structs.replace(MISSION, restart=table), LAUNCH)
    assert {c.role: c.restart for c in made} == {"fusion": "never", "watch": "never", "robot": robot}


def test_every_role_of_the_table_is_a_verb_and_named_once() -> None:
    roles = [row.role for row in PROCESSES]
    assert len(set(roles)) == len(roles)
