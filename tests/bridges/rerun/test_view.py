"""The recording that a view leaves behind: complete, readable, and indifferent to odd messages."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
from rerun.chunk import RrdReader

from agents.errors import LinkError, StorageError
from agents.wire import messages as m
from agents.wire.transport import Peer, PeerChange
from bridges.rerun import blueprint as paths
from bridges.rerun.view import RerunView
from tests.bridges.rerun_story import REACH, Outline, Story, mission

ALWAYS = {
    paths.AREA,
    paths.EXPLORATION,
    paths.INTENSITY,
    paths.CLUSTERS,
    paths.FOUND,
    paths.TRUTH,
    paths.ROBOTS,
    paths.HEADINGS,
    paths.TRAILS,
    paths.VIEWS,
    paths.PLANS,
    paths.PLAN_MEASUREMENTS,
    paths.PLAN_WAYPOINTS,
    paths.TARGETS_PLOT,
    paths.POSTERIOR_PLOT,
    paths.LATENESS_PLOT,
    paths.TROUBLE_PLOT,
    f"{paths.STATES}/r1",
    f"{paths.EVENTS}/fusion",
    paths.SUMMARY,
}


def record(path: Path, dimension: int, duration: float = 12.0) -> RerunView:
    story = Story(mission(dimension), duration=duration)
    outlines = {robot.id: Outline(REACH * 200.0, dimension) for robot in story.mission.robots}
    view = RerunView(story.mission, outlines=outlines, record=path)
    shown = 0.0
    for topic, message in story.messages():
        if message.time > shown:
            view.show(shown)
            shown = message.time
        view.on_message(topic, message)
    view.show()
    view.close()
    return view


def rows(path: Path, entity: str) -> list[dict[str, object]]:
    """All rows of one entity of the recording."""
    return [
        row
        for chunk in RrdReader(path).stream()
        if chunk.entity_path.strip("/") == entity
        for row in chunk.to_record_batch().to_pylist()
    ]


def entities(path: Path) -> set[str]:
    return {chunk.entity_path.strip("/") for chunk in RrdReader(path).stream()}


@pytest.mark.parametrize("dimension", [2, 3])
def test_recording_can_be_read_back_and_holds_every_part_of_the_picture(
    tmp_path: Path, dimension: int
) -> None:
    view = record(tmp_path / "view.rrd", dimension)

    assert view.ignored == 0
    assert entities(tmp_path / "view.rrd") >= ALWAYS


def test_recording_brings_its_layout(tmp_path: Path) -> None:
    record(tmp_path / "view.rrd", 2, duration=2.0)

    reader = RrdReader(tmp_path / "view.rrd")
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) == 1


def test_all_robots_are_one_batch(tmp_path: Path) -> None:
    record(tmp_path / "view.rrd", 3, duration=3.0)

    drawn = [row for row in rows(tmp_path / "view.rrd", paths.ROBOTS) if row.get("Points3D:positions")]

    assert drawn
    assert all(len(row["Points3D:positions"]) == 4 for row in drawn)  # type: ignore[arg-type]


def test_message_of_another_dimension_or_an_impossible_time_is_ignored_and_counted(tmp_path: Path) -> None:
    flat, solid = Story(mission(2), duration=2.0), Story(mission(3), duration=2.0)
    view = RerunView(flat.mission, record=tmp_path / "view.rrd")
    wrong = [
        message
        for _, message in solid.messages()
        if isinstance(message, m.PosteriorMessage | m.PictureMessage | m.TruthMessage)
    ]
    late = msgspec.structs.replace(next(flat.messages())[1], time=1e300)

    for message in [*wrong, late]:
        view.on_message("any", message)
        view.show()
    view.close()

    assert view.ignored == len(wrong) + 1
    assert paths.FOUND not in entities(tmp_path / "view.rrd")


def test_empty_posterior_picture_and_plan_are_drawn(tmp_path: Path) -> None:
    story = Story(mission(2))
    view = RerunView(story.mission, record=tmp_path / "view.rrd")
    header = {"team": "searchparty", "sender": "fusion", "boot": "b", "sequence": 0, "time": 1.0}
    none = np.zeros((2, 0))
    view.on_message(
        "posterior",
        m.PosteriorMessage(
            **header,
            watermark={},
            applied=0,
            expected_cardinality=0.0,
            means=none,
            covariances=np.zeros((0, 2, 2)),
            masses=np.zeros(0),
            radii=np.zeros(0),
            velocities=none,
            found=none,
            found_covariances=np.zeros((0, 2, 2)),
            found_velocities=none,
            found_times=np.zeros(0),
            found_labels=np.zeros(0, np.int64),
        ),
    )
    view.on_message(
        "picture",
        m.PictureMessage(
            **header, exploration=np.zeros((1, 1), np.uint8), points=none, weights=np.zeros(0, np.float32)
        ),
    )
    view.on_message("truth", m.TruthMessage(**header, targets=none))
    view.show()
    view.close()

    assert paths.SUMMARY in entities(tmp_path / "view.rrd")


def test_robot_whose_token_goes_is_shown_as_gone_and_comes_back(tmp_path: Path) -> None:
    story = Story(mission(2), duration=1.0)
    view = RerunView(story.mission, record=tmp_path / "view.rrd")
    for topic, message in story.messages():
        view.on_message(topic, message)
    for alive, now in ((False, 1.0), (True, 2.0)):
        view.on_peer(PeerChange(Peer("robot", "r1", "b1"), alive))
        view.show(now)
    view.close()

    drawn = rows(tmp_path / "view.rrd", f"{paths.STATES}/r1")
    states = [row["StateChange:state"] for row in drawn if "StateChange:state" in row]

    assert ["gone"] in states
    assert states[-1] == ["planning"]


def test_second_close_does_nothing(tmp_path: Path) -> None:
    view = record(tmp_path / "view.rrd", 2, duration=1.0)

    size = (tmp_path / "view.rrd").stat().st_size
    view.close()
    assert (tmp_path / "view.rrd").stat().st_size == size > 0


def test_recording_that_cannot_be_written_is_one_clear_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    with pytest.raises(StorageError, match="cannot write the recording"):
        RerunView(mission(2), record=tmp_path / "file" / "view.rrd")


def test_window_without_a_display_is_one_clear_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)

    with pytest.raises(LinkError, match="--view web"):
        RerunView(mission(2), mode="spawn")


@pytest.mark.processes
@pytest.mark.parametrize("blow", [signal.SIGSTOP, signal.SIGKILL])
def test_dead_or_frozen_viewer_costs_neither_the_recording_nor_the_end(
    tmp_path: Path, blow: signal.Signals
) -> None:
    view = RerunView(mission(3), record=tmp_path / "view.rrd", mode="web")
    viewer = view.output.viewer_pid
    assert viewer is not None
    time.sleep(1.0)
    os.kill(viewer, blow)
    for topic, message in Story(view.mission, duration=3.0).messages():
        view.on_message(topic, message)
        view.show()

    view.close()

    assert paths.ROBOTS in entities(tmp_path / "view.rrd")
    with pytest.raises(ProcessLookupError):
        os.kill(viewer, 0)


def test_no_other_room_imports_rerun() -> None:
    script = (
        "import sys, importlib, pkgutil\n"
        "for room in ('estimator', 'planner', 'agents', 'sim'):\n"
        "    package = importlib.import_module(room)\n"
        "    for module in pkgutil.walk_packages(package.__path__, room + '.'):\n"
        "        if not module.name.endswith('__main__'):\n"
        "            importlib.import_module(module.name)\n"
        "import bridges.rerun.watch\n"
        "assert 'rerun' not in sys.modules and 'rerun_bindings' not in sys.modules\n"
    )

    subprocess.run([sys.executable, "-c", script], check=True, timeout=100)
