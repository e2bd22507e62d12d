"""`kind = "mavlink_detections"`: a robot's sensor is a camera that speaks MAVLink.

It listens at a URL of its own (a router such as mavlink-router gives it one) and takes LANDING_TARGET and
CAMERA_TRACKING_IMAGE_STATUS. Messages of one time make one set. An idle tracker says that nothing is seen; of
a landing-target detector whose `component_id` is given, a heartbeat without targets counts as that.
"""

import math
import threading
import time
from collections import deque
from dataclasses import replace
from typing import Annotated, Any, Literal, cast

import numpy as np
from msgspec import Meta

from agents.devices import DeviceContext, LiveSensor, Poses, Seen, Sensor
from agents.errors import MissionError
from bridges.mavlink.datagrams import Refused
from bridges.mavlink.detections import DetectionsConfig
from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.port import Port
from bridges.mavlink.sightings import Sighting, landing_target, tracked
from bridges.mavlink.tally import Tally
from bridges.mavlink.url import parse_url
from bridges.mavlink.wire import HEARTBEAT
from estimator.arrays import FloatArray, NonNegative
from estimator.filter import Area
from estimator.sensor import GaussianSensor, SensorModel
from estimator.sensors.bearing_only import BearingOnly

DETECTIONS = (
    mavlink.MAVLINK_MSG_ID_LANDING_TARGET,
    mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_IMAGE_STATUS,
)
HEARTBEAT_S = 3.0  # a detector that was heard within this is alive
UNIX_US = 1e15  # a time stamp beyond is Unix time, one below the sender's time since its start
QUEUE = 500
NEARBY_S = 0.05  # messages without a time of their own that came within this are of one picture
Angle = Annotated[float, Meta(gt=0, lt=180)]
Id = Annotated[int, Meta(ge=1, le=255)]


class CameraConfig(DetectionsConfig, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A detector or a camera that speaks MAVLink."""

    url: str  # where to hear it: udpin:HOST:PORT, udpout:..., tcp:..., tcpin:... or serial:DEVICE:BAUD
    system_id: Id | None = None  # only this one's; left out: anybody's
    component_id: Id | None = None  # only this one's, and its silence is an empty set
    mount: Literal["down", "ahead"] = "down"  # where the camera looks
    field_deg: tuple[Angle, Angle] = (60.0, 45.0)  # of its picture, across and up; for camera tracking
    latency_s: NonNegative = 0.0  # age of what comes without a time stamp

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            parse_url(self.url)
        except MissionError as error:
            raise ValueError(str(error)) from None


class OneWay:
    """A sender's clock on ours: what came quickest of late tells the difference."""

    def __init__(self) -> None:
        self._gaps: deque[float] = deque(maxlen=100)
        self._last = -math.inf

    def captured(self, stamp: float, arrived: float) -> float:
        """When the sender's clock showed `stamp`, on the clock of `arrived`, s; never later than that."""
        if stamp < self._last - 1.0:  # it has started anew
            self._gaps.clear()
        self._last = stamp
        self._gaps.append(arrived - stamp)
        return stamp + min(self._gaps)


class CameraDetections(LiveSensor):
    """Hears a link with a thread, which notes when what came."""

    def __init__(self, config: CameraConfig, area: Area, speed: float = 1.0) -> None:
        self._config = config
        self._model = cast(GaussianSensor, CameraDetectionsKind.model(config, area))
        self._dimension = area.dimension
        self._speed = speed
        self._tally = Tally(config.url)
        self._clocks: dict[tuple[int, int], OneWay] = {}
        self._begin: float | None = None  # team time of the first look
        self._heartbeat = -math.inf
        self._last = -math.inf
        self._heard: deque[tuple[float, Message]] = deque(maxlen=QUEUE)
        self._ending = False
        self._port = Port(config.url, heed=self._heed)
        self._thread = threading.Thread(target=self._run, name=f"detections {config.url}", daemon=True)
        self._thread.start()

    def __repr__(self) -> str:
        return f"CameraDetections({self._port!r}, {self._tally!r})"

    def arrived(self, now: float, poses: Poses) -> list[Seen]:
        mono = time.monotonic()
        self._begin = now if self._begin is None else self._begin
        pictures: dict[float, list[Sighting]] = {}
        while self._heard and self._heard[0][0] < mono - NEARBY_S:  # the rest of a picture may still come
            came, message = self._heard.popleft()
            if message.get_type() == "HEARTBEAT":
                self._heartbeat = came
                continue
            self._tally.counts["received"] += 1
            try:
                taken, sighting = self._sighting(came, message)
                age = mono - taken
                if age > self._config.max_age_s:
                    raise Refused("too_old", f"a picture taken {age:.2f} s ago")
            except Refused as error:
                self._tally.refuse(error.word, str(error))
                continue
            self._last = max(self._last, came)
            known = next((t for t in pictures if abs(t - taken) < NEARBY_S), taken)
            pictures.setdefault(known, [])
            if sighting is not None:
                pictures[known].append(sighting)
        quiet = mono - self._last > self._config.period_s
        if quiet and mono - self._heartbeat < HEARTBEAT_S and not pictures:
            pictures[mono] = []
        seen = []
        for taken in sorted(pictures):
            made = self._seen(now - (mono - taken) * self._speed, pictures[taken], poses)
            if made is not None:
                seen.append(made)
        self._tally.counts["taken"] += len(seen)
        return seen

    def news(self) -> list[tuple[str, str]]:
        return self._tally.news()

    def counters(self) -> dict[str, int]:
        return self._tally.counters()

    def close(self) -> None:
        self._ending = True
        self._port.wake()
        self._thread.join(3.0)

    def _seen(self, capture: float, sightings: list[Sighting], poses: Poses) -> Seen | None:
        pose = poses(capture)
        if pose is None:
            if self._begin is not None and capture < self._begin:
                self._tally.counts["early"] += 1  # from before the robot began: nobody's fault
            else:
                self._tally.refuse("no_pose", "nobody knows where the robot was then")
            return None
        places: list[FloatArray] = []
        for sighting in sightings:
            place = sighting.place(pose, self._dimension)
            if place is None and isinstance(self._model, BearingOnly):
                place = replace(sighting, metres=1.0).place(pose, self._dimension)  # any will do
            if place is None:
                self._tally.refuse("no_distance", "it says no distance, and no ground is known to be there")
            else:
                places.append(place)
        if sightings and not places:
            return None  # something was seen: an empty set would say the contrary
        points = np.array(places).reshape(len(places), self._dimension).T
        rows = self._model.measure(np.ascontiguousarray(points), pose)
        return Seen(capture, pose, rows)

    def _sighting(self, came: float, message: Message) -> tuple[float, Sighting | None]:
        """When a message's picture was taken, on the monotonic clock, and what is in it."""
        config = self._config
        if message.get_type() == "LANDING_TARGET":
            return self._taken(came, message), landing_target(message, config.mount)
        across, up = (math.radians(angle) for angle in config.field_deg)
        return came - config.latency_s, tracked(message, config.mount, (across, up))

    def _taken(self, came: float, message: Message) -> float:
        stamp = message.time_usec / 1e6
        if stamp == 0:
            return came - self._config.latency_s
        if message.time_usec > UNIX_US:
            taken = came + stamp - (time.time() - time.monotonic() + came)
            if taken > came + NEARBY_S:
                raise Refused("future", f"a picture taken {taken - came:.2f} s from now: the clocks differ")
            return float(min(taken, came))
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if len(self._clocks) > 16:
            self._clocks.clear()
        return min(self._clocks.setdefault(sender, OneWay()).captured(stamp, came), came)

    def _heed(self, system: int, component: int, message: int) -> bool:
        config = self._config
        if config.system_id not in (None, system) or config.component_id not in (None, component):
            return False
        return message in DETECTIONS or (message == HEARTBEAT and config.component_id is not None)

    def _run(self) -> None:
        try:
            while not self._ending:
                for message in self._port.poll(0.2):
                    self._heard.append((time.monotonic(), message))
        finally:
            self._port.close()


class CameraDetectionsKind:
    """`kind = "mavlink_detections"`: landing targets and camera tracking, by MAVLink."""

    Config = CameraConfig

    @staticmethod
    def model(config: Any, area: Area) -> SensorModel:
        made: SensorModel = config.sensor_model(area)
        if not hasattr(made, "measure"):
            raise ValueError(f'model.kind: "{config.model["kind"]}" has no place for what a camera sees')
        return made

    @staticmethod
    def device(config: Any, context: DeviceContext) -> Sensor:
        return config.simulated(context)  # type: ignore[no-any-return]

    @staticmethod
    def listen(config: Any, context: DeviceContext) -> LiveSensor:
        return CameraDetections(config, context.area, context.speed)
