"""A mission among walls in virtual time with every planner: nobody is ever where nobody may be."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from agents.machine import Heard
from agents.mission.mission_file import load
from agents.plugins import kinds
from agents.team import Team
from agents.wire.messages import PoseMessage
from planner.ground.shapes import Shape
from sim.engine.engine import Engine
from tests.planner.contract import CONFIGS

WALLS = Path(__file__).resolve().parents[2] / "missions" / "walls.toml"
SECONDS = 45.0
RADIUS = 0.3  # of the mission's robots


@pytest.mark.parametrize("kind", kinds("planners"))
def test_a_mission_among_walls_touches_none_of_them_whatever_the_planner(kind: str) -> None:
    whole = load(WALLS)
    mission = msgspec.structs.replace(
        whole,
        duration_s=SECONDS,
        planner={"kind": kind, **CONFIGS.get(kind, {})},
        filter={**whole.filter, "particles": 800},
    )
    engine = Engine(Team.of(mission), 5)
    poses: list[np.ndarray] = []
    hear = engine.scoreboard.hear

    def listen(heard: Heard, now: float) -> None:
        if isinstance(heard.message, PoseMessage):  # every robot's, five times a second
            poses.append(heard.message.pose[:3])
        hear(heard, now)

    engine.scoreboard.hear = listen  # type: ignore[method-assign]
    engine.run()
    points = np.array(poses).T
    assert points.shape[1] >= 4 * len(mission.robots) * min(SECONDS, engine.clock.now())
    assert np.linalg.norm(points.max(axis=1) - points.min(axis=1)) > 10.0  # they got about
    table = mission.ground
    assert table is not None
    for zone in (*table.obstacles, *table.keep_out):
        ring = None if zone.polygon is None else [np.array(zone.polygon)]
        shape = Shape.disc(*zone.circle) if ring is None else Shape.polygon(ring)
        assert shape.distances(points).min() >= RADIUS, f"robot in {zone}"
    fence = Shape.polygon([np.array(table.geofence[0].polygon)])
    assert fence.distances(points).max() <= -RADIUS
