"""The process table: which processes a team has, in which order they start, and what follows a death.

`searchparty swarm` starts what this table says, and starts it with the same commands that a person types on
the hosts of a team in the field.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from agents.mission.mission import Mission

Restart = Literal["never", "always"]

# -P: a file of the user's called sim.py or planner.py in the working directory is none of our packages.
PROGRAM = (sys.executable, "-P", "-m", "agents.cli")  # `searchparty`, wherever it is installed


@dataclass(frozen=True, slots=True)
class Process:
    """One row of the table. The rows stand in the order in which they are started."""

    role: str  # also the verb of the command line
    per_member: bool  # one for each robot or fusion of the mission, named by its id; else one, as its role
    restart: Restart | Literal["as the mission says"]  # mission.restart.ROLE
    options: tuple[str, ...]  # which of the launch's values go on its command line
    forked: bool = True  # from what robots and the fusion have loaded; else it starts by itself
    after: str = ""  # the role that is waited for, a while, until it is in the team


PROCESSES = (
    # A dead viewer costs the picture, a restarted one would write over the record of the start. It loads what
    # no robot may, which takes longest: so it comes first.
    Process("watch", False, "never", ("out", "connect", "view"), forked=False),
    Process("robot", True, "as the mission says", ("id", "out", "connect")),
    # It starts the team's clock, once somebody watches: a short run would else be over before it is recorded.
    Process("fusion", True, "as the mission says", ("id", "out", "connect", "speed"), after="watch"),
)


@dataclass(frozen=True, slots=True)
class Launch:
    """What a launcher knows of this run and the mission file does not."""

    mission_file: Path  # the resolved one, in the run directory; holds the seed
    out: Path
    endpoints: tuple[str, ...]
    speed: float = 1.0
    view: str = "none"


@dataclass(frozen=True, slots=True)
class Command:
    """A process to run."""

    name: str  # unique in the team; names the log file
    role: str
    argv: tuple[str, ...]
    restart: Restart
    forked: bool = False
    after: str = ""

    @property
    def arguments(self) -> tuple[str, ...]:
        """What follows `searchparty` on the command line."""
        return self.argv[len(PROGRAM) :]


def commands(mission: Mission, launch: Launch) -> list[Command]:
    """The processes of a mission's local swarm, in start order."""
    made: list[Command] = []
    for row in PROCESSES:
        restart: Restart = (
            row.restart if row.restart != "as the mission says" else _restart(mission, row.role)
        )
        members = {"robot": [robot.id for robot in mission.robots], "fusion": mission.fusions()}
        names = members[row.role] if row.per_member else [row.role]
        made += [
            Command(name, row.role, _argv(row, name, launch), restart, row.forked, row.after)
            for name in names
        ]
    return made


def _restart(mission: Mission, role: str) -> Restart:
    restart: Restart = getattr(mission.restart, role)
    return restart


def _argv(row: Process, name: str, launch: Launch) -> tuple[str, ...]:
    values = {
        "id": [name],
        "out": [str(launch.out)],
        "connect": list(launch.endpoints),
        "speed": [f"{launch.speed:g}"],
        "view": [launch.view],
    }
    options = [part for option in row.options for value in values[option] for part in (f"--{option}", value)]
    return (*PROGRAM, row.role, str(launch.mission_file), *options)
