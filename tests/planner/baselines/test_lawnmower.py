import dataclasses

import numpy as np
import pytest

from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from planner.baselines.lawnmower import Lawnmower
from planner.baselines.mowing import reach_width, share
from tests.planner import contract, walled
from tests.planner.problems import NumpySensor

BOXES = [([0, 0], [100, 60]), ([-20, 5], [10, 105]), ([0, 0, 0], [260, 260, 260]), ([0, 0, 5], [9, 90, 35])]


def turns(strip):
    return np.array([strip.turn(k) for k in range(strip.turns)])


@pytest.mark.parametrize(("low", "high"), BOXES)
@pytest.mark.parametrize("robots", [1, 2, 3, 7])
@pytest.mark.parametrize("flip", [(False, False, False), (True, True, True), (True, False, True)])
def test_shares_are_equal_and_their_lines_leave_no_gap(low, high, robots, flip) -> None:
    area, swath = Area(np.array(low, float), np.array(high, float)), 12.5
    strips = [dataclasses.replace(share(area, i, robots, swath), flip=flip) for i in range(robots)]
    volumes = [np.prod(strip.high - strip.low) for strip in strips]
    assert volumes == pytest.approx([area.volume / robots] * robots)
    rng = np.random.default_rng(0)
    points = area.low + rng.uniform(0, 1, (200, area.dimension)) * (area.high - area.low)
    least = np.full(len(points), np.inf)
    for strip in strips:
        path = turns(strip)
        for begin, end in zip(path[0::2], path[1::2], strict=True):
            way = end - begin
            s = np.clip((points - begin) @ way / max(way @ way, 1e-12), 0, 1)
            least = np.minimum(least, np.abs(points - begin - s[:, None] * way).max(axis=1))
    assert least.max() <= swath / 2 + 1e-9  # along each axis, its ends included


@pytest.mark.parametrize(("low", "high"), BOXES)
def test_a_path_goes_on_where_it_is(low, high) -> None:
    area, swath = Area(np.array(low, float), np.array(high, float)), 9.0
    for index in range(3):
        strip = share(area, index, 3, swath)
        path = turns(strip)
        between = np.linalg.norm(path[2::2] - path[1:-1:2], axis=1)
        assert (between <= swath + 1e-9).all()  # from line to line and from layer to layer
        moved = path[1::2] - path[::2]
        assert ((np.abs(moved) > 1e-9).sum(axis=1) <= 1).all()  # along an axis
        assert ((path >= strip.low - 1e-9) & (path <= strip.high + 1e-9)).all()


def test_swath_is_where_detection_is_half_of_its_best() -> None:
    area = Area(np.zeros(2), np.full(2, 100.0))
    sensor = NumpySensor(2, gain=0.9, reach=8.0)
    # p_D = G exp(-r / (2 F)) is half of G at r = 2 F ln 2.
    assert reach_width(sensor, area, 0.0) == pytest.approx(2 * 16.0 * np.log(2), rel=0.2)
    config = (
        RangeBearing.Config(
            period_s=1.0, range_sigma_m=1.0, bearing_sigma_deg=1.0, shape="box", half_sides_m=[3.0, 7.0]
        )
        if "half_sides_m" in RangeBearing.Config.__struct_fields__
        else None
    )
    if config is not None:
        width = reach_width(RangeBearing.of(config, area), area, 0.0)
        assert width == pytest.approx(14.0, rel=0.2)


def test_a_blind_sensor_has_a_width_all_the_same() -> None:
    area = Area(np.zeros(2), np.full(2, 100.0))
    assert reach_width(NumpySensor(2, gain=0.0), area, 0.0) > 0


def mown(setup, robot, planner, start, plans=400):
    """The plans from a start until it holds, each beginning where the last one ended."""
    problem = dataclasses.replace(contract.ordinary(setup), robot=robot, others=(), state=start)
    made = []
    for _ in range(plans):
        plan = planner.plan(problem)
        made.append(plan)
        if plan.trajectory is None:
            break
        way = plan.trajectory
        problem = dataclasses.replace(problem, state=way.end_state, start_time=way.end_time)
    return made


def test_all_robots_together_mow_the_area_once_and_hold() -> None:
    setup = contract.team("ground_2d", "abc")
    planner = Lawnmower(Lawnmower.Config(swath_m=6.0, then="hold"), setup)
    seen = []
    for robot in "abc":
        plans = mown(setup, robot, planner, contract.state(setup, robot, 1.0, 1.0, 0.0))
        assert "mown" in plans[-1].reason
        seen += [plan.trajectory.poses[:, :2] for plan in plans[:-1]]
    path = np.vstack(seen)
    grid = np.stack([a.ravel() for a in np.meshgrid(*[np.linspace(0, 60, 31)] * 2)], axis=1)
    near = np.abs(grid[:, None] - path).max(axis=2).min(axis=1)
    assert near.max() < 3.0 + 1.5  # half a swath, and how far samples lie apart


def test_with_all_mown_it_begins_anew_with_a_reason() -> None:
    setup = contract.team("drones_2d", "a")
    planner = Lawnmower(Lawnmower.Config(swath_m=30.0), setup)
    plans = mown(setup, "a", planner, contract.state(setup, "a", 1.0, 1.0, 0.0), 12)
    assert all(plan.trajectory is not None for plan in plans)
    assert "anew" not in plans[3].reason
    assert "sweep 2, begun anew" in plans[5].reason


def test_a_blocked_turn_is_passed_over() -> None:
    setup = contract.team("drones_2d", "a")
    problem = dataclasses.replace(contract.ordinary(setup), others=())
    free = Lawnmower(Lawnmower.Config(swath_m=20.0), setup).plan(problem)
    guard = contract.standing("b", *free.trajectory.waypoint)
    held = dataclasses.replace(problem, others=(guard,), separation=4.0)
    plan = Lawnmower(Lawnmower.Config(swath_m=20.0), setup).plan(held)
    assert plan.trajectory is not None
    assert plan.terms["turn"] > free.terms["turn"]


def test_where_the_end_of_a_line_is_walled_in_it_goes_as_near_as_it_can_and_never_stops() -> None:
    setup = walled.team("ground_2d", "a")  # a yard closed all around lies on the line's end
    assert setup.ground is not None
    planner = Lawnmower(Lawnmower.Config(swath_m=20.0), setup)
    plans = mown(setup, "a", planner, contract.state(setup, "a", 4.0, 4.0, 0.0), 16)
    assert all(plan.trajectory is not None for plan in plans), plans[-1].reason
    ways = np.vstack([plan.trajectory.poses[:, :2] for plan in plans])
    assert setup.ground.clear(np.ascontiguousarray(ways.T)).all()
    assert any("before its end" in plan.reason for plan in plans)
    assert max(plan.terms["sweep"] for plan in plans) > 1


def test_asked_twice_it_answers_the_same() -> None:
    setup = contract.team("drones_2d")
    planner, problem = Lawnmower(Lawnmower.Config(), setup), contract.ordinary(setup)
    contract.same(planner.plan(problem), planner.plan(problem))
