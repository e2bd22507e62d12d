"""A mission with a map: walls hide targets from every sensor, and everything stays in free space."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from agents import cli
from agents.errors import DataError, MissionError
from agents.mission.mission_file import WrongMissionError, dumps, load, mission_hash
from agents.team import Team
from estimator.exploration import Exploration
from estimator.maps.line_of_sight import LineOfSight
from sim.engine.engine import Engine

DEPOT = Path(__file__).resolve().parents[2] / "missions" / "depot.toml"
MISSION = """
name = "rooms"
duration_s = 20
[area]
min = [0, 0]
max = [20, 10]
[map]
file = "maps/rooms.yaml"
[world]
kind = "uniform"
targets = 40
[filter]
kind = "smc_phd"
grid_points = [41, 21]
[exploration]
points = [41, 21]
[planner]
kind = "maasi"
[[robots]]
id = "r1"
start = [2, 5]
vehicle = { kind = "unicycle" }
[robots.sensor]
kind = "range_bearing"
period_s = 0.5
range_sigma_m = 0.1
bearing_sigma_deg = 1
reach_m = [8, 8]
"""


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """20 m x 10 m: a wall at x = 10 with a door, and a closed room in the corner beyond it."""
    shade = np.full((100, 200), 255, np.uint8)
    shade[:, 100] = 0
    shade[45:55, 100] = 255
    shade[20, 150:] = 0
    shade[:20, 150] = 0
    (tmp_path / "maps").mkdir()
    Image.fromarray(shade).save(tmp_path / "maps" / "rooms.png")
    (tmp_path / "maps" / "rooms.yaml").write_text(
        "image: rooms.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    return tmp_path


def mission(directory: Path, *changes: tuple[str, str]) -> Path:
    text = MISSION
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (directory / "m.toml").write_text(text)
    return directory / "m.toml"


def test_targets_prior_and_exploration_are_only_where_robots_can_get(directory: Path) -> None:
    team = Team.of(load(mission(directory)))
    closed = np.array([[18.0], [9.0]])
    door, hall = np.array([[10.05], [5.0]]), np.array([[15.0], [2.0]])
    for seed in range(5):
        targets = team.world(seed).targets(0.0)
        assert team.area.is_free(targets).all()
        assert not ((targets[0] > 15) & (targets[1] > 8)).any()
    assert team.area.is_free(np.hstack([closed, door, hall])).tolist() == [False, True, True]
    state = team.search().init(np.random.default_rng(0))
    nodes = state.exploration.nodes()
    np.testing.assert_array_equal(state.exploration.values.ravel(), team.area.is_free(nodes))
    assert team.search().expected_cardinality(state) == pytest.approx(1.0)
    assert Exploration.unexplored(team.area, [41, 21]).at(closed)[0] == 0.0


def test_models_and_simulated_devices_alike_see_nothing_through_walls(directory: Path) -> None:
    team = Team.of(load(mission(directory, ("targets = 40", "targets = 3"))))
    model = team.sensor_models["r1"]
    assert isinstance(model, LineOfSight)
    pose = np.array([2.0, 9.0, 0.0, 0.0])
    across = np.array([[14.0], [2.0]])
    assert model.detection(across, pose[None])[0, 0] == 0.0
    assert model.sensor.detection(across, pose[None])[0, 0] > 0.0

    class Across:
        def targets(self, time: float) -> np.ndarray:
            return across

    device = team.sensor("r1", 0, Across())
    assert sum(len(device.measure(0.5 * k, pose)) for k in range(200)) == 0
    blind = Team.of(load(mission(directory, ('rooms.yaml"', 'rooms.yaml"\nline_of_sight = false'))))
    assert not isinstance(blind.sensor_models["r1"], LineOfSight)
    seeing = blind.sensor("r1", 0, Across())
    assert sum(len(seeing.measure(0.5 * k, pose)) for k in range(200)) > 0


def test_a_run_is_the_same_again_and_finds_targets(directory: Path) -> None:
    made = load(mission(directory, ("duration_s = 20", "duration_s = 4")))
    hashes, found = set(), None
    for _ in range(2):
        team = Team.of(made)
        engine = Engine(team, 3)
        engine.run()
        hashes.add(engine.log_hash)
        found = engine.fusion.fusion.search_state.found
    assert len(hashes) == 1
    assert found is not None
    assert found.shape[1] > 0


def test_a_resolved_mission_finds_its_map_from_anywhere(
    directory: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    made = load(mission(directory))
    elsewhere = tmp_path_factory.mktemp("run") / "mission.toml"
    elsewhere.write_text(dumps(made))
    again = load(elsewhere)
    assert mission_hash(again) == mission_hash(made)
    assert Team.of(again).area.map is not None
    absolute = load(mission(directory, ('"maps/rooms.yaml"', f'"{directory}/maps/rooms.yaml"')))
    assert "directory" not in dumps(absolute)


@pytest.mark.parametrize(
    ("change", "key", "says"),
    [
        (('file = "maps/rooms.yaml"', 'fil = "maps/rooms.yaml"'), "map.fil", "nearest known: file"),
        (('file = "maps/rooms.yaml"', "line_of_sight = true"), "map.file", "text"),
        (('rooms.yaml"', 'rooms.yaml"\nkind = "rso"'), "map.kind", "nearest known: ros"),
        (('rooms.yaml"', 'rooms.yaml"\nunknown = "black"'), "map.unknown", 'one of "blocks", "clear"'),
    ],
)
def test_a_wrong_key_is_named(directory: Path, change: tuple[str, str], key: str, says: str) -> None:
    with pytest.raises(WrongMissionError) as caught:
        load(mission(directory, change))
    assert key in str(caught.value)
    assert says in str(caught.value)


def test_what_does_not_fit_the_map_is_named(directory: Path) -> None:
    with pytest.raises(MissionError, match=r"robots\[0\]\.start: found \[10\.05, 9\.0"):
        Team.of(load(mission(directory, ("start = [2, 5]", "start = [10.05, 9.0]"))))
    fixed = ('kind = "uniform"\ntargets = 40', 'kind = "fixed"\npositions = [[3, 3], [18, 9]]')
    with pytest.raises(MissionError, match=r"world\.positions\[1\]: found \[18.*a way leads to"):
        Team.of(load(mission(directory, fixed))).world(0)


def test_a_missing_map_is_this_machines_lack_and_not_the_missions(directory: Path) -> None:
    file = mission(directory, ("maps/rooms.yaml", "maps/halls.yaml"))
    with pytest.raises(DataError, match=r"halls\.yaml cannot be read"):
        Team.of(load(file))
    done = CliRunner().invoke(cli.app, ["check", str(file), "--json"])
    assert done.exit_code == 0
    assert "halls.yaml cannot be read" in json.loads(done.stdout)["lacking"][0]


@pytest.mark.data
@pytest.mark.skipif(not (DEPOT.parents[2] / "shared/data/maps/depot.yaml").is_file(), reason="no depot map")
def test_the_depot_mission_is_right() -> None:
    team = Team.of(load(DEPOT))
    targets = team.world(1).targets(0.0)
    assert targets.shape == (2, 10)
    assert team.area.is_free(targets).all()
