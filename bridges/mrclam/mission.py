"""A mission that replays an MRCLAM recording, from what the recording itself says."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bridges.mrclam.calibration import RecordedRobot

_MARGIN_M = 0.5


def mission_of(
    directory: Path, robots: Sequence[RecordedRobot], sensors: Mapping[str, dict[str, Any]]
) -> str:
    """The mission as TOML. Thresholds of filter and found targets are those of missions/mrclam.toml.

    Args:
        directory: the recording, which the mission names by its absolute path.
        robots: who takes part.
        sensors: their tables, by the id `r1` of robot 1.
    """
    import tomli_w  # noqa: PLC0415 - only this command writes TOML

    tracks = [robot.track.poses[:2] for robot in robots]
    places = np.concatenate([robots[0].landmarks, *tracks], axis=1)
    low, high = places.min(axis=1) - _MARGIN_M, places.max(axis=1) + _MARGIN_M
    points = [max(2, int(n)) for n in np.ceil((high - low) / 0.25) + 1]
    mission = {
        "name": "mrclam-calibrated",
        "duration_s": float(np.floor(max(robot.track.times[-1] for robot in robots))),
        "stop_when_all_found": False,
        "match_m": 0.25,
        "gospa_c_m": 0.5,
        "area": {"min": low.round(2).tolist(), "max": high.round(2).tolist()},
        "world": {"kind": "mrclam", "data": str(directory.resolve())},
        "filter": {
            "kind": "smc_phd",
            "particles": 6000,
            "expected_targets": 10,
            "birth": 0.03,
            "roughening": 0.08,
            "cluster_floor": 1.0,
            "grid_points": points,
            "cluster_cutoff_m": 0.1,
        },
        "found": {
            "radius_m": 0.021,
            "gate_m": 0.08,
            "blur_m": 0.03,
            "period_s": 0.2,
            "same_sigmas": 3.0,
        },
        "teammates": {"rate": 4, "spread_m": 0.08},
        "fusion": {"late_sets": "expire"},
        "planner": {"kind": "maasi"},
        "robots": [
            {
                "id": f"r{robot.number}",
                "start": [round(float(x), 3) for x in robot.start()],
                "vehicle": {"kind": "mrclam", "robot": robot.number},
                "sensor": sensors[f"r{robot.number}"],
            }
            for robot in robots
        ],
    }
    return tomli_w.dumps(mission)
