"""The bridge on real autopilots, in real time; skipped where `tests.bridges.mavlink.real` finds none."""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest

from bridges.mavlink.bridge import Bridge
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.wanted import Drive, GoTo, Hold, Land, Return, Task, Wanted
from estimator.arrays import FloatArray
from tests.bridges.mavlink.real import Real, Router, Station, needed, stage, until

READY = 90.0  # s until an estimator that has just been switched on knows where it is
COPTERS = pytest.mark.parametrize("kind", ["ardupilot", "px4"])
SQUARE = [(8.0, 0.0), (8.0, 8.0), (0.0, 8.0), (0.0, 0.0)]


class Flown:
    """A real autopilot on a link that can be cut, under our bridge."""

    def __init__(self, kind: str, router: Router, bridge: Bridge, real: Real) -> None:
        self.kind, self.router, self.bridge, self.real = kind, router, bridge, real
        self.said: list[str] = []

    def want(self, task: Task) -> None:
        self.bridge.want(Wanted(task))

    def position(self) -> FloatArray:
        found = self.bridge.report().position
        assert found is not None
        return found

    def gap(self, place: FloatArray) -> float:
        level = 2 if self.kind == "rover" else 3
        return float(np.linalg.norm((self.position() - place)[:level]))

    def until(self, what: str, condition: Callable[[], bool], seconds: float) -> float:
        return until(condition, seconds, what, self.bridge)

    def go(
        self, north: float, east: float, height: float = 5.0, within: float = 0.5, yaw: float | None = None
    ) -> float:
        """Fly to a place and stay there for a second; the gap that remains."""
        place = np.array([north, east, -height])
        self.want(GoTo(place, yaw))
        self.until(f"at {place}", lambda: self.ours and self.gap(place) < within, 60.0)
        time.sleep(1.0)
        return self.gap(place)

    def airborne(self) -> None:
        self.want(GoTo(np.array([0.0, 0.0, -5.0])))
        self.until("flying", lambda: self.bridge.report().phase == "flying", READY)

    @property
    def ours(self) -> bool:
        return self.bridge.report().ours

    def down(self) -> None:
        self.until(
            "down", lambda: self.bridge.report().phase == "ready" and not self.bridge.report().armed, 90.0
        )


@contextmanager
def flown(kind: str, folder: Path, parameters: Mapping[str, float] | None = None) -> Iterator[Flown]:
    needed(kind)
    system, router = stage(kind)
    config = PilotConfig(system=system, body="rover" if kind == "rover" else "copter")
    with (
        router,
        Real(kind, folder, router, system, parameters) as real,
        Bridge(router.url, config) as bridge,
    ):
        yield Flown(kind, router, bridge, real)


@COPTERS
def test_a_copter_flies_a_square_within_a_metre_faces_where_it_is_told_and_lands(
    kind: str, tmp_path: Path
) -> None:
    with flown(kind, tmp_path) as copter:
        copter.airborne()
        gaps = [copter.go(*corner) for corner in SQUARE]
        assert max(gaps) < 1.0, gaps
        copter.want(GoTo(np.array([0.0, 0.0, -5.0]), yaw=math.radians(120)))

        def turned() -> bool:
            attitude = copter.bridge.report().attitude
            return attitude is not None and abs(math.degrees(attitude[2]) - 120) < 5

        copter.until("turned", turned, 20.0)
        copter.want(Drive(np.array([1.0, 0.0, 0.0])))

        def driven() -> bool:
            velocity = copter.bridge.report().velocity
            return velocity is not None and bool(np.allclose(velocity, [1.0, 0.0, 0.0], atol=0.3))

        copter.until("driven", driven, 20.0)
        copter.want(Land())
        copter.down()
        report = copter.bridge.report()
        assert report.autopilot == {"ardupilot": "ArduPilot", "px4": "PX4"}[kind]
        assert report.version
        assert report.body == "copter"
        assert report.home is not None
        assert {"ground link", "setpoints", "low battery", "fence"} <= {one.cause for one in report.failsafes}
        assert report.captured is not None
        assert report.clock_offset is not None
        assert not report.in_air
        assert abs(copter.position()[2]) < 2.0  # a PX4's idea of its height drifts by more than a metre


@COPTERS
def test_a_copter_returns_home_and_disarms(kind: str, tmp_path: Path) -> None:
    lower = {"RTL_ALT": 800.0} if kind == "ardupilot" else {"RTL_RETURN_ALT": 8.0}
    with flown(kind, tmp_path, lower) as copter:
        copter.airborne()
        copter.go(15.0, 0.0)
        copter.want(Return())
        copter.until("returning", lambda: copter.bridge.report().mode == "RTL", 10.0)
        copter.down()
        assert float(np.linalg.norm(copter.position()[:2])) < 1.5


@COPTERS
def test_a_copter_that_somebody_takes_is_let_go_and_flown_again_only_when_asked(
    kind: str, tmp_path: Path
) -> None:
    with flown(kind, tmp_path) as copter, Station(copter.router) as station:
        copter.airborne()
        copter.go(6.0, 0.0)
        pilot = copter.bridge._pilot
        assert pilot.autopilot is not None
        station.command(pilot.autopilot.mode_command(pilot.autopilot.hold_mode), copter.real.system)
        took = copter.until("taken over", lambda: copter.bridge.report().phase == "taken over", 5.0)
        assert not copter.ours
        assert "somebody took it over" in copter.bridge.report().trouble, took
        station.drain()
        copter.want(GoTo(np.array([0.0, 0.0, -5.0])))
        time.sleep(5.0)
        assert copter.gap(np.array([6.0, 0.0, -5.0])) < 2.0
        seen = {message.get_type() for message in station.drain() if message.get_srcComponent() == 191}
        assert "SET_POSITION_TARGET_LOCAL_NED" not in seen
        copter.bridge.resume()
        assert copter.go(0.0, 0.0) < 1.0
        copter.want(Land())
        copter.down()


@COPTERS
def test_after_a_lost_link_it_is_heard_and_commanded_again_within_two_seconds(
    kind: str, tmp_path: Path
) -> None:
    with flown(kind, tmp_path) as copter:
        copter.airborne()
        copter.go(6.0, 0.0)
        copter.router.cut = True
        copter.until("lost", lambda: copter.bridge.report().phase == "lost", 8.0)
        copter.router.cut = False
        back = copter.until("back", lambda: copter.bridge.report().phase != "lost", 5.0)
        assert back < 2.0
        if kind == "px4":  # it has left OFFBOARD in the meantime
            copter.until("taken over", lambda: copter.bridge.report().phase == "taken over", 3.0)
            assert "failsafe" in copter.bridge.report().trouble
            copter.bridge.resume()
        assert copter.go(0.0, 0.0) < 1.0
        copter.want(Land())
        copter.down()


@COPTERS
def test_when_our_process_ends_in_flight_the_autopilot_does_what_was_reported(
    kind: str, tmp_path: Path
) -> None:
    with flown(kind, tmp_path, {"COM_OBL_RC_ACT": 4} if kind == "px4" else {}) as copter:
        copter.airborne()
        copter.go(4.0, 0.0)
        [told] = [one for one in copter.bridge.report().failsafes if one.cause == "setpoints"]
        assert told.action == {"ardupilot": "hold", "px4": "land"}[kind]
        copter.bridge.close()
        with Bridge(
            copter.router.url, PilotConfig(system=copter.real.system, source_component=192, fly=False)
        ) as watcher:
            time.sleep(8.0)
            report = watcher.report()
            assert report.mode == {"ardupilot": "GUIDED", "px4": "LAND"}[kind]
            assert report.position is not None
            if kind == "ardupilot":
                assert float(np.linalg.norm(report.position - [4.0, 0.0, -5.0])) < 1.0
            else:
                assert report.position[2] > -4.5


@COPTERS
def test_a_copter_is_not_armed_before_it_knows_where_it_is_and_then_at_the_first_try(
    kind: str, tmp_path: Path
) -> None:
    with flown(kind, tmp_path) as copter:
        copter.want(GoTo(np.array([0.0, 0.0, -5.0])))
        copter.until("found", lambda: bool(copter.bridge.report().mode), 30.0)
        reasons: set[str] = set()

        def flying() -> bool:
            report = copter.bridge.report()
            reasons.update(report.reasons)
            assert not (report.armed and report.reasons), report
            return report.phase == "flying"

        copter.until("flying", flying, READY)
        assert reasons
        refused = [
            event.text for event in copter.bridge.events() if "arm:" in event.text and "Arm" not in event.text
        ]
        assert not [text for text in refused if "refused" in text or "failed" in text]


def test_two_copters_behind_one_router_are_flown_by_two_bridges(tmp_path: Path) -> None:
    needed("ardupilot")
    places = {1: np.array([5.0, 0.0, -5.0]), 2: np.array([-5.0, 0.0, -7.0])}
    with ExitStack() as stack:
        router = stack.enter_context(Router())
        bridges = {}
        for system in places:
            stack.enter_context(Real("ardupilot", tmp_path / str(system), router, system))
            bridges[system] = stack.enter_context(
                Bridge(router.url, PilotConfig(system=system, take_off_height=4.0))
            )
        for system, bridge in bridges.items():
            bridge.want(Wanted(GoTo(places[system])))

        def there() -> bool:
            found = {system: bridge.report().position for system, bridge in bridges.items()}
            return all(at is not None and np.linalg.norm(at - places[s]) < 0.5 for s, at in found.items())

        until(there, READY + 30, "both there", bridges[2])
        assert {system: bridge.report().system for system, bridge in bridges.items()} == {1: 1, 2: 2}
        for bridge in bridges.values():
            bridge.want(Wanted(Land()))
        until(lambda: not any(bridge.report().armed for bridge in bridges.values()), 60.0, "down", bridges[1])


def test_a_rover_drives_to_places_and_stands(tmp_path: Path) -> None:
    with flown("rover", tmp_path) as rover:
        rover.want(GoTo(np.zeros(3)))
        rover.until("driving", lambda: rover.bridge.report().phase == "flying", READY)
        for corner in [(15.0, 0.0), (15.0, 15.0), (0.0, 15.0)]:
            rover.go(*corner, height=0.0, within=3.0)
        rover.want(Hold())

        def stands() -> bool:
            velocity = rover.bridge.report().velocity
            return velocity is not None and float(np.linalg.norm(velocity)) < 0.2

        rover.until("standing", stands, 15.0)
        rover.want(Land())
        rover.down()
        assert rover.bridge.report().mode == "HOLD"
