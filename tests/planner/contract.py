"""What every planner promises, whatever it is: problems to try it on, and checks of what it answers.

A planner's own tests may call `check` with problems of their own. A planner that needs more than its default
keys, or that cannot plan for some setup, says so in CONFIGS and ELSEWHERE.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from agents.plugins import load
from estimator.exploration import Exploration
from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from planner.allocation.desk import Assignment
from planner.plan import Budget, Commitment, Intensity, Plan, PlannerSetup, PlanProblem, Trajectory
from planner.vehicles.quadrotor import Quadrotor
from planner.vehicles.unicycle import Unicycle

SIDE = 60.0
CONFIGS: dict[str, dict[str, Any]] = {  # keys that a kind cannot do without, or that make it quick
    "monte_carlo": {"paths": 300},
}
ELSEWHERE: dict[str, set[str]] = {}  # setups for which a kind only has a reason to hold
SLACK = 0.25  # m: positions are sampled, and vehicles stop within a tolerance
SETUPS = ("drones_2d", "ground_2d", "drones_3d")


def planner(kind: str, setup: PlannerSetup) -> Any:
    """A fresh planner of an entry point, with its default keys."""
    found = load("planners", kind)
    return found(found.Config(**CONFIGS.get(kind, {})), setup)


def team(name: str, robots: str = "abc", side: float = SIDE) -> PlannerSetup:
    """Robots of one kind in an open square or cube."""
    d = 3 if name.endswith("3d") else 2
    area = Area(np.zeros(d), np.full(d, side))
    config = RangeBearing.Config(
        period_s=1.0,
        range_sigma_m=1.0,
        bearing_sigma_deg=1.0,
        elevation_sigma_deg=1.0 if d == 3 else None,
        reach_m=[8.0] * d,
    )
    sensor = RangeBearing.of(config, area)
    vehicle: Any = Unicycle(Unicycle.Config(speed_m_s=3.0)) if name == "ground_2d" else Quadrotor(DRONE)
    return PlannerSetup(dict.fromkeys(robots, vehicle), dict.fromkeys(robots, sensor), area)


DRONE = Quadrotor.Config(speed_m_s=5.0, acceleration_m_s2=3.0)


def state(setup: PlannerSetup, robot: str, *place: float) -> Any:
    return setup.vehicles[robot].initial_state(np.array([*place, 0.0]))


def committed(trajectory: Trajectory, robot: str, version: int = 1, period: float = 1.0) -> Commitment:
    way = trajectory
    return Commitment(robot, version, way.measure_times, way.measure_poses, way.times, way.poses, period)


def standing(robot: str, *place: float) -> Commitment:
    pose = np.array([[*place, 0.0]])
    return Commitment(robot, 0, np.zeros(0), np.zeros((0, 4)), np.array([5.0]), pose, 1.0)


def intensity(area: Area, seed: int, clusters: int = 3) -> Intensity:
    """Clusters of a few metres, and undetected targets spread over the area."""
    rng = np.random.default_rng(seed)
    d, side = area.dimension, float(area.high[0])
    means = rng.uniform(0.1 * side, 0.9 * side, (d, clusters))
    seen = np.repeat(means, 20, axis=1) + rng.normal(0, 2.0, (d, 20 * clusters))
    points = np.hstack([seen, rng.uniform(0, side, (d, 100))])
    weights = np.concatenate([np.full(20 * clusters, 0.05), np.full(100, 0.02)])
    covariances = np.stack([(1.0 + i) ** 2 * np.eye(d) for i in range(clusters)])
    return Intensity(points, weights, means, covariances, np.ones(clusters))


def ordinary(setup: PlannerSetup, seed: int = 1) -> PlanProblem:
    """Robot a, half of whose area is explored, with two others on their ways."""
    area = setup.area
    rng = np.random.default_rng(seed)
    side, flies = float(area.high[0]), area.dimension == 3
    believed = intensity(area, seed)
    others = []
    for i, robot in enumerate("bc"):
        if robot not in setup.vehicles:
            continue
        z = 10.0 if flies else 0.0
        begin = state(setup, robot, 0.9 * side, side * (0.9 - 0.3 * i), z)
        goal = np.array([0.6 * side, 0.7 * side - 20 * i, z])
        others.append(committed(setup.vehicles[robot].trajectory(begin, goal, 5.0, 1.0), robot))
    explored = rng.uniform(0.2, 1.0, [7] * area.dimension)
    explored[: 7 // 2] *= 0.1
    return PlanProblem(
        robot="a",
        state=state(setup, "a", 0.2 * side, 0.3 * side, 8.0 if flies else 0.0),
        start_time=5.0,
        measure_period=1.0,
        clusters=believed.means,
        exploration=Exploration(explored, area.low, area.high),
        others=tuple(others),
        area=area,
        separation=3.0,
        intensity=believed,
        seed=seed,
    )


def _emptied(problem: PlanProblem, **changes: Any) -> PlanProblem:
    return dataclasses.replace(problem, **changes)


def _no_clusters(problem: PlanProblem) -> PlanProblem:
    d = problem.area.dimension
    assert problem.intensity is not None
    none = Intensity.empty(d)
    kept = dataclasses.replace(none, points=problem.intensity.points, weights=problem.intensity.weights)
    return _emptied(problem, clusters=np.zeros((d, 0)), intensity=kept)


def _empty_intensity(problem: PlanProblem) -> PlanProblem:
    d = problem.area.dimension
    return _emptied(problem, clusters=np.zeros((d, 0)), intensity=Intensity.empty(d))


def _explored(problem: PlanProblem) -> PlanProblem:
    e = problem.exploration
    return _emptied(problem, exploration=Exploration(np.zeros_like(e.values), e.low, e.high))


def _all_done(problem: PlanProblem) -> PlanProblem:
    return _explored(_empty_intensity(problem))


def _damaged_beliefs(problem: PlanProblem) -> PlanProblem:
    d, e = problem.area.dimension, problem.exploration
    broken = Intensity(
        np.full((d, 2), np.nan), np.ones(2), np.full((d, 1), np.inf), np.full((1, d, d), np.nan), np.ones(1)
    )
    values = np.full_like(e.values, np.nan)
    return _emptied(
        problem,
        clusters=np.full((d, 1), np.nan),
        intensity=broken,
        exploration=Exploration(values, e.low, e.high),
    )


def _two_hundred(problem: PlanProblem) -> PlanProblem:
    rng = np.random.default_rng(3)
    side, z = float(problem.area.high[0]), float(problem.area.dimension == 3) * 9.0
    places = rng.uniform(0, side, (200, 2))
    return _emptied(problem, others=tuple(standing(f"x{i}", *p, z) for i, p in enumerate(places)))


def _alone(problem: PlanProblem) -> PlanProblem:
    return _emptied(problem, others=())


def _damaged_others(problem: PlanProblem) -> PlanProblem:
    broken = dataclasses.replace(problem.others[0], poses=np.full_like(problem.others[0].poses, np.nan))
    nothing = Commitment("c", 1, np.zeros(0), np.zeros((0, 4)), np.zeros(0), np.zeros((0, 4)), 1.0)
    return _emptied(problem, others=(broken, nothing))


def _no_tasks(problem: PlanProblem) -> PlanProblem:
    """What a team that shares its tasks gives a robot when there are none."""
    return _emptied(_all_done(problem), context={"assignment": Assignment((), ())})


def _one_place(problem: PlanProblem) -> PlanProblem:
    e = problem.exploration
    return _emptied(
        _no_clusters(problem), exploration=Exploration(np.ones([1] * e.values.ndim), e.low, e.high)
    )


AWKWARD: dict[str, Callable[[PlanProblem], PlanProblem]] = {
    "one robot": _alone,
    "two hundred others": _two_hundred,
    "damaged commitments": _damaged_others,
    "no clusters": _no_clusters,
    "missing intensity": lambda p: _emptied(p, intensity=None),
    "empty intensity": _empty_intensity,
    "all explored": _explored,
    "nothing left": _all_done,
    "no tasks": _no_tasks,
    "a grid of one place": _one_place,
    "damaged beliefs": _damaged_beliefs,
    "outside the area": lambda p: _emptied(p, state=p.state + 500.0 * (np.arange(p.state.size) < 1)),
    "state not finite": lambda p: _emptied(p, state=np.full_like(p.state, np.nan)),
    "start not finite": lambda p: _emptied(p, start_time=math.inf),
    "period of zero": lambda p: _emptied(p, measure_period=0.0),
    "period not finite": lambda p: _emptied(p, measure_period=math.nan),
    "unknown robot": lambda p: _emptied(p, robot="nobody"),
    "no deadline left": lambda p: _emptied(p, deadline_s=0.0),
    "deadline not a number": lambda p: _emptied(p, deadline_s=math.nan),
    "budget spent": lambda p: _emptied(p, budget=Budget(distance=0.0, time=0.0)),
    "budget not a number": lambda p: _emptied(p, budget=Budget(distance=math.nan, time=math.nan)),
}


def travelled(trajectory: Trajectory) -> float:
    """Metres between its samples."""
    return float(np.linalg.norm(np.diff(trajectory.poses[:, :3], axis=0), axis=1).sum())


def least_gap(trajectory: Trajectory, other: Commitment) -> float:
    """Smallest distance in metres to another robot until the trajectory ends, densely sampled."""
    dense = np.linspace(trajectory.start_time, trajectory.end_time, 4000)
    gaps = [
        np.interp(dense, trajectory.times, trajectory.poses[:, axis])
        - np.interp(dense, other.times, other.poses[:, axis])
        for axis in range(3)
    ]
    return float(np.linalg.norm(gaps, axis=0).min())


def check(plan: Plan, problem: PlanProblem, setup: PlannerSetup) -> None:
    """That a plan is whole: a reason, and a way that begins where and when it must and keeps apart."""
    assert isinstance(plan, Plan)
    assert plan.reason
    assert math.isfinite(plan.objective)
    assert all(math.isfinite(value) for value in plan.terms.values())
    way = plan.trajectory
    if way is None:
        assert plan.reason.startswith("holds")
        return
    vehicle = setup.vehicles[problem.robot]
    for values in (way.waypoint, way.measure_times, way.measure_poses, way.times, way.poses, way.end_state):
        assert np.isfinite(values).all()
    assert way.start_time == problem.start_time == way.times[0] == way.measure_times[0] == way.route_times[0]
    np.testing.assert_allclose(way.poses[0], vehicle.pose(problem.state), atol=1e-9)
    np.testing.assert_allclose(way.measure_poses[0], vehicle.pose(problem.state), atol=1e-9)
    assert way.end_time > way.start_time
    assert way.times[-1] == way.end_time
    assert (np.diff(way.times) >= 0).all()
    assert (np.diff(way.measure_times) > 0).all()
    assert (way.measure_times <= way.end_time).all()
    assert way.route.shape == (len(way.route_times), 3)
    np.testing.assert_array_equal(way.route[-1], way.waypoint)
    for other in problem.others:
        whole = other.times.size and np.isfinite(other.poses).all()
        if not whole or problem.separation <= 0 or other.robot == problem.robot:
            continue
        now = np.array([np.interp(way.start_time, other.times, other.poses[:, i]) for i in range(3)])
        apart = float(np.linalg.norm(vehicle.pose(problem.state)[:3] - now))
        assert least_gap(way, other) >= min(problem.separation, apart) - SLACK
    ground = setup.ground
    if ground is not None:
        d = problem.area.dimension
        assert ground.clear(np.ascontiguousarray(way.route[:, :d].T)).all()


def same(first: Plan, second: Plan) -> None:
    """That two plans are one, to the bit."""
    assert first.reason == second.reason
    assert first.objective == second.objective
    assert dict(first.terms) == dict(second.terms)
    assert (first.trajectory is None) == (second.trajectory is None)
    if first.trajectory is not None and second.trajectory is not None:
        for field in dataclasses.fields(Trajectory):
            one, two = getattr(first.trajectory, field.name), getattr(second.trajectory, field.name)
            assert np.array_equal(one, two), field.name
