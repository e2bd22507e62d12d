"""Reading MRCLAM recordings: a small made-up one for the rare cases, the real one for the usual."""

from pathlib import Path

import numpy as np
import pytest

from agents.errors import DataError
from bridges.mrclam.mrclam import Camera, read_frames, read_landmarks, read_track, start_time

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "MRCLAM_Dataset6"
PERIOD = 0.235
recorded = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there")


def write(directory: Path, name: str, *rows: str) -> None:
    (directory / name).write_text("# a comment\n" + "".join(row + "\n" for row in rows))


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Robot 1 goes east at 1 m/s and turns through pi; it sees something at 2.0, 2.001, 3.0 and 3.25 s."""
    poses = [f"{100 + t / 10:.3f} {t / 10} 0.0 {np.angle(np.exp(1j * (3.0 + t / 50)))}" for t in range(51)]
    write(tmp_path, "Robot1_Groundtruth.dat", *poses)
    lines = ("102.000 5 2.0 0.1", "102.001 14 3.0 -0.1", "103.000 5 2.0 0.2", "103.250 7 1.0 0.0")
    write(tmp_path, "Robot1_Measurement.dat", *lines)
    write(tmp_path, "Robot1_Odometry.dat", "101.0 0.1 0.0", "104.0 0.1 0.0")
    write(tmp_path, "Landmark_Groundtruth.dat", "6 1.0 2.0 0.0 0.0", "7 3.0 4.0 0.0 0.0")
    return tmp_path


def test_lines_of_one_instant_are_one_set(small: Path) -> None:
    frames = read_frames(small, 1, Camera(), 0.25)
    seen = [i for i in range(len(frames.times)) if len(frames.at(i))]
    assert [len(frames.at(i)) for i in seen] == [2, 1, 1]
    assert frames.times[seen] == pytest.approx([2.0, 3.0, 3.25])


def test_empty_frames_fill_gaps_evenly_from_the_logs_begin_to_its_end(small: Path) -> None:
    frames = read_frames(small, 1, Camera(), 0.25)
    assert frames.times == pytest.approx(np.arange(1.0, 4.01, 0.25))
    assert frames.empty == len(frames.times) - 3


def test_frames_carry_the_time_of_the_exposure(small: Path) -> None:
    stamped, exposed = (read_frames(small, 1, Camera(delay=d), 0.25) for d in (0.0, 0.04))
    assert exposed.times[:8] == pytest.approx(stamped.times[:8] - 0.04)


def test_between_captures_the_pose_is_interpolated_the_short_way_round(small: Path) -> None:
    track = read_track(small, 1)
    assert track.pose(1.05)[:2] == pytest.approx([1.05, 0.0])
    assert np.exp(1j * track.pose(0.75)[3]) == pytest.approx(np.exp(1j * 3.15))
    assert track.velocity(2.0) == pytest.approx([1.0, 0.0, 0.0])
    assert track.way(3.0) == pytest.approx(3.0)


def test_outside_the_recording_a_robot_stands(small: Path) -> None:
    track = read_track(small, 1)
    assert track.pose(99.0)[:2] == pytest.approx([5.0, 0.0])
    assert track.velocity(99.0) == pytest.approx([0.0, 0.0, 0.0])


def test_a_corrected_line_is_depth_seen_from_the_robots_centre() -> None:
    camera = Camera(depth_scale=0.5, forward=0.1)
    x, y = 2.0, 1.0  # from the camera
    line = np.array([[x / 0.5, np.arctan2(y, x)]])
    assert camera.correct(line)[0] == pytest.approx([np.hypot(x + 0.1, y), np.arctan2(y, x + 0.1)])


def test_a_missing_directory_is_one_sentence_that_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"does not exist; set `data`"):
        start_time(tmp_path / "nowhere")
    with pytest.raises(DataError, match="not an MRCLAM directory"):
        read_landmarks(tmp_path)


@pytest.mark.parametrize(
    ("name", "rows", "says"),
    [
        ("Robot1_Measurement.dat", ["102.0 5 2.0"], "4 finite numbers"),
        ("Robot1_Measurement.dat", ["102.0 5 2.0 nan"], "4 finite numbers"),
        ("Robot1_Measurement.dat", ["102.0 5 two 0.1"], "not an MRCLAM table"),
        ("Robot1_Measurement.dat", ["102.0 5 2 0", "101.0 5 2 0"], "go back"),
        ("Robot1_Odometry.dat", [], "not an MRCLAM table"),
    ],
)
def test_a_malformed_file_is_named(small: Path, name: str, rows: list[str], says: str) -> None:
    write(small, name, *rows)
    with pytest.raises(DataError, match=says) as caught:
        read_frames(small, 1, Camera(), 0.25)
    assert name in str(caught.value)


def test_a_missing_file_is_named(small: Path) -> None:
    (small / "Robot1_Odometry.dat").unlink()
    with pytest.raises(DataError, match=r"Robot1_Odometry\.dat cannot be read"):
        read_frames(small, 1, Camera(), 0.25)


@pytest.mark.data
@recorded
@pytest.mark.parametrize(
    ("robot", "frames", "empty", "lines"),
    [
        (1, 3229, 2062, 1942),
        (2, 3744, 1549, 4031),
        (3, 3718, 1297, 5627),
        (4, 3748, 2407, 2399),
        (5, 3740, 1217, 5378),
    ],
)
def test_the_real_camera_frames_are_rebuilt(robot: int, frames: int, empty: int, lines: int) -> None:
    rebuilt = read_frames(DATA, robot, Camera(), PERIOD)
    gaps = np.diff(rebuilt.times)
    assert (len(rebuilt.times), rebuilt.empty, len(rebuilt.measurements)) == (frames, empty, lines)
    assert gaps.min() > 0.14
    assert gaps.max() < 0.36
    assert np.median(gaps) == pytest.approx(PERIOD, abs=0.003)


@pytest.mark.data
@recorded
def test_the_real_recording_has_five_robots_and_fifteen_landmarks() -> None:
    assert read_landmarks(DATA).shape == (2, 15)
    ends = [read_track(DATA, robot).times[-1] for robot in range(1, 6)]
    assert ends == pytest.approx([771.9, 900.0, 900.0, 900.0, 900.0], abs=0.1)
