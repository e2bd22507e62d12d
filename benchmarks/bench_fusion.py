"""A fusion that starts again, and one that takes in a set."""

import statistics
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import tomli_w

from agents.fusion.fusion import Fusion, FusionSetup
from agents.ledger.ledger import Ledger
from agents.ledger.snapshot import fingerprint
from agents.machine import Heard, Keep, Store
from agents.mission.mission import start_pose
from agents.mission.mission_file import load
from agents.seeds import generator
from agents.team import Team
from agents.wire.messages import MeasurementSetMessage
from agents.wire.topics import SET
from benchmarks import swarms

ROBOTS, SETS = 8, 10_000
STEPS = 300  # sets that come one by one
SPEED_M_S = 10.0


def _team(directory: Path) -> Team:
    file = directory / "mission.toml"
    file.write_text(tomli_w.dumps(swarms.mission(ROBOTS, 1500.0)))
    return Team.of(load(file))


def _fusion(team: Team, ledger: Ledger) -> Fusion:
    mission = team.mission
    mark = fingerprint(mission, 1, team.filter)
    return Fusion(FusionSetup(mission, "fusion", "b", team.search(), team.sensor_models, ledger, mark), 1)


def _sets(team: Team, count: int) -> list[MeasurementSetMessage]:
    """Robots at 1 Hz on straight ways through the area, that see the mission's targets."""
    truth = team.world(1).targets(0.0)
    rng = generator(1, "benchmark")
    poses = {robot.id: start_pose(robot) for robot in team.mission.robots}
    headings = {name: rng.uniform(0.0, 2.0 * np.pi) for name in poses}
    low, high = team.area.low, team.area.high
    made = []
    for i in range(count):
        name = list(poses)[i % len(poses)]
        pose = poses[name].copy()
        pose[:2] += SPEED_M_S * np.array([np.cos(headings[name]), np.sin(headings[name])])
        if (pose[:2] < low[:2]).any() or (pose[:2] > high[:2]).any():
            headings[name] = rng.uniform(0.0, 2.0 * np.pi)
            pose = poses[name].copy()
        poses[name] = pose
        measurements = team.sensor_models[name].sample(truth, pose, rng)
        made.append(
            MeasurementSetMessage(
                team=team.mission.team,
                sender=name,
                boot="b",
                sequence=i // len(poses),
                time=i / len(poses),
                pose=pose,
                measurements=measurements,
            )
        )
    return made


def _live(
    fusion: Fusion, ledger: Ledger, sets: list[MeasurementSetMessage], together: int = 1
) -> list[float]:
    """Apply and store one batch after the other; how long each took, ms."""
    times = []
    for i in range(0, len(sets), together):
        batch = sets[i : i + together]
        began = time.perf_counter()
        for action in fusion.step(batch[-1].time, [Heard(SET, one) for one in batch]):
            if isinstance(action, Store):
                ledger.store(action.entries, action.expired, action.revived)
            elif isinstance(action, Keep):
                ledger.keep(action.checkpoint, action.kept)
        times.append((time.perf_counter() - began) * 1e3)
    return times


@pytest.mark.figures("fusion_recovery_10000", "fusion_step")
def test_fusion_recovery_10000(benchmark: Any, quick: bool, tmp_path: Path) -> None:
    """From the open ledger of 10,000 sets to the posterior that the fusion had when it was killed."""
    team = _team(tmp_path)
    count = SETS // 10 if quick else SETS
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        fusion = _fusion(team, ledger)
        sets = _sets(team, count)
        _live(fusion, ledger, sets[:-STEPS], together=64)
        steps = _live(fusion, ledger, sets[-STEPS:])
        before = fusion._posterior()
    times: list[float] = []

    def recover() -> None:
        with Ledger(tmp_path / "ledger.sqlite") as ledger:
            began = time.perf_counter()
            again = _fusion(team, ledger)
            again.restore()
            after = again._posterior()
            times.append(time.perf_counter() - began)
        same = msgspec.structs.replace(after, sequence=before.sequence)
        assert np.array_equal(same.found, before.found)
        assert same.applied == before.applied == count

    benchmark.pedantic(recover, rounds=3, warmup_rounds=1)
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        kept = ledger.checkpoints()
        ledger._db.execute("DELETE FROM checkpoints")
        began = time.perf_counter()
        _fusion(team, ledger).restore()
        whole = time.perf_counter() - began
    benchmark.extra_info["figures"] = [
        {
            "name": "fusion_recovery_10000",
            "value": statistics.median(times),
            "unit": "s",
            "asked": 2.0,
            "note": f"{count} sets of {ROBOTS} robots, to the posterior; without the start of the process",
            "more": {
                "sets after the checkpoint": count - kept[-1].entries,
                "s without checkpoints": whole,
                "kB of a checkpoint": len(kept[-1].payload) / 1e3,
            },
        },
        {
            "name": "fusion_step",
            "value": statistics.median(steps),
            "unit": "ms",
            "note": "a set applied, stored and told of, median",
            "more": {"p99": float(np.percentile(steps, 99.0))},
        },
    ]
