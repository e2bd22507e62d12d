"""What a run's ledger says of its sensors, where the mission's world knows the truth (simulated ones do)."""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from agents.errors import DataError
from agents.ledger.ledger import Ledger
from agents.mission.mission import Mission
from agents.mission.mission_file import load
from agents.swarm.run_directory import RunDirectory
from agents.team import Team
from agents.wire.messages import MeasurementSetMessage
from estimator.arrays import FloatArray
from estimator.calibration.recording import Recording

# What the sensors of each kind measure, those of them that a calibration can tell anything about.
QUANTITIES = {
    "range_bearing": ("range", "bearing"),
    "bearing_only": ("bearing",),
    "range_only": ("range",),
}


def read_run(directory: Path) -> tuple[Mission, dict[str, Recording]]:
    """A run's mission, and the recording of each robot that measured something.

    Raises:
        DataError: if it is no run's directory, or what its robots measure cannot be calibrated.
        MissionError: if its mission cannot be made real any more.
    """
    run = RunDirectory(directory)
    if not (run.mission.is_file() and run.ledger.is_file()):
        raise DataError(
            f"{directory} holds no mission.toml with a ledger.sqlite; give the directory of a run"
        )
    mission = load(run.mission)
    if mission.box().dimension != 2:
        raise DataError(f"{run.mission} is a mission in 3D; only planar sensors can be calibrated")
    team = Team.of(mission)
    world = team.world(_seed(run, mission))
    sets: dict[str, list[MeasurementSetMessage]] = defaultdict(list)
    with Ledger(run.ledger, read_only=True) as ledger:
        for message in ledger.replay(mission.team):
            if isinstance(message, MeasurementSetMessage):
                sets[message.sender].append(message)
    for messages in sets.values():
        messages.sort(key=lambda message: message.time)
    out = {}
    for robot in mission.robots:
        if not sets[robot.id]:
            continue
        kind = str(robot.sensor["kind"])
        if kind not in QUANTITIES:
            raise DataError(
                f"robot {robot.id}: a {kind} sensor cannot be calibrated; {', '.join(QUANTITIES)} can"
            )
        mine = sets[robot.id]
        poses = np.stack([message.pose for message in mine])
        truth = _padded([world.targets(message.time)[:2] for message in mine])
        others = [s for name, s in sorted(sets.items()) if name != robot.id and s]
        seen_too = mission.teammates.rate > 0.0 and others
        times = np.array([message.time for message in mine])
        hidden = None
        if team.sight is not None:
            pairs = zip(truth, poses, strict=True)
            hidden = np.stack([~team.sight.visible(np.nan_to_num(t), pose)[0] for t, pose in pairs])
        out[robot.id] = Recording(
            poses=poses,
            offsets=np.append(0, np.cumsum([len(message.measurements) for message in mine])),
            measurements=np.concatenate([message.measurements for message in mine]),
            targets=truth,
            bystanders=np.stack([_places(s, times) for s in others], axis=2)
            if seen_too
            else np.zeros((len(mine), 2, 0)),
            quantities=QUANTITIES[kind],
            body_frame=robot.sensor.get("bearing_frame") == "body",
            hidden=hidden,
        )
    if not out:
        raise DataError(f"{run.ledger} holds no measurement set")
    return mission, out


def _seed(run: RunDirectory, mission: Mission) -> int:
    """Of the world: `simulate` keeps the mission as it was and says in the summary which seed it ran with."""
    try:
        summary: Any = json.loads(run.summary.read_text())
        return int(summary["seed"])
    except FileNotFoundError:
        return mission.seed
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{run.summary} does not say the run's seed: {error}") from None


def _padded(places: list[FloatArray]) -> FloatArray:
    """(k, 2, n) of places (2, at most n), with NaN for targets that had not come or had left."""
    out = np.full((len(places), 2, max(part.shape[1] for part in places)), np.nan)
    for i, part in enumerate(places):
        out[i, :, : part.shape[1]] = part
    return out


def _places(sets: list[MeasurementSetMessage], times: FloatArray) -> FloatArray:
    """(k, 2) where a robot was at the times (k,) of another's sets."""
    own = np.array([message.time for message in sets])
    poses = np.stack([message.pose for message in sets])
    return np.column_stack([np.interp(times, own, poses[:, i]) for i in range(2)])
