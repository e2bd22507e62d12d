"""The scoreboard where targets move: found ones are compared with the truth of their own time."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.machine import Heard
from agents.mission.mission_file import load
from agents.swarm.scoreboard import Scoreboard
from agents.wire.messages import PosteriorMessage
from agents.wire.topics import POSTERIOR
from estimator.arrays import FloatArray
from estimator.filter import Area
from sim.moving_world import MovingWorld

CROSSING = Path(__file__).resolve().parents[2] / "missions" / "crossing.toml"
AREA = Area(np.zeros(2), np.full(2, 200.0))


def posterior(time: float, found: FloatArray, labels: list[int]) -> PosteriorMessage:
    none: dict[str, Any] = {
        "means": np.zeros((2, 0)),
        "covariances": np.zeros((0, 2, 2)),
        "masses": np.zeros(0),
        "radii": np.zeros(0),
        "velocities": np.zeros((2, 0)),
    }
    return PosteriorMessage(
        team="crossing",
        sender="fusion",
        boot="b",
        sequence=int(time),
        time=time,
        watermark={},
        applied=int(time),
        expected_cardinality=2.0,
        found=np.ascontiguousarray(found),
        found_covariances=np.tile(np.eye(2), (found.shape[1], 1, 1)),
        found_velocities=np.zeros_like(found),
        found_times=np.zeros(found.shape[1]),
        found_labels=np.array(labels, np.int64),
        **none,
    )


@pytest.fixture
def board() -> Scoreboard:
    """Two targets that pass each other at 20 s, 2 m apart: less than match_m, which is 3 m."""
    starts, speeds = np.array([[40.0, 80.0], [50.0, 52.0]]), np.array([[1.0, -1.0], [0.0, 0.0]])
    return Scoreboard(load(CROSSING), 0, "virtual", MovingWorld(starts, speeds, AREA, False))


def hear(board: Scoreboard, time: float, labels: list[int], order: tuple[int, int] = (0, 1)) -> None:
    """The team says where targets are, 0.3 m off and half a second late."""
    truth = board.world.targets(time) + 0.3
    message = posterior(time, truth[:, list(order)[: truth.shape[1]]], labels)
    board.hear(Heard(POSTERIOR, message), time + 0.5)


def test_found_targets_are_compared_with_where_true_ones_were_at_their_time(board: Scoreboard) -> None:
    for time in range(1, 31):
        hear(board, float(time), [4, 7])
    summary = board.summary()
    assert summary["targets_found"] == 2
    assert summary["false_found"] == 0
    assert summary["all_found"]
    assert summary["max_error_m"] == pytest.approx(0.3 * np.sqrt(2.0))
    assert summary["label_changes"] == 0
    assert max(summary["curve"]["gospa"]) < 0.7


def test_labels_that_go_over_to_the_other_target_are_counted(board: Scoreboard) -> None:
    for time in range(1, 31):
        hear(board, float(time), [4, 7] if time < 21 else [7, 4])
    assert board.summary()["label_changes"] == 2


def test_a_new_label_for_the_same_target_is_counted_once(board: Scoreboard) -> None:
    for time in range(1, 31):
        hear(board, float(time), [4, 7 if time < 10 else 9])
    assert board.summary()["label_changes"] == 1


def test_targets_that_left_need_not_be_found(board: Scoreboard) -> None:
    hear(board, 90.0, [4])  # the second left at 80 s
    assert board.targets_found == 1
    assert board.all_found
