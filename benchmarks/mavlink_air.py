"""Simulated MAVLink vehicles in processes of their own, and what bridging them costs."""

import multiprocessing
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing.synchronize import Event as Flag
from typing import Any

import numpy as np

from agents.clock import TeamClock
from agents.devices import DeviceContext
from bridges.mavlink.bridge import Bridge
from bridges.mavlink.device import MavlinkVehicle
from bridges.mavlink.dialect import mavlink
from bridges.mavlink.kind import MavlinkConfig, MavlinkKind
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.port import Port
from bridges.mavlink.wanted import GoTo, Wanted
from estimator.arrays import FloatArray
from estimator.filter import Area
from sim.mavlink.serve import Served
from sim.mavlink.settings import Settings

POSITION = "LOCAL_POSITION_NED"


def _serve(urls: Any, count: int, end: Flag) -> None:
    with ExitStack() as stack:
        served = [
            stack.enter_context(Served(Settings(system_id=index + 1, ready_after=0.2)))
            for index in range(count)
        ]
        urls.put([one.url for one in served])
        end.wait()


@contextmanager
def vehicles(count: int) -> Iterator[list[str]]:
    """The addresses of so many ArduPilot copters, in a process that is not measured."""
    context = multiprocessing.get_context("spawn")
    urls, end = context.Queue(), context.Event()
    process = context.Process(target=_serve, args=(urls, count, end), daemon=True)
    process.start()
    try:
        yield urls.get(timeout=60)
    finally:
        end.set()
        process.join(10)
        process.kill()


def flying(urls: list[str], stack: ExitStack) -> list[Bridge]:
    """Bridges whose vehicles hover."""
    bridges = [
        stack.enter_context(Bridge(url, PilotConfig(system=index + 1, take_off_height=2.0)))
        for index, url in enumerate(urls)
    ]
    end = time.monotonic() + 40
    while time.monotonic() < end:
        for bridge in bridges:
            bridge.want(Wanted(GoTo(np.array([0.0, 0.0, -2.0]))))
        if all(bridge.report().phase == "flying" for bridge in bridges):
            return bridges
        time.sleep(0.1)
    raise RuntimeError(f"not all are flying: {[bridge.report().trouble for bridge in bridges]}")


class _NoTargets:
    def targets(self, time: float) -> FloatArray:
        return np.zeros((2, 0))


def piloted(urls: list[str], stack: ExitStack) -> list[tuple[MavlinkVehicle, TeamClock]]:
    """Vehicles as robots have them, up and following a way."""
    area, start = Area(np.zeros(2), np.full(2, 200.0)), np.array([5.0, 100.0, 3.0, 0.0])
    made = []
    for index, url in enumerate(urls):
        config = MavlinkConfig(url=url, system_id=index + 1, take_off_m=2.0)
        vehicle = MavlinkKind.connect(config, DeviceContext("r", 0, area, _NoTargets(), start))
        assert isinstance(vehicle, MavlinkVehicle)
        stack.callback(vehicle.close)
        vehicle.prepare()
        clock = TeamClock(time.time())
        vehicle.join(clock)
        made.append((vehicle, clock))
    end = time.monotonic() + 40
    while not all(vehicle.state(clock.now()).able for vehicle, clock in made):
        if time.monotonic() > end:
            raise RuntimeError(f"not all are flying: {made}")
        tend(made)
        time.sleep(0.1)
    model = MavlinkKind.model(MavlinkConfig(url=urls[0]), area)
    for vehicle, clock in made:
        now = clock.now()
        way = model.trajectory(vehicle.state(now).state, np.array([195.0, 100.0, 3.0]), now, 1.0)
        vehicle.follow(way, now)
    return made


def tend(made: list[tuple[MavlinkVehicle, TeamClock]]) -> None:
    """What a robot's process does ten times a second, and a look at the pose as often."""
    for vehicle, clock in made:
        now = clock.now()
        vehicle.tend(now, 0.0)
        vehicle.state(now)


def load(count: int, seconds: float) -> float:
    """Per cent of a core that one bridged vehicle takes, all of them on a way, at 10 Hz both ways."""
    with vehicles(count) as urls, ExitStack() as stack:
        made = piloted(urls, stack)
        used, begin = time.process_time(), time.monotonic()
        while time.monotonic() - begin < seconds:
            tend(made)
            time.sleep(0.1)
        return 100 * (time.process_time() - used) / (time.monotonic() - begin) / count


class _Ears:
    """Stands in for a vehicle: notes when setpoints come, and says positions when told."""

    def __init__(self, url: str) -> None:
        self.port = Port(url, (1, 1))

    def beat(self) -> None:
        mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self.port.send([mavlink.MAVLink_heartbeat_message(2, 3, mode, 4, 3, 3)])


def setpoint_latencies(count: int) -> list[float]:
    """Milliseconds from `Bridge.want` to the bytes of the setpoint leaving, each for one new place."""
    found: list[float] = []
    with vehicles(1) as urls, ExitStack() as stack:
        (bridge,) = flying(urls, stack)
        port = bridge._port
        send, left = port.send, [0.0]

        def noted(messages: Any, to_all: bool = False) -> None:
            send(messages, to_all)
            if any(getattr(message, "x", None) == wanted[0] for message in messages):
                left[0] = time.perf_counter()

        wanted = [0.0]
        port.send = noted  # type: ignore[method-assign]
        random = np.random.default_rng(1)
        for index in range(count):
            time.sleep(random.uniform(0.02, 0.12))
            wanted[0] = 0.125 + index / 1024
            left[0], begin = 0.0, time.perf_counter()
            bridge.want(Wanted(GoTo(np.array([wanted[0], 0.0, -2.0]))))
            while not left[0] and time.perf_counter() - begin < 0.5:
                time.sleep(0.0002)
            found.append(1e3 * (left[0] - begin))
    return found


def telemetry_latencies(count: int) -> list[float]:
    """Milliseconds from a position's bytes being sent to the snapshot that has it."""
    found: list[float] = []
    with Bridge("udpin:127.0.0.1:24777", PilotConfig()) as bridge:
        vehicle = _Ears("udpout:127.0.0.1:24777")
        random = np.random.default_rng(2)
        for index in range(count + 20):
            time.sleep(random.uniform(0.02, 0.1))
            vehicle.port.poll(0.0)
            if index % 10 == 0:
                vehicle.beat()
            begin = time.perf_counter()
            x = 1.0 + index
            vehicle.port.send([mavlink.MAVLink_local_position_ned_message(1000 + index, x, 0, 0, 0, 0, 0)])
            while time.perf_counter() - begin < 0.5:
                position = bridge.report().position
                if position is not None and position[0] == x:
                    break
                time.sleep(0.0002)
            if index >= 20:
                found.append(1e3 * (time.perf_counter() - begin))
        vehicle.port.close()
    return found


def reconnect(count: int) -> list[float]:
    """Seconds from a vehicle's TCP port being open again until the bridge hears it."""
    found: list[float] = []
    with Served(Settings(ready_after=0.2)) as vehicle, Bridge(vehicle.url, PilotConfig()) as bridge:
        for index in range(count):
            _wait(lambda: bridge.report().link.open and bridge.report().phase == "ready")
            vehicle.cut()
            time.sleep(1.0 + 0.5 * index)
            received = (bridge.report().counters or {}).get("received", 0)
            vehicle.mend()
            begin = time.monotonic()
            _wait(lambda before=received: (bridge.report().counters or {}).get("received", 0) > before)
            found.append(time.monotonic() - begin)
    return found


def _wait(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 10
    while not condition():
        if time.monotonic() > end:
            raise RuntimeError("the link did not come back")
        time.sleep(0.005)
