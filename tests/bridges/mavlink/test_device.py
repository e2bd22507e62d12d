"""The real vehicle of a robot, over loopback to a simulated autopilot: refused, flown, taken over, left."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.clock import TeamClock
from agents.devices import DeviceContext, VehicleState
from agents.errors import SearchpartyError
from bridges.mavlink import device
from bridges.mavlink.device import MavlinkVehicle
from bridges.mavlink.kind import MavlinkConfig, MavlinkKind
from estimator.filter import Area
from sim.mavlink.serve import Served
from sim.mavlink.settings import Fault, Settings
from tests.bridges.mavlink.fleet import ZERO

AREA = Area(np.array([0.0, 0.0]), np.array([100.0, 100.0]))
START = np.array([10.0, 10.0, 3.0, 0.0])


def context(**changes: Any) -> DeviceContext:
    return replace(DeviceContext("r1", 0, AREA, None, START), **changes)  # type: ignore[arg-type]


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextmanager
def connected(url: str, where: DeviceContext | None = None, **table: Any) -> Iterator[MavlinkVehicle]:
    config = MavlinkConfig(**{"url": url, "take_off_m": 2.0, "ready_after_s": 4.0, **table})
    vehicle = MavlinkKind.connect(config, where or context())
    assert isinstance(vehicle, MavlinkVehicle)
    try:
        yield vehicle
    finally:
        vehicle.close()


REFUSED: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "wrong id": ({}, {"system_id": 7}, "system 7 is not at"),
    "version 1": ({"version_1": True}, {}, "speaks only MAVLink 1"),
    "a rover": ({"type": "rover"}, {}, "is a rover, but the mission expects a copter"),
    "a copter": ({}, {"body": "rover"}, "is a copter, but the mission expects a rover"),
    "a PX4": ({"autopilot": "px4"}, {"autopilot": "ardupilot"}, "px4, but the mission expects ardupilot"),
    "failsafe": ({}, {"failsafes": {"ground link": "land"}}, 'relies on "land" for ground link'),
    "no position": ({"faults": (Fault("no_position"),)}, {}, "may not be armed after 4 s"),
    "flat battery": ({"faults": (Fault("battery", 0.0, value=10.0),)}, {}, "battery at 10%"),
    "signing": ({"signing_key": b"7" * 32}, {}, "signs its messages"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_may_not_fly_is_refused_in_one_sentence_and_never_armed(
    case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings, table, sentence = REFUSED[case]
    monkeypatch.setattr(device, "FOUND_S", 3.0)
    with Served(Settings(**{"ready_after": 0.2, **settings})) as served:
        with connected(served.url, **table) as vehicle, pytest.raises(SearchpartyError) as refused:
            vehicle.prepare()
        assert sentence in str(refused.value)
        assert str(refused.value).startswith(f"robot r1 at {served.url}: ")
        assert "\n" not in str(refused.value)
        assert not served.ask(lambda autopilot: autopilot.armed)


def test_nobody_at_the_address_is_said_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "FOUND_S", 0.5)
    with (
        connected("tcp:127.0.0.1:9") as vehicle,
        pytest.raises(SearchpartyError, match=r"tcp:127\.0\.0\.1:9 cannot be opened"),
    ):
        vehicle.prepare()


def test_two_vehicles_of_one_id_are_refused_though_each_alone_would_fly() -> None:
    port = free_port()
    settings = Settings(ready_after=0.2)
    to = f"udpout:127.0.0.1:{port}"
    with Served(settings, to) as one, Served(settings, to) as two:
        with (
            connected(f"udpin:127.0.0.1:{port}") as vehicle,
            pytest.raises(SearchpartyError, match="two vehicles with system id 1"),
        ):
            vehicle.prepare()
        assert not one.ask(lambda autopilot: autopilot.armed)
        assert not two.ask(lambda autopilot: autopilot.armed)


def test_one_that_stands_elsewhere_than_the_mission_says_is_refused() -> None:
    with Served(Settings(ready_after=0.2)) as served:
        far = context(origin=(ZERO[0] - 0.001, ZERO[1], ZERO[2]))
        with (
            connected(served.url, far) as vehicle,
            pytest.raises(SearchpartyError, match="m away, more than"),
        ):
            vehicle.prepare()
        assert not served.ask(lambda autopilot: autopilot.armed)


def test_a_start_beyond_its_fence_is_refused_before_anybody_is_looked_for() -> None:
    high = context(start=np.array([10.0, 10.0, 200.0, 0.0]))
    with pytest.raises(SearchpartyError, match=r"r1.*200\.0 m is not between the altitudes 1 and 120 m"):
        MavlinkKind.connect(MavlinkConfig(url="tcp:127.0.0.1:9"), high)


def test_a_missing_key_file_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(SearchpartyError, match="signing key"):
        MavlinkKind.connect(MavlinkConfig(url="tcp:127.0.0.1:9", signing_key=tmp_path / "none"), context())


def test_a_team_that_runs_faster_than_the_wall_has_no_real_vehicles() -> None:
    with (
        connected("tcp:127.0.0.1:9") as vehicle,
        pytest.raises(SearchpartyError, match="--speed 1"),
    ):
        vehicle.join(TeamClock(time.time(), speed=5.0))


class Flown:
    """A vehicle that is tended as its robot's process does."""

    def __init__(self, vehicle: MavlinkVehicle) -> None:
        self.vehicle = vehicle
        vehicle.prepare()
        self.clock = TeamClock(time.time())
        vehicle.join(self.clock)

    def until(self, condition: Callable[[VehicleState], bool], seconds: float = 25.0) -> VehicleState:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            now = self.clock.now()
            self.vehicle.tend(now, 0.0)
            state = self.vehicle.state(now)
            if condition(state):
                return state
            time.sleep(0.05)
        raise AssertionError((self.vehicle, self.vehicle.news()))


def test_an_operator_may_take_it_and_gives_it_back_only_by_an_explicit_act() -> None:
    with Served(Settings(ready_after=0.2)) as served, connected(served.url) as vehicle:
        flown = Flown(vehicle)
        up = flown.until(lambda state: state.able)
        assert up.pose[:3] == pytest.approx([10.0, 10.0, 3.0], abs=0.8)
        served.fault(Fault("operator_mode", value="LOITER"))
        taken = flown.until(lambda state: not state.able)
        assert taken.doing == "taken over"
        before = served.ask(lambda autopilot: autopilot.body.position)
        model = MavlinkKind.model(MavlinkConfig(url=served.url), AREA)
        now = flown.clock.now()
        vehicle.follow(model.trajectory(taken.state, np.array([60.0, 60.0, 3.0]), now, 1.0), now)
        flown.until(lambda state: state.time > now + 1.0)
        after = served.ask(lambda autopilot: autopilot.body.position)
        assert after == pytest.approx(before, abs=0.5)  # what the robot wants does not concern it
        assert served.ask(lambda autopilot: autopilot.mode) == "LOITER"
        assert any("somebody took it over" in text for _, text in vehicle.news())
        assert "taken over" in vehicle.health().words
        vehicle.resume()
        flown.until(lambda state: state.able)
        assert served.ask(lambda autopilot: autopilot.mode) == "GUIDED"


def test_it_is_where_it_was_plus_its_velocity_and_says_when_that_was() -> None:
    with Served(Settings(ready_after=0.2)) as served, connected(served.url) as vehicle:
        flown = Flown(vehicle)
        up = flown.until(lambda state: state.able)
        now = flown.clock.now()
        leg = vehicle.steering._model.trajectory(up.state, np.array([30.0, 10.0, 3.0]), now, 1.0)
        vehicle.follow(leg, now)
        moving = flown.until(lambda state: state.velocity[0] > 3.0)
        assert moving.time == pytest.approx(flown.clock.now(), abs=0.2)
        truth = served.ask(lambda autopilot: autopilot.body.position)
        here = vehicle.state(flown.clock.now()).pose
        assert here[0] == pytest.approx(10.0 + truth[1], abs=0.6)  # east; 0.1 s of flight are 0.5 m
        served.fault(Fault("mute"))
        stale = flown.until(lambda state: flown.clock.now() - state.time > 0.5)
        assert stale.time < flown.clock.now()  # it does not claim to know better


@pytest.mark.parametrize(
    ("autopilot", "parameters", "mode", "height"),
    [
        ("ardupilot", {}, "GUIDED", 3.0),
        ("px4", {}, "POSCTL", 0.0),
        ("px4", {"COM_OBL_RC_ACT": 5.0}, "HOLD", 3.0),
    ],
)
def test_setpoints_stop_with_the_robot_and_the_autopilot_does_what_its_parameters_say(
    autopilot: Any, parameters: dict[str, float], mode: str, height: float
) -> None:
    """What docs/mavlink.md promises."""
    settings = Settings(autopilot=autopilot, ready_after=0.2, parameters=parameters)
    with Served(settings) as served:
        with connected(served.url) as vehicle:
            Flown(vehicle).until(lambda state: state.able)
        # closed without `leave`, as when the process is killed
        assert served.wait_for(lambda pilot: pilot.mode == mode, 5.0)
        if height == 0.0:
            assert served.wait_for(lambda pilot: pilot.body.on_ground, 20.0)
        else:
            time.sleep(1.5)
        assert served.ask(lambda pilot: pilot.mode) == mode
        north, east, down = served.ask(lambda pilot: pilot.body.position)
        assert [north, east, -down] == pytest.approx([0.0, 0.0, height], abs=0.8)
