"""A checked mission becomes models and devices, through plugins alone."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.errors import MissionError
from agents.mission.mission_file import load
from agents.team import Team
from tests.agents import fake_kinds
from tests.agents.fake_kinds import MISSION


@pytest.fixture(autouse=True)
def _only_fake_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    fake_kinds.install(monkeypatch)


def team(directory: Path, *changes: tuple[str, str]) -> Team:
    text = MISSION
    for old, new in changes:
        text = text.replace(old, new, 1)
    path = directory / "test.toml"
    path.write_text(text)
    return Team.of(load(path))


def test_models_and_periods_are_there_for_every_robot(tmp_path: Path) -> None:
    made = team(tmp_path, ("gain = 0.9", "period_s = 0.25"))
    assert list(made.vehicle_models) == list(made.sensor_models) == ["r1", "r2"]
    assert made.measure_periods == {"r1": 1.0, "r2": 0.25}
    planner: Any = made.planner
    assert planner.setup.vehicles is made.vehicle_models
    assert planner.setup.sensors is made.sensor_models
    np.testing.assert_array_equal(made.area.high, [200, 100])


def test_devices_are_made_with_their_robots_context(tmp_path: Path) -> None:
    made = team(tmp_path)
    world = made.world(5)
    _, config, context = made.vehicle("r2", 5, world, now=1.5, speed=20.0)  # type: ignore[misc]
    assert config.speed_m_s == 3.0
    assert (context.robot, context.seed, context.world, context.now) == ("r2", 5, world, 1.5)
    np.testing.assert_array_equal(context.start, [195, 95, 10, 1.5])
    assert context.speed == 20.0
    assert made.sensor("r1", 5, world)[0] == "sensor"  # type: ignore[index]


def test_data_is_looked_for_beside_the_mission_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = team(
        tmp_path,
        ('{ kind = "quadrotor" }', '{ kind = "mrclam", data = "set6" }'),
        ('{ kind = "quadrotor", speed_m_s = 3 }', '{ kind = "mrclam", data = "~/set7" }'),
    )
    monkeypatch.setenv("HOME", "/home/someone")
    assert made.vehicle_models["r1"][1].data == tmp_path.resolve() / "set6"  # type: ignore[index]
    monkeypatch.undo()
    assert made.vehicle_models["r2"][1].data == Path("~/set7").expanduser()  # type: ignore[index]


def test_a_table_that_a_plugin_refuses_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissionError, match=r"robots\[1\]\.sensor: reach_m: 3 values, expected 2"):
        team(tmp_path, ("[20, 20], gain = 0.9", "[20, 20, 20]"))
