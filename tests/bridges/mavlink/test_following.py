"""A way left to the autopilot as a mission is flown without setpoints, and given back at its end."""

import numpy as np
import pytest

from bridges.mavlink.frames import LocalFrame, TeamFrame
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.wanted import GoTo, Hold, Land, Return, Way
from bridges.mavlink.ways import way_of
from sim.mavlink.settings import Settings
from tests.bridges.mavlink.air import Air

ROUTE = np.array([[0.0, 20.0, 8.0], [25.0, 20.0, 10.0], [25.0, 0.0, 8.0]])  # east, north, up
SETPOINTS = "SET_POSITION_TARGET_LOCAL_NED"
BOTH = pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])


def bench(autopilot: str, body: str = "copter", **config: object) -> Air:
    made = Air(
        Settings(autopilot=autopilot, type=body, ready_after=0.1),  # type: ignore[arg-type]
        PilotConfig(system=1, take_off_height=5.0, **config),  # type: ignore[arg-type]
    )
    assert made.until(lambda: made.report.phase == "ready" and not made.report.reasons, 20.0), made.report
    return made


def way(air: Air, route: np.ndarray = ROUTE) -> Way:
    report = air.report
    assert report.home is not None
    assert report.origin is not None
    return way_of(route, LocalFrame(TeamFrame(report.home), report.origin, report.autopilot), report.home)


def following(air: Air, route: np.ndarray = ROUTE) -> Way:
    """Until it flies a way by itself."""
    wanted = way(air, route)
    air.want(wanted)
    assert air.until(lambda: air.report.mode in ("AUTO", "MISSION"), 60.0), (air.report, air.said())
    air.fly(1.0)
    assert air.report.phase == "following"
    return wanted


@pytest.mark.parametrize(
    ("autopilot", "body"), [("ardupilot", "copter"), ("px4", "copter"), ("ardupilot", "rover")]
)
def test_a_way_is_flown_by_itself_to_its_end_and_held_there_by_us(autopilot: str, body: str) -> None:
    air = bench(autopilot, body)
    route = ROUTE if body == "copter" else ROUTE * [1.0, 1.0, 0.0]
    wanted = following(air, route)
    begin, track = air.now, [air.report.position]
    reach = 2.5 if body == "rover" else 1.2

    def back() -> bool:
        track.append(air.report.position)
        return air.report.phase == "flying"

    assert air.until(back, 120.0), (air.report, air.said())
    # a PX4 wants setpoints before it comes back to us: those at the end, and none on the way
    on_the_way = [time for time, message in air.sent if message.get_type() == SETPOINTS and time > begin]
    assert all(time > air.now - 5.0 for time in on_the_way)
    for corner in wanted.route:
        assert min(np.linalg.norm(place - corner) for place in track if place is not None) < reach
    air.fly(8.0)
    assert air.report.mode == air.pilot.autopilot.guided  # type: ignore[union-attr]
    assert air.report.ours
    assert air.report.phase == "flying"
    position = air.report.position
    assert position is not None
    assert np.linalg.norm(position - wanted.route[-1]) < reach
    assert air.count("MISSION_COUNT", begin) == 0  # the same way is not flown twice


@BOTH
def test_a_link_that_is_gone_on_the_way_does_not_stop_it(autopilot: str) -> None:
    air = bench(autopilot)
    wanted = following(air)
    begin = air.now
    air.cut = True
    nearest = np.inf
    for _ in range(90):
        air.fly(0.1)
        where = np.array(air.autopilot.body.position)
        nearest = min(nearest, float(np.linalg.norm(where - wanted.route[0])))
    assert nearest < 1.2
    assert air.report.phase == "lost"
    air.cut = False
    assert air.until(lambda: air.at(wanted.route[-1], 1.2), 90.0), (air.report, air.said())
    assert air.report.ours
    assert air.count("MISSION_SET_CURRENT", begin) == 0  # it was not begun again


@BOTH
def test_a_way_that_was_left_is_flown_on_from_where_it_was(autopilot: str) -> None:
    air = bench(autopilot)
    wanted = following(air)
    second = wanted.route[1]

    def near() -> bool:
        position = air.report.position
        return position is not None and float(np.linalg.norm(position - second)) < 1.0

    assert air.until(near, 60.0)
    air.fly(3.0)
    air.want(Hold())
    assert air.until(lambda: air.report.phase == "flying", 30.0), (air.report, air.said())
    air.fly(3.0)
    begin = air.now
    air.want(wanted)
    nearest = [np.inf]

    def there() -> bool:
        position = air.report.position
        if position is not None:
            nearest[0] = min(nearest[0], float(np.linalg.norm(position - wanted.route[0])))
        return air.report.phase == "flying" and air.at(wanted.route[-1], 1.2)

    assert air.until(there, 90.0), (air.report, air.said())
    assert nearest[0] > 5.0  # not to the first corner again
    assert air.count("MISSION_COUNT", begin) == 0


@BOTH
@pytest.mark.parametrize("task", [Land(), Return()])
def test_it_lands_or_returns_from_the_way_when_that_is_wanted(autopilot: str, task: Land | Return) -> None:
    air = bench(autopilot)
    following(air)
    air.want(task)
    assert air.until(lambda: air.report.phase in ("landing", "returning"), 10.0), (air.report, air.said())
    assert air.until(lambda: not air.autopilot.armed, 90.0), (air.report, air.said())
    assert air.until(lambda: air.report.phase == "ready", 5.0)
    assert "took it over" not in air.said()


@BOTH
def test_anything_else_is_flown_by_setpoints_again_and_another_way_after_it(autopilot: str) -> None:
    air = bench(autopilot)
    following(air)
    place = np.array([-5.0, 3.0, -7.0])
    air.want(GoTo(place))
    assert air.until(lambda: air.at(place), 60.0), (air.report, air.said())
    other = ROUTE[::-1] + np.array([0.0, 10.0, 0.0])
    wanted = following(air, other)
    third = way(air, ROUTE)
    air.want(third)  # straight from one way to the next
    assert air.until(lambda: air.at(third.route[-1], 1.2), 120.0), (air.report, air.said())
    assert wanted is not third
    assert "took it over" not in air.said()


@BOTH
def test_who_takes_it_on_the_way_keeps_it(autopilot: str) -> None:
    air = bench(autopilot)
    following(air)
    air.fault("operator_mode", "LOITER" if autopilot == "ardupilot" else "POSCTL")
    assert air.until(lambda: air.report.phase == "taken over", 5.0), air.report
    begin = air.now
    air.fly(10.0)
    assert air.count(SETPOINTS, begin) == 0
    assert air.report.phase == "taken over"


def test_a_way_that_leaves_the_fence_is_not_put_on_board() -> None:
    def permit(place: np.ndarray) -> str | None:
        return "beyond 22 m to the east" if place[1] > 22.0 else None

    air = bench("ardupilot", permit=permit)
    air.want(way(air))
    assert air.until(lambda: "beyond 22 m" in air.report.trouble, 60.0), air.report
    air.fly(5.0)
    assert air.report.phase == "flying"
    assert air.count("MISSION_COUNT") == 0
    corner = way(air, np.array([[0.0, 20.0, 8.0], [40.0, 20.0, 8.0], [0.0, 20.0, 8.0]]))
    air.want(corner)
    air.fly(3.0)
    assert "beyond 22 m" in air.report.trouble


def test_where_the_way_cannot_be_put_on_board_it_holds_and_says_why() -> None:
    air = bench("px4")
    good = way(air)
    bad = Way(good.route, tuple(item.__class__(31000, item.x, item.y, item.z) for item in good.items))
    air.want(bad)
    assert air.until(lambda: "unknown to this autopilot" in air.report.trouble, 60.0), air.report
    assert air.report.phase == "flying"
    assert air.report.mode == "OFFBOARD"
