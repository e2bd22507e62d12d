"""Robots that replay a recording, and what the team's estimate makes of it."""

from math import inf
from pathlib import Path

import numpy as np
import pytest

from agents.devices import DeviceContext
from agents.errors import DataError, MissionError
from agents.mission import mission_file
from agents.seeds import generator
from agents.team import Team
from bridges.mrclam.kinds import (
    RecordedSensor,
    RecordedVehicle,
    RecordedVehicleKind,
    RecordedWorldKind,
    VehicleConfig,
    WorldConfig,
)
from bridges.mrclam.mrclam import Frames, Track
from estimator.filter import Area
from planner.vehicles.unicycle import Unicycle
from sim.world import UniformWorldKind

ROOT = Path(__file__).resolve().parents[3]
DATA = ROOT.parent / "shared" / "data" / "MRCLAM_Dataset6"
recorded = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there")
FRAMES = Frames(np.array([1.0, 1.2, 1.4]), np.array([0, 2, 2, 3]), np.arange(6.0).reshape(3, 2))


def test_every_frame_is_given_once_at_its_own_time_the_empty_one_too() -> None:
    sensor = RecordedSensor(FRAMES)
    times, sizes, time = [], [], sensor.next_capture(-1.0)
    while time < inf:
        times.append(time)
        sizes.append(len(sensor.measure(time, np.zeros(4))))
        time = sensor.next_capture(time)
    assert times == [1.0, 1.2, 1.4]
    assert sizes == [2, 0, 1]


def test_before_the_first_frame_nothing_is_seen() -> None:
    assert RecordedSensor(FRAMES).measure(0.5, np.zeros(4)).shape == (0, 2)


def test_a_recorded_vehicle_goes_its_own_way() -> None:
    track = Track(
        np.array([0.0, 10.0]),
        np.array([[0.0, 5.0], [1.0, 1.0], [0.0, 0.0]]),
        np.array([0.0, 10.0]),
        np.array([0.0, 5.0]),
    )
    vehicle = RecordedVehicle(track, Unicycle(Unicycle.Config()))
    vehicle.follow(None, 2.0)
    state = vehicle.state(4.0)
    assert not vehicle.follows_plans
    assert not state.arrived
    assert state.pose == pytest.approx([2.0, 1.0, 0.0, 0.0])
    assert state.velocity == pytest.approx([0.5, 0.0, 0.0])
    assert state.travelled == pytest.approx(2.0)


def test_without_a_recorded_world_a_recorded_robot_says_what_is_missing() -> None:
    area = Area(np.zeros(2), np.ones(2))
    world = UniformWorldKind.world(UniformWorldKind.Config(targets=1), area, 0)
    context = DeviceContext(robot="r1", seed=0, area=area, world=world, start=np.zeros(4))
    with pytest.raises(MissionError, match=r"r1 replays a recording.*\[world\]"):
        RecordedVehicleKind.device(VehicleConfig(robot=1), context)


def test_a_missing_recording_is_one_sentence_that_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"does not exist; set `data`"):
        RecordedWorldKind.world(WorldConfig(data=tmp_path / "none"), Area(np.zeros(2), np.ones(2)), 0)


@pytest.mark.data
@recorded
def test_the_first_minute_of_the_real_recording_finds_landmarks_and_no_robots() -> None:
    """The mission's own team on the sets of all robots up to 75 s, in the ledger's order; seed 1."""
    team = Team.of(mission_file.load(ROOT / "missions" / "mrclam.toml"))
    world = team.world(0)
    sets = []
    for robot, model in team.sensor_models.items():
        vehicle, sensor = team.vehicle(robot, 0, world), team.sensor(robot, 0, world)
        number, time = 0, sensor.next_capture(-1.0)
        while time is not None and time < 75.0:
            pose = vehicle.state(time).pose
            sets.append((time, robot, number, model, pose, sensor.measure(time, pose)))
            number, time = number + 1, sensor.next_capture(time)
    search = team.search()
    state = search.init(generator(1, "prior"))
    for time, robot, number, model, pose, measurements in sorted(sets, key=lambda s: s[:3]):
        rng = generator(1, robot, number)
        state = search.apply(state, model, pose, measurements, time, rng, robot)
    apart = np.linalg.norm(state.found[:, :, None] - world.targets(0.0)[:, None, :], axis=0)
    matched = int((apart.min(axis=0) < 0.25).sum())
    assert matched >= 6
    assert int((apart.min(axis=1) >= 0.25).sum()) == 0
