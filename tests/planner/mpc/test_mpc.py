"""The controller's foresight against the sensor and the filter, its programs against brute force."""

import builtins
import dataclasses
import math

import numpy as np
import pytest

from estimator.gaussian.kalman import corrected as kalman_corrected
from estimator.sensors.field_of_view import FieldOfView
from planner.mpc.model import Domain, Limits, Task, corrected, rolled_out, straight
from planner.mpc.mpc import Mpc
from planner.mpc.nlp import Program
from planner.mpc.part import begun
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
    np.testing.assert_allclose(x[1:, 0], x[:-1, 0] + x[:-1, 3] * np.cos(x[:-1, 2]), atol=1e-12)
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
