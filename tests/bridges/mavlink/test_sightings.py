"""What a MAVLink camera sees becomes a measurement of the point where it is."""

import math
import socket
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from agents.devices import DeviceContext, Seen
from agents.mission.tables import convert
from bridges.mavlink.camera_detections import CameraConfig, CameraDetections, CameraDetectionsKind, OneWay
from bridges.mavlink.datagrams import Refused
from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.sightings import Mount, landing_target, tracked
from estimator.arrays import FloatArray
from estimator.filter import Area

POSE = np.array([20.0, 10.0, 12.0, 0.7])
TARGET = np.array([24.0, 13.0, 0.0])
FLAT = Area(np.zeros(2), np.full(2, 50.0))


def body(target: FloatArray = TARGET) -> FloatArray:
    """Ahead, right, down from POSE to a point, by the usual rotation."""
    east, north, up = target - POSE[:3]
    c, s = math.cos(POSE[3]), math.sin(POSE[3])
    return np.array([c * east + s * north, s * east - c * north, -up])


def target(**given: float) -> Message:
    """A LANDING_TARGET."""
    fields = {"time_usec": 0, "target_num": 0, "frame": 12, "angle_x": 0.0, "angle_y": 0.0, "distance": 0.0}
    fields |= {"size_x": 0.0, "size_y": 0.0, "x": 0.0, "y": 0.0, "z": 0.0, "position_valid": 0} | given
    return mavlink.MAVLink_landing_target_message(**fields)


def angles(mount: Mount, ahead: float, right: float, down: float) -> tuple[float, float]:
    """The angles to the right and down the picture, as autopilots read them for a camera that looks down:
    the direction is (-tan y, tan x, 1) ahead, right and down."""
    if mount == "down":
        return math.atan(right / down), math.atan(-ahead / down)
    return math.atan(right / ahead), math.atan(down / ahead)


@pytest.mark.parametrize("mount", ["down", "ahead"])
def test_angles_and_a_distance_lead_to_the_point(mount: Mount) -> None:
    x, y = angles(mount, *body())
    seen = landing_target(target(angle_x=x, angle_y=y, distance=float(np.linalg.norm(body()))), mount)
    assert seen.place(POSE, 3) == pytest.approx(TARGET, abs=1e-6)
    assert seen.place(POSE, 2) == pytest.approx(TARGET[:2], abs=1e-6)


@pytest.mark.parametrize("mount", ["down", "ahead"])
def test_angles_alone_lead_to_the_ground_where_there_is_one(mount: Mount) -> None:
    x, y = angles(mount, *body())
    seen = landing_target(target(angle_x=x, angle_y=y), mount)
    assert seen.place(POSE, 2) == pytest.approx(TARGET[:2], abs=1e-6)
    assert seen.place(POSE, 3) is None
    assert landing_target(target(angle_y=-0.1), "ahead").place(POSE, 2) is None  # above the horizon


@pytest.mark.parametrize("frame", [8, 12, 20])
def test_a_position_around_the_robot_is_the_point(frame: int) -> None:
    ahead, right, down = body()
    seen = landing_target(target(position_valid=1, frame=frame, x=ahead, y=right, z=down), "down")
    assert seen.place(POSE, 3) == pytest.approx(TARGET, abs=1e-6)


@pytest.mark.parametrize("mount", ["down", "ahead"])
def test_a_tracked_place_in_the_picture_leads_to_the_point(mount: Mount) -> None:
    ahead, right, down = body(np.array([30.0, 17.0, 0.0]))
    across, up = math.radians(120), math.radians(100)
    x, y = angles(mount, ahead, right, down)
    u, v = (0.5 + 0.5 * math.tan(a) / math.tan(f / 2) for a, f in ((x, across), (y, up)))
    point = status(1, 1, u, v)
    seen = tracked(point, mount, (across, up))
    assert seen is not None
    assert seen.place(POSE, 2) == pytest.approx([30.0, 17.0], abs=1e-4)
    box = mavlink.MAVLink_camera_tracking_image_status_message(
        1, 2, 4, 0.0, 0.0, 0.0, u - 0.05, v - 0.05, u + 0.05, v + 0.05
    )
    middle = tracked(box, mount, (across, up))
    assert middle is not None
    assert middle.place(POSE, 2) == pytest.approx([30.0, 17.0], abs=1e-4)
    assert tracked(status(0, 0, 0.0, 0.0), mount, (across, up)) is None


def status(active: int, mode: int, x: float, y: float) -> Message:
    nan = math.nan
    return mavlink.MAVLink_camera_tracking_image_status_message(
        active, mode, 4, x, y, nan, nan, nan, nan, nan
    )


@pytest.mark.parametrize(
    ("message", "word"),
    [
        (target(angle_x=math.nan), "not_finite"),
        (target(angle_x=1.58), "not_finite"),
        (target(distance=-1.0), "not_finite"),
        (target(position_valid=1, x=math.inf), "not_finite"),
        (target(position_valid=1), "not_finite"),
        (target(position_valid=1, frame=1, x=1.0), "frame"),
    ],
)
def test_what_cannot_be_placed_has_a_word(message: Message, word: str) -> None:
    with pytest.raises(Refused) as caught:
        landing_target(message, "down")
    assert caught.value.word == word


@pytest.mark.parametrize("place", [(math.nan, 0.5), (1.2, 0.5), (0.5, -0.1)])
def test_a_place_outside_of_the_picture_is_none(place: tuple[float, float]) -> None:
    with pytest.raises(Refused):
        tracked(status(1, 1, *place), "down", (1.0, 0.8))


def test_a_sender_s_clock_is_learnt_from_what_came_quickest() -> None:
    clock = OneWay()
    delays = [0.3, 0.02, 0.2, 0.11, 0.05]
    errors = []
    for i, delay in enumerate(delays):
        taken = 500.0 + i
        errors.append(clock.captured(taken - 123.4, taken + delay) - taken)
    assert errors[0] == pytest.approx(0.3)
    assert errors[1:] == pytest.approx([0.02] * 4)
    assert clock.captured(0.0, 600.0) == 600.0  # it has started anew


# Over the wire


def until(condition: Callable[[], bool], seconds: float = 10.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return condition()


class Bench:
    """A sensor on a link, and a camera at the other end."""

    def __init__(self, **given: object) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = int(probe.getsockname()[1])
        model = {"kind": "range_bearing", "period_s": 0.2, "range_sigma_m": 0.5, "bearing_sigma_deg": 1.0}
        model |= {"reach_m": [20.0, 20.0], "bearing_frame": "body"}
        table = {"url": f"udpin:127.0.0.1:{self.port}", "model": model} | given
        self.config = convert(table, CameraConfig)
        context = DeviceContext("r1", 0, FLAT, None, np.zeros(4))  # type: ignore[arg-type]
        sensor = CameraDetectionsKind.listen(self.config, context)
        assert isinstance(sensor, CameraDetections)
        self.sensor = sensor
        assert until(lambda: sensor._port.state().open)
        self.peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._packer = mavlink.MAVLink(None, 1, 154)
        self.seen: list[Seen] = []

    def send(self, *messages: Message) -> None:
        for message in messages:
            self._packer.seq = (self._packer.seq + 1) % 256
            self.peer.sendto(message.pack(self._packer), ("127.0.0.1", self.port))

    def look(self) -> list[Seen]:
        self.seen += self.sensor.arrived(time.monotonic(), lambda _: POSE)
        return self.seen

    def close(self) -> None:
        self.sensor.close()
        self.peer.close()


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


def test_targets_of_one_picture_are_one_set_of_the_model(bench: Bench) -> None:
    other = np.array([18.0, 12.0, 0.0])
    messages = []
    for number, place in enumerate((TARGET, other)):
        x, y = angles("down", *body(place))
        messages.append(target(time_usec=5_000_000, target_num=number, angle_x=x, angle_y=y))
    begin = time.monotonic()
    bench.send(*messages)
    time.sleep(0.3)
    (seen,) = bench.look()
    delta = np.stack([TARGET, other])[:, :2] - POSE[:2]
    assert seen.measurements[:, 0] == pytest.approx(np.hypot(*delta.T), abs=1e-4)
    turn = np.arctan2(delta[:, 1], delta[:, 0]) - POSE[3]
    assert np.sin(seen.measurements[:, 1]) == pytest.approx(np.sin(turn), abs=1e-5)
    assert np.cos(seen.measurements[:, 1]) == pytest.approx(np.cos(turn), abs=1e-5)
    assert begin <= seen.time < time.monotonic() - 0.1  # when it came, not when it was looked at


def test_an_idle_tracker_says_that_it_sees_nothing_and_bad_messages_are_told_once(bench: Bench) -> None:
    bench.send(status(0, 0, 0.0, 0.0))
    assert until(lambda: len(bench.look()) == 1)
    assert bench.seen[0].measurements.shape == (0, 2)
    for _ in range(3):
        bench.send(target(position_valid=1, frame=1, x=1.0), target(angle_x=math.nan))
    assert until(lambda: (bench.look() is not None) and bench.sensor.counters()["detections.received"] == 7)
    bench.look()
    assert len(bench.seen) == 1
    assert len(bench.sensor.news()) == 2
    assert bench.sensor.news() == []
    assert bench.sensor.counters()["detections.refused.frame"] == 3


def heartbeat() -> Message:
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_CAMERA, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3
    )


def test_a_named_detector_that_lives_and_sends_nothing_sees_nothing_and_others_say_nothing() -> None:
    named, nameless = Bench(component_id=154), Bench()
    stranger = Bench(component_id=155)
    for bench in (named, nameless, stranger):
        bench.send(heartbeat())
    assert until(lambda: len(named.look()) > 0)
    assert named.seen[0].measurements.shape == (0, 2)
    time.sleep(0.3)
    assert nameless.look() == []
    assert stranger.look() == []
    for bench in (named, nameless, stranger):
        bench.close()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"url": "nonsense"}, "is no MAVLink address"),
        ({"mount": "up"}, "mount"),
        ({"field_deg": [0, 1]}, "field_deg"),
    ],
)
def test_a_wrong_table_is_named(given: dict[str, object], words: str) -> None:
    table = {
        "url": "udpin:127.0.0.1:14701",
        "model": {"kind": "position", "period_s": 1.0, "sigma_m": 1.0},
    } | given
    with pytest.raises(Exception, match=words):
        convert(table, CameraConfig)


def test_a_model_that_has_no_place_for_what_is_seen_is_refused() -> None:
    model = {"kind": "detector", "period_s": 1.0, "range_m": 10.0, "angle_deg": 60.0}
    config = convert({"url": "udpin:127.0.0.1:14701", "model": model}, CameraConfig)
    with pytest.raises(ValueError, match="no place for what a camera sees"):
        CameraDetectionsKind.model(config, FLAT)
