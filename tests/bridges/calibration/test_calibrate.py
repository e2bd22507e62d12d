"""`searchparty calibrate`: recordings in, missions out that `check` accepts, clear errors for the rest."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from agents import cli
from agents.errors import SearchpartyError
from agents.mission.mission_file import load
from agents.team import Team
from bridges.mrclam.calibration import fit_cameras, read_robots
from bridges.mrclam.mrclam import Camera
from sim.simulate.simulate import run_one

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "MRCLAM_Dataset6"
recorded = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there")


def calibrate(*words: str | Path) -> str:
    done = CliRunner().invoke(cli.app, ["calibrate", *map(str, words)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def value(estimates: list[dict[str, Any]], name: str) -> dict[str, Any]:
    return next(row for row in estimates if row["name"] == name)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run of two robots that never stop looking; the mission's seed is not the run's."""
    directory = tmp_path_factory.mktemp("runs")
    robots = "".join(
        f"""
[[robots]]
id = "{name}"
start = [{x}, 10]
vehicle = {{ kind = "unicycle" }}
[robots.sensor]
kind = "range_bearing"
period_s = 0.25
range_sigma_m = 0.2
bearing_sigma_deg = 2
bearing_frame = "body"
gain = 0.8
clutter = 0.2
field_of_view = "sector"
range_m = 9
angle_deg = 140
"""
        for name, x in (("a", 5), ("b", 15))
    )
    (directory / "m.toml").write_text(
        'name = "small"\nduration_s = 150\nstop_when_all_found = false\n'
        "[area]\nmin = [0, 0]\nmax = [20, 20]\n"
        '[world]\nkind = "uniform"\ntargets = 6\n[filter]\nkind = "smc_phd"\nparticles = 500\n'
        '[planner]\nkind = "maasi"\n' + robots
    )
    run_one(load(directory / "m.toml"), 5, directory)
    return directory / "seed-5"


def test_a_simulated_runs_sensor_is_recovered(run: Path, tmp_path: Path) -> None:
    answer = json.loads(calibrate(run, "--json", "--out", tmp_path / "new.toml", "--breaks", "1,9"))
    for robot in ("a", "b"):
        found = answer["robots"][robot]
        assert value(found["estimates"], "range_sigma")["value"] == pytest.approx(0.2, rel=0.2)
        assert value(found["estimates"], "bearing_sigma")["value"] == pytest.approx(2.0, rel=0.2)
        assert value(found["estimates"], "clutter")["value"] == pytest.approx(0.2, abs=0.06)
        for at in ("p_D at 1.00 m", "p_D at 9.00 m"):
            row = value(found["estimates"], at)
            assert row["low"] <= row["value"] <= row["high"]
            assert row["value"] == pytest.approx(0.8, abs=0.15)
        assert found["sensor"]["angle_deg"] == pytest.approx(140, abs=12)
    old, new = load(run / "mission.toml"), load(tmp_path / "new.toml")
    Team.of(new)
    assert [robot.vehicle for robot in new.robots] == [robot.vehicle for robot in old.robots]
    assert new.robots[0].sensor["range_sigma_m"] == answer["robots"]["a"]["sensor"]["range_sigma_m"]


def test_only_the_robot_asked_for_gets_another_sensor(run: Path) -> None:
    text = calibrate(run, "--robot", "b")
    assert "# b: " in text
    assert "# a: " not in text
    sensors = {robot["id"]: robot["sensor"] for robot in tomllib.loads(text)["robots"]}
    assert sensors["a"]["range_sigma_m"] == 0.2
    assert sensors["b"]["range_sigma_m"] != 0.2
    assert "#   range_sigma = " in text


@pytest.mark.parametrize(
    ("words", "says", "status"),
    [
        (["nowhere"], r"nowhere holds no mission\.toml with a ledger\.sqlite", 4),
        (["RUN", "--robot", "c"], "no sets of a robot c; there are a, b", 4),
        (["RUN", "--anonymous"], "for MRCLAM recordings", 2),
        (["RUN", "--breaks", "1,two"], "--breaks: found '1,two'", 2),
        (["RUN", "--breaks", "2,1"], "--breaks: expected two or more growing", 2),
        (["RUN", "--range-gate", "0"], "--range-gate: expected a finite number > 0", 2),
        (["RUN", "--range-gate", "1e-9"], "robot a: errors: .* too few", 4),
        (["RUN", "--reach", "nan"], "--reach: expected a number > 0", 2),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(run: Path, words: list[str], says: str, status: int) -> None:
    with pytest.raises(SearchpartyError, match=says) as caught:
        calibrate(*(run if word == "RUN" else word for word in words))
    assert caught.value.exit_code == status


def write(directory: Path, name: str, rows: list[str]) -> None:
    (directory / name).write_text("".join(row + "\n" for row in rows))


@pytest.fixture(scope="module")
def made_up(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a camera with known faults: one robot drives along landmarks, another stands by."""
    directory = tmp_path_factory.mktemp("mrclam")
    rng = np.random.default_rng(0)
    landmarks = np.array([[x, y] for x in range(0, 40, 4) for y in (3.0, -3.5)])
    write(directory, "Barcodes.dat", [f"{i} {100 + i}" for i in range(1, 3 + len(landmarks))])
    write(
        directory, "Landmark_Groundtruth.dat", [f"{i + 3} {x} {y} 0 0" for i, (x, y) in enumerate(landmarks)]
    )
    times = np.arange(0.0, 300.0, 0.05)
    poses = np.column_stack([20 + 16 * np.sin(times / 20), 0.5 * np.sin(times), 0.6 * np.sin(times / 3)])
    for number, way in ((1, poses), (2, np.tile([-5.0, 0.0, 0.0], (len(times), 1)))):
        rows = [f"{t} {x} {y} {yaw}" for t, (x, y, yaw) in zip(times, way, strict=True)]
        write(directory, f"Robot{number}_Groundtruth.dat", rows)
        write(directory, f"Robot{number}_Odometry.dat", ["0 0 0", "299.9 0 0"])
    lines = []
    for stamp in np.arange(1.0, 299.0, 0.235):
        x, y, yaw = (np.interp(stamp - 0.05, times, poses[:, i]) for i in range(3))
        ahead = landmarks - [x, y]
        left = np.arctan2(ahead[:, 1], ahead[:, 0]) - yaw
        # seen from 0.1 m behind the centre, through depth 5% too long
        u, v = np.hypot(*ahead.T) * np.cos(left) + 0.1, np.hypot(*ahead.T) * np.sin(left)
        for i in np.flatnonzero((u > 0.8) & (abs(np.arctan2(v, u)) < 0.55) & (np.hypot(u, v) < 7)):
            if rng.random() < 0.6:
                depth = (u[i] + rng.normal(0, 0.03)) / 0.95
                lines.append(
                    f"{stamp} {103 + i} {depth} {np.arctan2(v[i], u[i]) + 0.02 + rng.normal(0, 0.01)}"
                )
    write(directory, "Robot1_Measurement.dat", lines)
    write(directory, "Robot2_Measurement.dat", lines[:3])
    return directory


def test_a_cameras_faults_are_recovered(made_up: Path) -> None:
    (camera,) = fit_cameras(made_up, read_robots(made_up, [1]), 0.235)
    assert isinstance(camera, Camera)
    assert camera.depth_scale == pytest.approx(0.95, abs=0.005)
    assert camera.forward == pytest.approx(-0.1, abs=0.02)
    assert camera.bearing[0] == pytest.approx(-0.02, abs=0.003)
    assert camera.delay == pytest.approx(0.05, abs=0.015)


def test_a_recordings_mission_replays_it(made_up: Path, tmp_path: Path) -> None:
    text = calibrate(made_up, "--robot", "1", "--breaks", "1,3,6")
    (tmp_path / "m.toml").write_text(text)
    mission = load(tmp_path / "m.toml")
    team = Team.of(mission)
    assert team.world(0).targets(0.0).shape == (2, 20)
    sensor = mission.robots[0].sensor
    assert sensor["range_sigma_m"] == pytest.approx(0.03, rel=0.3)
    assert sensor["bearing_sigma_deg"] == pytest.approx(np.degrees(0.01), rel=0.2)
    assert sensor["range_gains"][:3] == pytest.approx([0.6, 0.6, 0.6], abs=0.12)


def test_a_robot_that_saw_next_to_nothing_is_named(made_up: Path) -> None:
    for words, says in (
        (("--robot", "2"), "robot 2 saw landmarks"),
        (("--robot", "7"), "has no robot 7; it has 1, 2"),
        (("--robot", "r1"), "--robot: found r1"),
        (("--robot", "1", "--mission", "quickstart"), "none of its robots replays"),
    ):
        with pytest.raises(SearchpartyError, match=says):
            calibrate(made_up, *words)


@pytest.mark.data
@recorded
def test_mrclam_gives_what_the_mission_in_the_box_was_made_with(tmp_path: Path) -> None:
    base = Path(__file__).resolve().parents[3] / "missions" / "mrclam.toml"
    out = tmp_path / "calibrated.toml"
    calibrate(DATA, "--robot", "3", "--mission", base, "--out", out, "--breaks", "1,2,3,4,5,6,7")
    old, new = load(base), load(out)
    Team.of(new).world(0)
    assert new.robots[0].sensor == old.robots[0].sensor
    before, after = old.robot("r3").sensor, new.robot("r3").sensor
    assert after["range_sigma_m"] == pytest.approx(0.034, abs=0.006)  # docs/mrclam.md
    assert after["bearing_sigma_deg"] == pytest.approx(0.42, abs=0.04)
    assert after["range_gains"][1:5] == pytest.approx([0.5, 0.42, 0.34, 0.33], abs=0.06)
    assert after["angle_deg"] == pytest.approx(before["angle_deg"], abs=4)
    for key, within in (("depth_scale", 0.002), ("axis_deg", 0.3), ("forward_m", 0.01), ("bearing_deg", 0.1)):
        assert after["camera"][key] == pytest.approx(before["camera"][key], abs=within)
    assert after["camera"]["delay_s"] == pytest.approx(0.038, abs=0.012)
