"""The whole team in virtual time among walls: all is found, and nobody is ever where nobody may be."""

from pathlib import Path

import numpy as np
import pytest

from agents.machine import Heard
from agents.mission.mission_file import load
from agents.team import Team
from agents.wire.messages import PoseMessage
from planner.ground.shapes import Shape
from sim.engine.engine import Engine

WALLS = Path(__file__).resolve().parents[3] / "missions" / "walls.toml"
RADIUS = 0.3


@pytest.mark.parametrize("seed", [3, 4])
def test_all_targets_are_found_and_no_robot_enters_an_obstacle_or_leaves_the_fence(seed: int) -> None:
    mission = load(WALLS)
    team = Team.of(mission)
    engine = Engine(team, seed)
    poses: list[np.ndarray] = []
    hear = engine.scoreboard.hear

    def listen(heard: Heard, now: float) -> None:
        if isinstance(heard.message, PoseMessage):  # every robot's, five times a second
            poses.append(heard.message.pose[:3])
        hear(heard, now)

    engine.scoreboard.hear = listen  # type: ignore[method-assign]
    summary = engine.run().summary()
    assert summary["targets_found"] == mission.world["targets"]
    points = np.array(poses).T
    assert points.shape[1] > 5 * engine.clock.now()
    # Against the shapes themselves, not the grid that was made of them.
    table = mission.ground
    assert table is not None
    for zone in (*table.obstacles, *table.keep_out):
        assert shape(zone).distances(points).min() >= RADIUS
    assert shape(table.geofence[0]).distances(points).max() <= -RADIUS
    targets = engine.world.targets(0.0)
    for zone in table.obstacles:
        assert not shape(zone).contains(targets).any()


def shape(zone) -> Shape:  # type: ignore[no-untyped-def]
    if zone.polygon is not None:
        return Shape.polygon([np.array(zone.polygon)])
    return Shape.disc(*zone.circle)
