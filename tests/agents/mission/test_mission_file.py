"""A wrong mission never starts, and its author is told everything that is wrong with it."""

import json
from pathlib import Path

import pytest

from agents.errors import MissionError
from agents.mission import mission_file
from agents.mission.mission import Mission
from agents.mission.mission_file import WrongMissionError, dumps, load, mission_hash
from agents.mission.tables import Problem
from tests.agents import fake_kinds
from tests.agents.fake_kinds import MISSION


@pytest.fixture(autouse=True)
def _only_fake_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    fake_kinds.install(monkeypatch)


def write(directory: Path, *changes: tuple[str, str], text: str = MISSION) -> Path:
    """A mission file with every (old, new) replaced once."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    path = directory / "test.toml"
    path.write_text(text)
    return path


def problems(directory: Path, *changes: tuple[str, str]) -> dict[str, Problem]:
    """What `load` says of the mission with some changes, by key."""
    path = write(directory, *changes)
    with pytest.raises(WrongMissionError) as caught:
        load(path)
    assert caught.value.exit_code == 2
    assert all(line.startswith(f"{path}: ") for line in str(caught.value).splitlines())
    found = {problem.key: problem for problem in caught.value.problems}
    assert len(found) == len(caught.value.problems), "one problem per key"
    return found


def test_a_right_mission_is_resolved_with_every_default(tmp_path: Path) -> None:
    mission = load(write(tmp_path))
    assert mission.robot("r1").vehicle == {
        "kind": "quadrotor",
        "speed_m_s": 8.0,
        "acceleration_m_s2": 4.0,
    }
    assert mission.filter == {"kind": "smc_phd", "particles": 1000, "birth": 0.01}
    assert mission.exploration.points == [27, 27]
    assert mission.directory == str(tmp_path.resolve())


def test_dumps_reads_back_as_the_same_mission(tmp_path: Path) -> None:
    mission = load(write(tmp_path))
    again = write(tmp_path, text=dumps(mission))
    assert load(again) == mission
    assert "directory" not in dumps(mission)
    assert "max = [200.0, 100.0]" in dumps(mission).splitlines()


def test_seed_and_duration_can_be_given_on_top(tmp_path: Path) -> None:
    mission = load(write(tmp_path), seed=11, duration=5)
    assert (mission.seed, mission.duration_s) == (11, 5.0)
    with pytest.raises(WrongMissionError, match=r"duration_s: found -1; allowed: a number > 0"):
        load(write(tmp_path), duration=-1)


def test_hash_is_of_what_the_mission_is_not_of_how_or_where_it_is_written(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    one = load(write(tmp_path))
    other = load(write(tmp_path / "elsewhere", ("min = [0, 0]", "min = [0.0, -0.0] # same")))
    assert mission_hash(one) == mission_hash(load(write(tmp_path), seed=8))  # the start message carries it
    assert mission_hash(one) != mission_hash(load(write(tmp_path), duration=8))
    assert mission_hash(one) == mission_hash(load(write(tmp_path / "elsewhere", text=dumps(one))))
    assert len(mission_hash(other)) == 64


def test_an_unknown_key_is_named_with_the_nearest_known_one(tmp_path: Path) -> None:
    found = problems(
        tmp_path,
        ("speed_m_s = 3", "speed_km_h = 20"),
        ("gain = 0.9", "gian = 0.9"),
        ("seed = 7", "sed = 7"),
        ("points = [5, 5]", "point = [5, 5]"),
    )
    assert found["robots[1].vehicle.speed_km_h"].nearest == "speed_m_s"
    assert "20" in found["robots[1].vehicle.speed_km_h"].found
    assert found["robots[1].vehicle.speed_km_h"].allowed == "speed_m_s, acceleration_m_s2"
    assert found["robots[1].sensor.gian"].nearest == "gain"
    assert found["sed"].nearest == "seed"
    assert found["planner.candidates.point"].nearest == "points"
    assert len(found) == 4  # the missing "points" is not reported a second time


@pytest.mark.parametrize(
    ("old", "new", "key", "shown", "allowed"),
    [
        ("seed = 7", "seed = -1", "seed", "-1", ">= 0"),
        ("seed = 7", "seed = true", "seed", "true", "a whole number"),
        ("seed = 7", 'team = "a b"', "team", '"a b"', "text that matches"),
        ("seed = 7", "duration_s = inf", "duration_s", "inf", "a finite number"),
        ("seed = 7", "duration_s = 0", "duration_s", "0", "a number > 0"),
        ("gain = 0.9", "gain = 1.5", "robots[1].sensor.gain", "1.5", "a number >= 0 and <= 1"),
        ("gain = 0.9", "gain = nan", "robots[1].sensor.gain", "nan", "a finite number"),
        ("gain = 0.9", 'gain = "0.9"', "robots[1].sensor.gain", '"0.9"', "a number"),
        ("[20, 20], gain", "[20, -1], gain", "robots[1].sensor.reach_m[1]", "-1", "a number > 0"),
        ("start = [5, 5]", "start = [5]", "robots[0].start", "[5]", "2 to 4 values"),
        ("start = [5, 5]", "start = 5", "robots[0].start", "5", "a list"),
        ('id = "r1"', "", "robots[0].id", "nothing", "text"),
        ('name = "test"', "", "name", "nothing", "text"),
        ("targets = 3", "targets = 2.5", "world.targets", "2.5", "a whole number >= 1"),
        ("targets = 3", "", "world.targets", "nothing", "a whole number >= 1"),
        (
            "[filter]",
            '[link]\ntopology = "ring"\n[filter]',
            "link.topology",
            '"ring"',
            '"mesh", "router", "star"',
        ),
        ("[filter]", '[link]\nkind = "dds"\n[filter]', "link.kind", '"dds"', "one of zenoh"),
        ("[filter]", '[link]\ntopology = "router"\n[filter]', "link.endpoints", "[]", "tcp/"),
        ("[filter]", '[link]\nendpoints = ["host"]\n[filter]', "link.endpoints[0]", '"host"', "tcp/"),
        ("max = [200, 100]", "max = [0, 100]", "area.max[0]", "0", "> 0"),
        ("max = [200, 100]", "max = [200, 100, 50]", "area.max", "[200", "2 values"),
        ("[filter]", "[exploration]\npoints = [3, 3, 3]\n[filter]", "exploration.points", "[3", "2 values"),
        ("[filter]", "[exploration]\npoints = [3, 1]\n[filter]", "exploration.points[1]", "1", ">= 2"),
        ("low = [20, 20]", "low = [20]", "planner.candidates", "a table", "one number per axis"),
        ("low = [20, 20]", "low = [20, -1]", "planner.candidates.low[1]", "-1", "from 0 to 100"),
        ("start = [5, 5]", "start = [5, 101]", "robots[0].start[1]", "101", "from 0 to 100"),
        ('id = "r2"', 'id = "r1"', "robots[1].id", '"r1"', "robots[0]"),
        ('id = "r2"', 'id = "fusion"', "robots[1].id", '"fusion"', "not fusion"),
        ('"quadrotor" }', '"broken" }', "robots[0].vehicle.kind", '"broken"', "casadi"),
        ('"smc_phd"', "3", "filter.kind", "3", "one of smc_phd"),
        ('kind = "smc_phd"', "", "filter.kind", "nothing", "one of smc_phd"),
        ('vehicle = { kind = "quadrotor" }', "", "robots[0].vehicle", "nothing", "a table"),
        ('vehicle = { kind = "quadrotor" }', "vehicle = 1", "robots[0].vehicle", "1", "a table"),
        ('"quadrotor" }', '"mrclam", data = 3 }', "robots[0].vehicle.data", "3", "a path"),
        ('"quadrotor" }', '"mrclam", data = "a.bag" }', "robots[0].vehicle", "a table", "not a bag"),
    ],
)
def test_each_mistake_names_key_found_and_allowed(
    tmp_path: Path, old: str, new: str, key: str, shown: str, allowed: str
) -> None:
    found = problems(tmp_path, (old, new))
    assert list(found) == [key]
    assert found[key].found.startswith(shown)
    assert allowed in found[key].allowed


def test_an_unknown_kind_is_named_with_the_nearest_installed_one(tmp_path: Path) -> None:
    found = problems(tmp_path, ('"quadrotor" }', '"quadrotr" }'), ('"maasi"', '"masi"'))
    assert found["robots[0].vehicle.kind"].nearest == "quadrotor"
    assert found["robots[0].vehicle.kind"].allowed == "one of broken, mrclam, quadrotor"
    assert found["planner.kind"].nearest == "maasi"


def test_mistakes_of_all_tables_are_reported_together(tmp_path: Path) -> None:
    found = problems(
        tmp_path, ("seed = 7", "seed = -1"), ("targets = 3", "targets = 0"), ("gain = 0.9", "gain = 7")
    )
    assert set(found) == {"seed", "world.targets", "robots[1].sensor.gain"}


def test_contradictions_are_reported_beside_the_mistakes_of_plugins_tables(tmp_path: Path) -> None:
    found = problems(
        tmp_path,
        ("start = [5, 5]", "start = [-5, 5]"),
        ("low = [20, 20]", 'low = "here"'),
        ("gain = 0.9", "gain = 7"),
    )
    assert set(found) == {"robots[0].start[0]", "planner.candidates.low", "robots[1].sensor.gain"}


def test_contradictions_are_reported_together(tmp_path: Path) -> None:
    found = problems(
        tmp_path,
        ("start = [5, 5]", "start = [-5, 500]"),
        ('id = "r2"', 'id = "r1"'),
        ("[20, 20]", "[-1, 20]"),
    )
    assert set(found) == {
        "robots[0].start[0]",
        "robots[0].start[1]",
        "robots[1].id",
        "planner.candidates.low[0]",
    }


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name = 'a'\nseed = = 3\n", r"line 2, column 8"),
        ("[area]\nmin = [0, 0\n", r"line 3|end of document|at line"),
        ("a = 1\na = 2\n", r"line 2"),
    ],
)
def test_what_is_not_toml_is_named_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(WrongMissionError, match=says):
        load(write(tmp_path, text=text))


def test_a_file_that_cannot_be_a_mission_gets_one_clear_sentence(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(b"name = '\xff'")
    with pytest.raises(WrongMissionError, match="UTF-8"):
        load(path)
    path.write_text("a = " + "[" * 5000 + "]" * 5000)
    with pytest.raises(WrongMissionError, match="nested too deeply"):
        load(path)
    with pytest.raises(MissionError, match="is a directory"):
        load(tmp_path)
    with pytest.raises(MissionError, match="no such mission file"):
        load(tmp_path / "none.toml")


def test_an_example_is_found_by_its_name_and_a_near_one_is_offered() -> None:
    assert mission_file.find("quickstart").name == "quickstart.toml"
    with pytest.raises(MissionError, match="nearest is quickstart"):
        mission_file.find("quickstrat")


def test_relative_paths_begin_at_the_missions_directory(tmp_path: Path) -> None:
    path = write(tmp_path, ('{ kind = "quadrotor" }', '{ kind = "mrclam", data = "recordings/6" }'))
    mission = load(path)
    assert mission.robots[0].vehicle["data"] == "recordings/6"
    elsewhere = tmp_path / "run"
    elsewhere.mkdir()
    assert load(write(elsewhere, text=dumps(mission))) == mission


def test_the_resolved_mission_can_be_written_as_json(tmp_path: Path) -> None:
    import msgspec

    plain = json.loads(msgspec.json.encode(load(write(tmp_path))))
    assert msgspec.convert(plain, Mission) == load(write(tmp_path))


def test_a_3d_area_gets_a_3d_exploration_grid(tmp_path: Path) -> None:
    mission = load(
        write(
            tmp_path,
            ("min = [0, 0]", "min = [0, 0, 0]"),
            ("max = [200, 100]", "max = [200, 100, 50]"),
            (
                "low = [20, 20], high = [180, 80], points = [5, 5]",
                "low = [9, 9, 9], high = [20, 20, 20], points = [3, 3, 3]",
            ),
        )
    )
    assert mission.exploration.points == [27, 27, 27]
