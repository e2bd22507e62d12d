"""The controller's foresight against the sensor and the filter, its programs against brute force."""

import builtins
import dataclasses
import math

import numpy as np
import pytest

from benchmarks.mpc_scenarios import SCENARIOS, mission_of, run
from estimator.gaussian.kalman import corrected as kalman_corrected
from estimator.sensors.field_of_view import FieldOfView
from planner.irrt.targets import targets_of
from planner.mpc.model import Domain, Limits, Task, corrected, rolled_out, straight
from planner.mpc.mpc import Mpc
from planner.mpc.nlp import Program
from planner.mpc.part import begun
from planner.mpc.pursuit import Pursuit
from planner.mpc.way import steered, timed
from planner.vehicles.unicycle import Unicycle
from tests.planner import contract

pytest.importorskip("casadi")
DOMAIN = Domain(0.9, 1 / 25, 10.0, math.cos(math.radians(30)))
LIMITS = Limits(0.0, 3.0, -3.0, 1.0, math.pi / 4)


def _task(seed, steps=5):
    rng = np.random.default_rng(seed)
    place = 25 + rng.uniform(-9, 9, 2)
    return Task(
        state=np.array([25.0, 25.0, rng.uniform(-3, 3), 1.0]),
        covariance=np.array([4.0, 0.5, 3.0]),
        targets=place + rng.uniform(-0.5, 0.5, 2) * np.arange(1, steps + 1)[:, None],
        noise=np.array([1.0, 0.0, 2.0]),
        process=np.array([0.01, 0.0, 0.01]),
        step=1.0,
        certainty=1.0,
        distance=0.01,
    )


@pytest.mark.parametrize("seed", range(4))
def test_gamma_is_the_detection_probability_of_the_smooth_sector(seed):
    rng = np.random.default_rng(seed)
    view = FieldOfView(2, "smooth_sector", 0.9, np.array([1 / 25, 10.0, math.radians(60)]))
    pose, point = np.array([*rng.uniform(0, 9, 3), rng.uniform(-3, 3)]), rng.uniform(0, 9, (2, 1))
    dx, dy = point[:, 0] - pose[:2]
    cosine = math.cos(pose[3] - math.atan2(dy, dx))
    found = DOMAIN.gamma(dx * dx + dy * dy, cosine)
    assert found == pytest.approx(view.detection(point, pose[None])[0, 0], rel=1e-9)


@pytest.mark.parametrize("gamma", [0.0, 0.3, 1.0])
def test_the_covariance_is_the_kalman_filters(gamma):
    p, r = np.array([[3.0, 0.7], [0.7, 2.0]]), np.array([[1.0, 0.2], [0.2, 1.5]])
    _, expected = kalman_corrected(np.zeros(2), p, np.zeros(2), np.eye(2), r, gamma)
    found = corrected(3.0, 0.7, 2.0, np.array([1.0, 0.2, 1.5]), gamma)
    np.testing.assert_allclose(found, [expected[0, 0], expected[0, 1], expected[1, 1]])


@pytest.mark.parametrize("seed", range(3))
def test_step_one_is_no_worse_than_many_random_plans(seed):
    task = _task(seed)
    program = Program(5, DOMAIN, LIMITS, angular=False)
    guess = rolled_out(task, straight(task, LIMITS), DOMAIN, LIMITS, False)
    found, _ = program.solve(task, guess, lambda: False)
    reached = rolled_out(task, found.controls, DOMAIN, LIMITS, False).objective
    rng = np.random.default_rng(seed)
    random = rng.uniform([-math.pi / 4, -3.0], [math.pi / 4, 1.0], (2000, 5, 2))
    best = min(rolled_out(task, u, DOMAIN, LIMITS, False).objective for u in random)
    assert reached <= best + 0.02 * abs(best)


@pytest.mark.parametrize("seed", range(3))
def test_a_plan_obeys_the_motion_and_the_limits_however_early_the_solver_is_stopped(seed):
    task = _task(seed)
    program = Program(5, DOMAIN, LIMITS, angular=True)
    guess = rolled_out(task, straight(task, LIMITS), DOMAIN, LIMITS, True)
    found, ended = program.solve(task, guess, lambda: True)
    assert "User" in ended
    u, x = found.controls, found.states
    mean, middle = 0.5 * (x[:-1, 3] + x[1:, 3]), 0.5 * (x[:-1, 2] + x[1:, 2])
    np.testing.assert_allclose(x[1:, 0], x[:-1, 0] + mean * np.cos(middle), atol=1e-12)
    np.testing.assert_allclose(x[1:, 2], x[:-1, 2] + u[:, 0], atol=1e-12)
    np.testing.assert_allclose(x[1:, 3], x[:-1, 3] + u[:, 1], atol=1e-12)
    assert (np.abs(u[:, 0]) <= LIMITS.turn_rate).all()
    assert ((u[:, 1] >= -3.0 - 1e-9) & (u[:, 1] <= 1.0 + 1e-9)).all()
    assert ((x[:, 3] >= -1e-9) & (x[:, 3] <= 3.0 + 1e-9)).all()


def test_a_missing_extra_is_named(monkeypatch):
    real = builtins.__import__

    def missing(name, *args, **kwargs):
        if name == "casadi":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(ValueError, match=r"searchparty\[mpc\]"):
        Mpc(Mpc.Config(), contract.team("ground_2d"))


def test_a_wrong_velocity_is_named():
    with pytest.raises(ValueError, match="velocity_m_s"):
        Mpc(Mpc.Config(velocity_m_s=[1.0]), contract.team("ground_2d"))


def test_a_solver_that_breaks_down_leaves_the_straight_way():
    setup = contract.team("ground_2d", "a")
    planner = Mpc(Mpc.Config(), setup)
    memory = planner._memories["a"]

    class Broken:
        domain, limits = memory.one.domain, memory.one.limits

        def solve(self, *_):
            raise RuntimeError("no memory\nat all")

    memory.one = memory.two = Broken()
    problem = dataclasses.replace(contract.ordinary(setup), others=())
    plan = planner.plan(problem)
    assert plan.trajectory is not None
    assert "goes straight (the solver failed: no memory)" in plan.reason


def test_the_beginning_of_a_way_ends_where_the_vehicle_is_then():
    setup = contract.team("ground_2d", "a")
    vehicle, state = setup.vehicles["a"], contract.state(setup, "a", 5, 5, 0)
    way = vehicle.trajectory(state, np.array([30.0, 20.0, 0.0]), 2.0, 1.0)
    part = begun(vehicle, state, way, 3.0)
    assert part.end_time == pytest.approx(5.0)
    steps = round(3.0 / vehicle.control_period)
    np.testing.assert_array_equal(part.end_state, vehicle.advance(state, way.waypoint, steps))
    assert begun(vehicle, state, way, 1e6) is way


@pytest.mark.parametrize("degrees", [30.0, 60.0, 120.0, 300.0])
def test_the_standoff_is_the_place_farthest_from_the_borders_of_the_sector(degrees):
    half = math.radians(degrees / 2)
    domain = Domain(1.0, 1 / 25, 10.0, math.cos(half))
    rng = np.random.default_rng(0)
    best = 0.0
    arcs = np.linspace(-half, half, 400)
    border = np.vstack([5.0 * np.column_stack([np.cos(arcs), np.sin(arcs)])] + [
        r * np.array([[math.cos(half), math.sin(half)], [math.cos(half), -math.sin(half)]])
        for r in np.linspace(0, 5, 300)
    ])  # fmt: skip
    for _ in range(3000):  # brute force: places inside, and how far the nearest of the border's is
        r, a = 5.0 * math.sqrt(rng.random()), rng.uniform(-half, half)
        place = r * np.array([math.cos(a), math.sin(a)])
        best = max(best, float(np.linalg.norm(border - place, axis=1).min()))
    ahead, width = domain.middle
    middle = float(np.linalg.norm(border - np.array([ahead, 0.0]), axis=1).min())
    assert middle == pytest.approx(width, abs=0.02)
    assert best <= width + 0.02
    assert best >= width - 0.12


def test_a_sensor_that_sees_all_around_has_no_standoff():
    assert Domain(1.0, 1 / 25, 10.0, -math.inf).middle == (0.0, 5.0)


def test_a_plan_for_a_standing_target_ends_with_it_in_the_middle_of_the_sector():
    task = dataclasses.replace(
        _task(0, 12),
        state=np.array([25.0, 25.0, 0.0, 0.0]),
        covariance=np.array([0.3, 0.0, 0.3]),
        targets=np.tile([33.0, 29.0], (12, 1)),
        distance=0.1,
        standoff=DOMAIN.middle[0],
    )
    best = rolled_out(task, straight(task, LIMITS), DOMAIN, LIMITS, True)
    for angular in (False, True):
        found, _ = Program(12, DOMAIN, LIMITS, angular=angular).solve(task, best, lambda: False)
        best = min(best, found, key=lambda plan: plan.objective)
    gap = np.array([33.0, 29.0]) - best.states[-1, :2]
    off = math.atan2(gap[1], gap[0]) - best.states[-1, 2]
    assert np.linalg.norm(gap) == pytest.approx(DOMAIN.middle[0], abs=0.6)
    assert abs(off) < math.radians(10)


@pytest.mark.parametrize("seed", range(3))
def test_waypoints_bring_the_vehicles_own_model_to_where_the_plan_has_it(seed):
    vehicle = Unicycle(Unicycle.Config(speed_m_s=3.0, turn_rate_deg_s=45.0, braking_m_s2=3.0))
    task = dataclasses.replace(_task(seed), standoff=DOMAIN.middle[0], distance=0.1)
    state = vehicle.initial_state(np.array([25.0, 25.0, 0.0, task.state[2]]))
    state[4] = task.state[3]
    plan = rolled_out(task, straight(task, LIMITS), DOMAIN, LIMITS, True)
    points = steered(
        vehicle, state, plan.states[1:, :3], task.targets[:3],
        box=(np.zeros(2), np.full(2, 50.0)), step=1.0, speed=3.0, heads=True, reach=5.0, over=lambda: False,
    )  # fmt: skip
    way = timed(vehicle, state, points, 1.0, 7.0, 0.5)
    assert way.end_time == pytest.approx(10.0)
    np.testing.assert_allclose(way.measure_times, [7.0, 7.5, 8.0, 8.5, 9.0, 9.5])
    np.testing.assert_array_equal(way.route_times, [7.0, 8.0, 9.0])
    driven = state
    for point, wanted in zip(points, plan.states[1:], strict=False):  # as the simulated vehicle drives it
        driven = vehicle.advance(vehicle.begin(driven, point), point, 200)
        assert np.linalg.norm(driven[:2] - wanted[:2]) < 0.7
        assert abs(math.remainder(driven[3] - wanted[2], 2 * math.pi)) < 0.25
    np.testing.assert_array_equal(way.end_state, driven)


def test_a_target_is_kept_to_though_another_comes_nearer():
    setup = contract.team("ground_2d", "a")
    pursuit = Pursuit(np.zeros(2))
    problem = dataclasses.replace(contract.ordinary(setup), others=())
    believed = dataclasses.replace(
        problem.intensity,
        means=np.array([[20.0, 50.0], [20.0, 50.0]]),
        covariances=np.tile(0.1 * np.eye(2), (2, 1, 1)),
        masses=np.ones(2),
        velocities=np.array([[1.0, -1.0], [0.0, 0.0]]),
        time=4.0,
    )
    pose = np.array([15.0, 20.0, 0.0, 0.0])

    def place(time, means):
        now = dataclasses.replace(believed, means=np.array(means).T, time=time)
        asked = dataclasses.replace(problem, intensity=now, start_time=time + 0.5)
        return pursuit.updated(asked, targets_of(asked, 0.0), pose, 0.3, None)[0]

    np.testing.assert_allclose(place(4.0, [[20.0, 20.0], [50.0, 50.0]]), [20.5, 20.0])
    np.testing.assert_allclose(place(8.0, [[24.0, 20.0], [16.0, 20.0]]), [24.5, 20.0])
    np.testing.assert_allclose(place(9.0, [[14.0, 20.0], [25.0, 20.0]]), [24.5, 20.0])


@pytest.mark.parametrize("figure", ["4", "6b"])
def test_the_papers_scenarios_the_target_is_found_and_kept_in_view(figure):
    """Of figures 4 to 6; all seven with many seeds: `python -m benchmarks.mpc_scenarios`."""
    scenario = next(one for one in SCENARIOS if one.figure == figure)
    course = run(mission_of(scenario, 0), 0)
    assert course.first is not None, (
        f"repeat: python -m benchmarks.mpc_scenarios --figures {figure} --seeds 0"
    )
    assert course.first <= 30.0
    assert course.in_view >= 0.8
    assert course.error < 1.2
    assert course.trace[1] < 0.05 * course.trace[0]  # figure 5, right: the trace drops


def test_driving_up_to_the_target_as_j_is_printed_loses_it():
    course = run(mission_of(SCENARIOS[0], 0, standoff_m=0.0), 0)
    assert course.in_view < 0.6


@pytest.mark.parametrize("degrees", [20.0, 45.0, 180.0])
def test_a_ground_robot_can_stop_however_slowly_it_turns(degrees):
    setup = contract.team("ground_2d", "a")
    slow = Unicycle(Unicycle.Config(speed_m_s=3.0, turn_rate_deg_s=degrees))
    planner = Mpc(Mpc.Config(), dataclasses.replace(setup, vehicles={"a": slow}))
    limits = planner._memories["a"].one.limits
    assert limits.slowest == 0.0
    assert limits.turn_rate == pytest.approx(math.radians(min(degrees, 45.0)), rel=0.02)
    assert limits.accelerating == -limits.braking == slow.config.acceleration_m_s2
