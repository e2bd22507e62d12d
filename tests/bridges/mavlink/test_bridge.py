"""The thread around the pilot, flying a simulated vehicle over real sockets."""

import threading
import time
from collections.abc import Callable

import numpy as np

from bridges.mavlink.bridge import Bridge
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.signing import Keys
from bridges.mavlink.wanted import GoTo, Rest, TakeOff, Wanted
from sim.mavlink.serve import Served
from sim.mavlink.settings import Settings


def until(condition: Callable[[], bool], seconds: float = 20.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return condition()


def test_a_vehicle_is_flown_over_tcp_and_its_pose_comes_back() -> None:
    with (
        Served(Settings(ready_after=0.2), speed=3.0) as vehicle,
        Bridge(vehicle.url, PilotConfig(take_off_height=1.0)) as bridge,
    ):
        there = np.array([2.0, 1.0, -2.0])
        bridge.want(Wanted(GoTo(there)))

        def near() -> bool:
            at = bridge.report().position
            return at is not None and float(np.linalg.norm(at - there)) < 0.5

        assert until(near), (bridge.report(), bridge.events())
        report = bridge.report()
        assert report.ours
        assert report.captured is not None
        assert abs(time.monotonic() - report.captured) < 1.0
        assert report.gauges()["mavlink.armed"] == 1.0
    assert not any(thread.name.startswith("mavlink") for thread in threading.enumerate())


def test_a_signed_link_flies_and_an_unsigned_one_is_told() -> None:
    secret = bytes(range(32))
    with Served(Settings(signing_key=secret, ready_after=0.2)) as vehicle:
        with Bridge(vehicle.url, PilotConfig(), Keys(secret)) as bridge:
            bridge.want(Wanted(Rest()))
            assert until(lambda: bridge.report().phase == "ready"), bridge.report()
        with Bridge(vehicle.url, PilotConfig(), Keys(bytes(32))) as bridge:
            assert until(lambda: "compare the keys" in bridge.report().trouble), bridge.report()
        with Bridge(vehicle.url, PilotConfig()) as bridge:
            bridge.want(Wanted(TakeOff()))
            assert until(lambda: "signs its messages" in bridge.report().trouble), bridge.report()


def test_neither_wishes_nor_snapshots_wait_for_a_dead_link() -> None:
    with Bridge("tcp:127.0.0.1:9", PilotConfig()) as bridge:
        begin = time.monotonic()
        for _ in range(1000):
            bridge.want(Wanted(Rest()))
            bridge.report()
        assert time.monotonic() - begin < 10.0  # to wait for one step each would take 50 s
        assert until(lambda: "cannot be opened" in bridge.report().trouble)


def test_a_robot_that_does_not_look_after_its_vehicle_is_silent() -> None:
    now = [0.0]
    bridge = Bridge("tcp:127.0.0.1:9", PilotConfig(), clock=lambda: now[0])
    seen: list[float] = []
    bridge._pilot.step = lambda *arguments: seen.append(arguments[3]) or []  # type: ignore[method-assign, assignment, func-returns-value]
    bridge._step([])
    now[0] = 7.0
    bridge._step([])
    bridge.report()
    bridge._step([])
    assert seen == [0.0, 7.0, 0.0]
    bridge.close()


def test_a_defect_ends_the_bridge_s_control_and_is_told() -> None:
    with Served(Settings()) as vehicle:
        bridge = Bridge(vehicle.url, PilotConfig())

        def broken(*_: object) -> None:
            raise ZeroDivisionError("a defect")

        bridge._pilot.step = broken  # type: ignore[method-assign, assignment]
        with bridge:
            assert until(lambda: bridge.report().phase == "failed")
            assert "a defect" in bridge.report().trouble
            assert [event.level for event in bridge.events()] == ["error"]
