"""Detections by UDP become measurement sets at the time of their capture; bad ones are counted, told once."""

import random
import socket
import struct
import time
from collections.abc import Iterator

import msgpack
import numpy as np
import pytest

from agents.devices import DeviceContext, LiveSensor
from agents.errors import LinkError
from agents.mission.tables import convert
from bridges.mavlink.datagrams import Refused, reading
from bridges.mavlink.detections import SO_TIMESTAMPNS, UdpConfig, UdpDetections, UdpDetectionsKind
from estimator.arrays import FloatArray
from estimator.filter import Area

AREA = Area(np.zeros(2), np.full(2, 50.0))
MODEL = {"kind": "position", "period_s": 0.5, "sigma_m": 0.3, "box_m": [[-60.0, 60.0], [-60.0, 60.0]]}
GOOD = {"v": 1, "age_s": 0.25, "z": [[1.0, 2.0], [3.0, 4.0]]}


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Bench:
    """A sensor with a port of its own, and somebody who sends to it."""

    def __init__(self, speed: float = 1.0) -> None:
        self.config = convert({"port": free_port(), "model": MODEL}, UdpConfig)
        context = DeviceContext("r1", 0, AREA, None, np.zeros(4), speed=speed)  # type: ignore[arg-type]
        self.sensor = UdpDetectionsKind.listen(self.config, context)
        self.peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, what: object) -> None:
        data = what if isinstance(what, bytes) else msgpack.packb(what)
        self.peer.sendto(data, ("127.0.0.1", self.config.port))

    def close(self) -> None:
        self.sensor.close()
        self.peer.close()


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


def here(time: float) -> FloatArray | None:
    return np.array([time, 0.0, 5.0, 0.0])


BAD = [
    (b"", "not_msgpack"),
    (b"\x93\x01\x02", "not_msgpack"),
    (b"\xc1", "not_msgpack"),
    (msgpack.packb([1, 2]), "not_a_map"),
    (msgpack.packb({**GOOD, "v": 2}), "version"),
    (msgpack.packb({"age_s": 0.1, "z": []}), "version"),
    (msgpack.packb({**GOOD, "age": 1}), "unknown_key"),
    (msgpack.packb({"v": 1, "age_s": 0.1}), "no_set"),
    (msgpack.packb({"v": 1, "z": []}), "time"),
    (msgpack.packb({**GOOD, "unix_s": 1.0}), "time"),
    (msgpack.packb({**GOOD, "age_s": "soon"}), "time"),
    (msgpack.packb({**GOOD, "age_s": True}), "time"),
    (msgpack.packb({**GOOD, "age_s": float("nan")}), "not_finite"),
    (msgpack.packb({**GOOD, "age_s": -1.0}), "future"),
    (msgpack.packb({**GOOD, "age_s": 9.0}), "too_old"),
    (msgpack.packb({"v": 1, "unix_s": 1000.0, "z": []}), "too_old"),
    (msgpack.packb({"v": 1, "unix_s": 3e9, "z": []}), "future"),
    (msgpack.packb({**GOOD, "seq": -1}), "seq"),
    (msgpack.packb({**GOOD, "seq": 1.5}), "seq"),
    (msgpack.packb({**GOOD, "z": {}}), "shape"),
    (msgpack.packb({**GOOD, "z": [1.0, 2.0]}), "shape"),
    (msgpack.packb({**GOOD, "z": [[1.0]]}), "shape"),
    (msgpack.packb({**GOOD, "z": [[1.0, None]]}), "shape"),
    (msgpack.packb({**GOOD, "z": [[1.0, float("inf")]]}), "not_finite"),
    (msgpack.packb({**GOOD, "z": [[0.0, 0.0]] * 201}), "too_many"),
    (bytes(60_001), "too_large"),
]


@pytest.mark.parametrize(("data", "word"), BAD)
def test_every_bad_datagram_has_its_word(data: bytes, word: str) -> None:
    with pytest.raises(Refused) as caught:
        reading(data, 2e9, 2, 200, 2.0)
    assert caught.value.word == word
    assert str(caught.value)


def test_a_good_datagram_says_its_set_and_its_age() -> None:
    found = reading(msgpack.packb(GOOD), 2e9, 2, 200, 2.0)
    assert (found.age, found.sequence) == (0.25, None)
    assert found.rows.tolist() == GOOD["z"]
    unix = reading(msgpack.packb({"v": 1, "unix_s": 2e9 - 1.5, "seq": 7, "z": []}), 2e9, 2, 200, 2.0)
    assert (unix.age, unix.sequence, unix.rows.shape) == (1.5, 7, (0, 2))


@pytest.mark.parametrize("seed", range(3))
def test_garbage_is_refused_and_never_raises_anything_else(seed: int) -> None:
    chance = random.Random(seed)
    good = bytearray(msgpack.packb(GOOD))
    refused = 0
    for _ in range(3000):
        data = bytearray(good) if chance.random() < 0.7 else bytearray(chance.randbytes(chance.randrange(80)))
        for _ in range(chance.randrange(1, 4)):
            if data:
                data[chance.randrange(len(data))] = chance.randrange(256)
        try:
            found = reading(bytes(data), 2e9, 2, 200, 2.0)
        except Refused:
            refused += 1
        else:
            assert np.isfinite(found.rows).all(), f"repeat with seed {seed}"
            assert 0.0 <= found.age <= 2.0
    assert refused > 1000


@pytest.fixture
def stamping() -> Iterator[None]:
    """The kernel stamps what comes: it begins a while after the first socket asked."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        probe.bind(("127.0.0.1", 0))
        for _ in range(200):
            sent = time.time()
            probe.sendto(b"?", probe.getsockname())
            time.sleep(0.05)
            _, extra, _, _ = probe.recvmsg(8, 64)
            if stamped(extra[0][2]) < sent + 0.04:
                break
        else:
            pytest.fail("the kernel does not stamp datagrams")
        yield  # for as long as a socket asks, it goes on


def stamped(data: bytes) -> float:
    seconds, nanoseconds = struct.unpack_from("@qq", data)
    return float(seconds + 1e-9 * nanoseconds)


@pytest.mark.usefixtures("stamping")
@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_sets_carry_the_team_time_of_their_capture_and_the_pose_then(speed: float) -> None:
    bench = Bench(speed)
    bench.send({**GOOD, "age_s": 0.5})
    bench.send({"v": 1, "unix_s": time.time() - 1.0, "z": []})
    time.sleep(0.2)  # it is read late, which must not make it younger
    late, fresh = bench.sensor.arrived(100.0, here)
    bench.close()
    assert fresh.time == pytest.approx(100.0 - 0.7 * speed, abs=0.15 * speed)
    assert late.time == pytest.approx(100.0 - 1.2 * speed, abs=0.15 * speed)
    assert fresh.pose[0] == fresh.time
    assert fresh.measurements.tolist() == GOOD["z"]
    assert late.measurements.shape == (0, 2)


def test_each_reason_is_counted_and_told_once(bench: Bench) -> None:
    for _ in range(3):
        for data, _ in BAD:
            if len(data) <= 60_000:
                bench.send(data)
    bench.send(GOOD)
    (seen,) = bench.sensor.arrived(10.0, here)
    assert seen.measurements.tolist() == GOOD["z"]
    words = {word for data, word in BAD if len(data) <= 60_000}
    news = bench.sensor.news()
    assert len(news) == len(words)
    assert {level for level, _ in news} == {"warning"}
    assert bench.sensor.news() == []
    counts = bench.sensor.counters()
    assert {name for name in counts if "refused" in name} == {f"detections.refused.{word}" for word in words}
    assert counts["detections.refused.version"] == 6
    assert counts["detections.taken"] == 1


def test_what_came_twice_is_taken_once_and_gaps_are_counted(bench: Bench) -> None:
    for number in (5, 5, 6, 10, 9):
        bench.send({**GOOD, "seq": number})
    assert len(bench.sensor.arrived(10.0, here)) == 3
    counts = bench.sensor.counters()
    assert counts["detections.refused.repeated"] == 2
    assert counts["detections.lost"] == 3
    bench.send({**GOOD, "seq": 5000})
    bench.send({**GOOD, "seq": 0})  # a sender that has started anew
    assert len(bench.sensor.arrived(10.0, here)) == 2


def test_a_flood_is_read_in_parts_and_silence_says_nothing(bench: Bench) -> None:
    assert bench.sensor.arrived(10.0, here) == []
    for _ in range(300):
        bench.send({"v": 1, "age_s": 0.0, "z": []})
    first = len(bench.sensor.arrived(10.0, here))
    assert first <= 256
    assert first + len(bench.sensor.arrived(10.0, here)) <= 300


def test_a_set_of_a_time_when_nobody_knows_the_pose_is_refused_once_the_robot_has_begun(bench: Bench) -> None:
    bench.send(GOOD)
    assert bench.sensor.arrived(10.0, lambda time: None) == []
    assert bench.sensor.counters()["detections.early"] == 1
    assert bench.sensor.news() == []
    bench.send(GOOD)
    assert bench.sensor.arrived(20.0, lambda time: None) == []
    assert bench.sensor.counters()["detections.refused.no_pose"] == 1


def test_a_busy_port_is_one_sentence() -> None:
    first = Bench()
    with pytest.raises(LinkError, match="give this robot's sensor another port"):
        UdpDetections(first.config, 2)
    first.close()


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ({}, "model.kind: one of"),
        ({"kind": "nothing"}, "model.kind: one of"),
        ({"kind": "udp_detections", "model": MODEL}, "is a detector itself"),
        ({**MODEL, "sigma_m": -1.0}, "sigma_m"),
        ({**MODEL, "typo": 1}, "typo"),
    ],
)
def test_a_wrong_model_is_named(model: dict[str, object], words: str) -> None:
    with pytest.raises(Exception, match=words):
        convert({"model": model}, UdpConfig)


def test_the_device_in_virtual_time_is_the_model_s_simulation() -> None:
    class World:
        def targets(self, time: float) -> FloatArray:
            return np.array([[10.0], [20.0]])

    config = convert({"model": {**MODEL, "gain": 1.0, "clutter": 0.0}}, UdpConfig)
    context = DeviceContext("r1", 0, AREA, World(), np.zeros(4))
    device = UdpDetectionsKind.device(config, context)
    assert not isinstance(device, LiveSensor)
    rows = device.measure(0.0, np.array([10.0, 20.0, 5.0, 0.0]))
    assert rows == pytest.approx(np.array([[10.0, 20.0]]), abs=3.0)
    assert config.period_s == 0.5
