"""Robots that replay an MRCLAM recording: `kind = "mrclam"` for the world, the vehicles and the sensors.

The world names the directory; vehicles and sensors take it from there and name their robot's number. The
recorded robots went where they went, so nobody plans for them.
"""

from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from agents.devices import DeviceContext, Sensor, Vehicle, VehicleState, World
from agents.errors import MissionError
from bridges.mrclam.mrclam import Camera, Frames, Track, read_frames, read_landmarks, read_track
from estimator.arrays import Count, FloatArray, NonNegative, Positive
from estimator.filter import Area
from estimator.sensor import SensorModel
from estimator.sensors.range_bearing import RangeBearing, RangeBearingConfig
from planner.plan import Trajectory, VehicleModel
from planner.vehicles.unicycle import Unicycle


class Table(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table in which an unknown key is an error."""


class WorldConfig(Table, frozen=True, kw_only=True):
    """A recording's landmarks."""

    data: Path  # the MRCLAM directory


class VehicleConfig(Table, frozen=True, kw_only=True):
    """A recorded robot's way."""

    robot: Count  # its number in the recording


class CameraTable(Table, frozen=True, kw_only=True):
    """A calibrated camera, see bridges.mrclam.mrclam.Camera."""

    depth_scale: Positive = 1.0
    axis_deg: Annotated[float, Meta(ge=-45, le=45)] = 0.0
    forward_m: float = 0.0
    bearing_deg: float = 0.0
    bearing_slope: float = 0.0  # rad / rad
    bearing_curve: float = 0.0  # rad / rad^2
    delay_s: NonNegative = 0.0

    def camera(self) -> Camera:
        """In radians."""
        return Camera(
            self.depth_scale,
            float(np.radians(self.axis_deg)),
            self.forward_m,
            (float(np.radians(self.bearing_deg)), self.bearing_slope, self.bearing_curve),
            self.delay_s,
        )


class SensorConfig(RangeBearingConfig, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A recorded camera: a range-bearing sensor whose bearings are in the body frame."""

    robot: Count
    bearing_frame: Literal["body"] = "body"
    camera: CameraTable = CameraTable()


class RecordedWorld(World):
    """The landmarks are the targets."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self._landmarks = read_landmarks(directory)

    def __repr__(self) -> str:
        return f"RecordedWorld({str(self.directory)!r}, {self._landmarks.shape[1]} landmarks)"

    def targets(self, time: float) -> FloatArray:
        """True landmark positions (2, n); they stand still."""
        return self._landmarks


class RecordedVehicle(Vehicle):
    """A robot that is where the motion capture saw it."""

    follows_plans = False

    def __init__(self, track: Track, model: VehicleModel) -> None:
        self._track = track
        self._model = model

    def __repr__(self) -> str:
        return f"RecordedVehicle({self._track.way(inf):.1f} m until {self._track.times[-1]:.1f} s)"

    def state(self, now: float) -> VehicleState:
        """How the robot was at team time `now`."""
        pose = self._track.pose(now)
        return VehicleState(
            time=now,
            pose=pose,
            velocity=self._track.velocity(now),
            state=self._model.initial_state(pose),
            travelled=self._track.way(now),
            arrived=False,
        )

    def follow(self, trajectory: Trajectory | None, now: float) -> None:
        """A recording goes its own way."""


class RecordedSensor(Sensor):
    """A camera that gives the frames it gave, the empty ones too, each once at its own time."""

    def __init__(self, frames: Frames) -> None:
        self._frames = frames

    def __repr__(self) -> str:
        return f"RecordedSensor({len(self._frames.times)} frames, {self._frames.empty} empty)"

    def next_capture(self, after: float) -> float:
        """The time of the first frame after `after`; infinity at the recording's end."""
        index = int(np.searchsorted(self._frames.times, after, side="right"))
        return float(self._frames.times[index]) if index < len(self._frames.times) else inf

    def measure(self, now: float, pose: FloatArray) -> FloatArray:
        """The set (m, 2) of the newest frame at team time `now`; before the first frame, an empty one."""
        index = int(np.searchsorted(self._frames.times, now, side="right")) - 1
        return self._frames.at(index) if index >= 0 else np.zeros((0, 2))


class RecordedWorldKind:
    """`kind = "mrclam"`: the landmarks of a recording."""

    Config = WorldConfig

    @staticmethod
    def world(config: Any, area: Area, seed: int) -> World:
        """The same for every seed.

        Raises:
            DataError: if the recording is missing or malformed.
        """
        return RecordedWorld(config.data)


class RecordedVehicleKind:
    """`kind = "mrclam"`: the way of one recorded robot."""

    Config = VehicleConfig

    @staticmethod
    def model(config: Any, area: Area) -> VehicleModel:
        return Unicycle(Unicycle.Config())

    @staticmethod
    def device(config: Any, context: DeviceContext) -> Vehicle:
        model = RecordedVehicleKind.model(config, context.area)
        return RecordedVehicle(read_track(_directory(context), config.robot), model)


class RecordedSensorKind:
    """`kind = "mrclam"`: the camera frames of one recorded robot."""

    Config = SensorConfig

    @staticmethod
    def model(config: Any, area: Area) -> SensorModel:
        return RangeBearing.of(config, area)

    @staticmethod
    def device(config: Any, context: DeviceContext) -> Sensor:
        camera = config.camera.camera()
        return RecordedSensor(read_frames(_directory(context), config.robot, camera, config.period_s))


def _directory(context: DeviceContext) -> Path:
    if isinstance(context.world, RecordedWorld):
        return context.world.directory
    raise MissionError(
        f"robot {context.robot} replays a recording, but the mission's world is none; "
        'set [world] kind = "mrclam" and data = "PATH"'
    )
