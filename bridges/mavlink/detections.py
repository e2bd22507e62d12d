"""`kind = "udp_detections"`: a robot's sensor is a detector on its companion computer.

`model` is the table of the sensor that it is, such as a range_bearing: what the filter believes of it, and
what it is simulated by in virtual time. Its measurements come as bridges.mavlink.datagrams says.
"""

import socket
import struct
import time
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from agents import plugins
from agents.devices import DeviceContext, LiveSensor, Poses, Seen, Sensor
from agents.errors import LinkError
from agents.mission.tables import convert
from bridges.mavlink.datagrams import LARGEST, Refused, reading
from bridges.mavlink.tally import Tally
from estimator.arrays import Count, Positive
from estimator.filter import Area
from estimator.sensor import SensorModel

SO_TIMESTAMPNS = 35  # Linux: the kernel says when a datagram came, however late it is read
AT_ONCE = 256  # datagrams read in one call: a flood must not hold up the robot
STREAMS = 16  # senders whose numbers are remembered
RESTARTED = 1000  # numbers back by which a sender has begun anew


class DetectionsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What all detectors say of their model."""

    model: dict[str, Any]  # a sensor's table with its kind: what a measurement is, and how good
    max_age_s: Positive = 2.0  # sets taken longer ago are refused

    def __post_init__(self) -> None:
        kind = self.model.get("kind")
        if not isinstance(kind, str) or kind not in plugins.kinds("sensors"):
            raise ValueError(f"model.kind: one of {', '.join(plugins.kinds('sensors'))}; found {kind!r}")
        if hasattr(plugins.load("sensors", kind), "listen"):
            raise ValueError(f'model.kind: "{kind}" is a detector itself; name the sensor that it is')
        try:
            self._model()
        except (msgspec.ValidationError, ValueError) as error:
            raise ValueError(f"model: {error}") from None

    @property
    def period_s(self) -> float:
        """How often it is looked for new sets."""
        return float(self._model()[1].period_s)

    def _model(self) -> tuple[Any, Any]:
        kind = plugins.load("sensors", str(self.model["kind"]))
        return kind, convert({k: v for k, v in self.model.items() if k != "kind"}, kind.Config)

    def sensor_model(self, area: Area) -> SensorModel:
        """What the filter believes of it."""
        kind, config = self._model()
        made: SensorModel = kind.model(config, area)
        return made

    def simulated(self, context: DeviceContext) -> Sensor:
        """What it is in virtual time."""
        kind, config = self._model()
        made: Sensor = kind.device(config, context)
        return made


class UdpConfig(DetectionsConfig, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A detector that sends datagrams."""

    port: Annotated[int, Meta(ge=1, le=65535)] = 14700
    host: str = "127.0.0.1"  # address to listen at; whoever reaches it is believed
    most: Count = 200  # measurements in a set


class UdpDetections(LiveSensor):
    """Reads its port when it is asked, without waiting."""

    def __init__(self, config: UdpConfig, size: int, speed: float = 1.0) -> None:
        """
        Raises:
            LinkError: if the port cannot be had.
        """
        self._config = config
        self._size = size
        self._speed = speed
        self._tally = Tally(f"udp:{config.host}:{config.port}")
        self._numbers: dict[object, int] = {}
        self._begin: float | None = None  # team time of the first look
        try:
            found = socket.getaddrinfo(config.host, config.port, type=socket.SOCK_DGRAM)
            self._socket = socket.socket(found[0][0], socket.SOCK_DGRAM)
            self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            self._socket.bind(found[0][4])
        except OSError as error:
            raise LinkError(
                f"cannot listen for detections at {config.host}:{config.port}: {error.strerror or error}; "
                "give this robot's sensor another port"
            ) from error
        self._socket.setblocking(False)

    def __repr__(self) -> str:
        return f"UdpDetections({self._tally!r})"

    def arrived(self, now: float, poses: Poses) -> list[Seen]:
        begin = self._begin = now if self._begin is None else self._begin
        seen = []
        for _ in range(AT_ONCE):
            try:
                data, extra, _, sender = self._socket.recvmsg(LARGEST + 1, 64)
            except (BlockingIOError, ConnectionError):
                break
            self._tally.counts["received"] += 1
            wall = time.time()
            came = _stamp(extra, wall)
            try:
                found = reading(data, came, self._size, self._config.most, self._config.max_age_s)
                self._number(sender, found.sequence)
                capture = now - (found.age + wall - came) * self._speed
                pose = poses(capture)
                if pose is None and capture < begin:
                    self._tally.counts["early"] += 1  # from before the robot began: nobody's fault
                    continue
                if pose is None:
                    raise Refused("no_pose", f"nobody knows where the robot was {now - capture:.2f} s ago")
            except Refused as error:
                self._tally.refuse(error.word, str(error))
                continue
            seen.append(Seen(capture, pose, found.rows))
        seen.sort(key=lambda one: one.time)
        self._tally.counts["taken"] += len(seen)
        return seen

    def news(self) -> list[tuple[str, str]]:
        return self._tally.news()

    def counters(self) -> dict[str, int]:
        return self._tally.counters()

    def close(self) -> None:
        self._socket.close()

    def _number(self, sender: object, number: int | None) -> None:
        """Note a sender's number; what is numbered as before is not taken twice."""
        if number is None:
            return
        last = self._numbers.pop(sender, None)
        self._numbers[sender] = number
        if len(self._numbers) > STREAMS:
            del self._numbers[next(iter(self._numbers))]
        if last is None or number < last - RESTARTED:
            return
        if number <= last:
            self._numbers[sender] = last
            raise Refused("repeated", f"seq is {number} after {last}")
        self._tally.counts["lost"] += number - last - 1


class UdpDetectionsKind:
    """`kind = "udp_detections"`: a companion detector's measurements, by UDP."""

    Config = UdpConfig

    @staticmethod
    def model(config: Any, area: Area) -> SensorModel:
        return config.sensor_model(area)  # type: ignore[no-any-return]

    @staticmethod
    def device(config: Any, context: DeviceContext) -> Sensor:
        return config.simulated(context)  # type: ignore[no-any-return]

    @staticmethod
    def listen(config: Any, context: DeviceContext) -> LiveSensor:
        return UdpDetections(config, config.sensor_model(context.area).measurement_size, context.speed)


def _stamp(extra: list[tuple[int, int, bytes]], wall: float) -> float:
    """When the kernel got a datagram, Unix seconds; without its word, now."""
    for level, kind, data in extra:
        if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS and len(data) >= 16:
            seconds, nanoseconds = struct.unpack_from("@qq", data)
            came = seconds + nanoseconds * 1e-9
            return float(came) if wall - 60.0 < came <= wall else wall
    return wall
