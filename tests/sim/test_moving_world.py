"""Worlds whose targets move, and a mission in which they cross each other."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from agents.errors import MissionError
from agents.mission.mission_file import load
from agents.team import Team
from estimator.filter import Area
from sim.engine.engine import Engine
from sim.moving_world import MovingWorld, MovingWorldKind

AREA = Area(np.zeros(2), np.array([10.0, 20.0]))
CROSSING = Path(__file__).resolve().parents[2] / "missions" / "crossing.toml"


def world(**keys: object) -> MovingWorld:
    made = MovingWorldKind.world(msgspec.convert(keys, MovingWorldKind.Config), AREA, 5)
    assert isinstance(made, MovingWorld)
    return made


def test_targets_go_straight_on_and_turn_back_at_the_border_as_light_at_a_mirror() -> None:
    made = world(starts=[[2.0, 3.0]], velocities=[[1.0, -0.5]])
    assert made.targets(4.0)[:, 0].tolist() == [6.0, 1.0]
    assert made.targets(8.0)[:, 0].tolist() == [10.0, 1.0]  # turned at y = 0 after 6 s
    stepped, speed = np.array([2.0, 3.0]), np.array([1.0, -0.5])
    for _ in range(20_000):
        stepped = stepped + 0.005 * speed
        speed = np.where((stepped < AREA.low) | (stepped > AREA.high), -speed, speed)
    assert made.targets(100.0)[:, 0] == pytest.approx(stepped, abs=0.05)


def test_targets_that_leave_are_there_no_more() -> None:
    made = world(starts=[[2.0, 3.0], [5.0, 5.0]], velocities=[[-1.0, 0.0], [0.0, 0.1]], border="leave")
    assert made.targets(1.9).shape == (2, 2)
    assert made.targets(2.1).tolist() == [[5.0], [5.21]]


def test_random_targets_have_the_asked_speed_and_belong_to_the_seed() -> None:
    made, again = world(targets=50, speed_m_s=2.0), world(targets=50, speed_m_s=2.0)
    assert np.linalg.norm(made.velocities, axis=0) == pytest.approx(np.full(50, 2.0))
    assert np.array_equal(made.targets(7.0), again.targets(7.0))
    inside = (made.targets(33.0) >= AREA.low[:, None]) & (made.targets(33.0) <= AREA.high[:, None])
    assert inside.all()


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({"starts": [[1.0, 1.0]]}, r"world\.velocities"),
        ({"starts": [[1.0, 1.0, 1.0]], "velocities": [[1.0, 1.0]]}, r"world\.starts\[0\]"),
        ({"starts": [[11.0, 1.0]], "velocities": [[1.0, 1.0]]}, "outside the area"),
        ({"starts": [[1.0, 1.0]], "velocities": [[float("nan"), 1.0]]}, r"world\.velocities\[0\]"),
    ],
)
def test_a_world_that_cannot_be_is_refused_by_key(keys: dict[str, object], named: str) -> None:
    with pytest.raises(MissionError, match=named):
        world(**keys)


@pytest.mark.parametrize("seed", [0, 1])
def test_crossing_targets_are_found_and_keep_their_labels(seed: int) -> None:
    mission = msgspec.structs.replace(load(CROSSING), duration_s=60)  # the last two meet at 40 s
    summary = Engine(Team.of(mission), seed).run().summary()
    assert summary["targets_found"] == 6, f"repeat with: searchparty simulate crossing --seeds {seed}"
    assert summary["false_found"] == 0
    assert summary["label_changes"] == 0
    assert summary["gospa"] < 2.5


def test_a_random_walk_grows_with_the_root_of_time_and_is_the_same_for_every_asker() -> None:
    keys = {"starts": [[5.0, 10.0]] * 400, "velocities": [[0.0, 0.0]] * 400, "drift": 0.1}
    made, again = world(**keys), world(**keys)
    early, late = made.targets(4.0), made.targets(16.0)
    start = np.array([[5.0], [10.0]])
    assert np.std(early - start) == pytest.approx(0.2, rel=0.15)
    assert np.std(late - start) == pytest.approx(0.4, rel=0.15)
    np.testing.assert_array_equal(again.targets(16.0), late)  # asked in another order
    np.testing.assert_array_equal(again.targets(4.0), early)
    np.testing.assert_allclose(made.targets(4.5), 0.5 * (early + made.targets(5.0)))
    np.testing.assert_array_equal(made.targets(0.0), np.tile(start, 400))
