import dataclasses
import math

import msgspec
import numpy as np
import pytest

from estimator.exploration import Exploration
from planner.maasi.candidates import CandidateGrid
from planner.maasi.maasi import Maasi
from planner.maasi.outlook import outlook
from planner.plan import Commitment, PlannerSetup
from tests.planner.problems import committed, problem, slow_looks, slow_objective, team


def planner(setup, points=2, **changes):
    d = setup.area.dimension
    side = float(setup.area.high[0])
    grid = CandidateGrid(low=[0.1 * side] * d, high=[0.9 * side] * d, points=[points] * d)
    defaults = {"alpha": 0.7, "beta": 0.4, "control_cost": 0.01, "candidates": grid}
    return Maasi(Maasi.Config(**{**defaults, **changes}), setup)


def others_of(setup, seed, robots="bc"):
    """Committed plans on their way since before, during and after the problem's start."""
    rng = np.random.default_rng(100 + seed)
    side = setup.area.high[0]
    plans = []
    for i, robot in enumerate(robots):
        vehicle = setup.vehicles[robot]
        state = vehicle.initial_state(np.append(rng.uniform(0, side, 3), 0.0))
        trajectory = vehicle.trajectory(state, rng.uniform(0, side, 3), 1.37 * i, 0.8 + 0.3 * i)
        plans.append(committed(trajectory, robot, 0.8 + 0.3 * i))
    return plans


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_objective_is_that_of_the_paper_read_literally(seed, dimension):
    setup = team(dimension, "abc")
    others = others_of(setup, seed)
    given = problem(setup, seed, others=others)
    maasi = planner(setup)
    plan = maasi.plan(given)
    altitude = given.state[2]
    expected = []
    for waypoint in maasi.candidates.waypoints(altitude):
        seen = [(o.robot, t, q) for o in others for t, q in slow_looks(o, given.start_time, 60.0)]
        expected.append(slow_objective(given, setup, waypoint, maasi.config, seen))
    best = int(np.argmax(expected))
    assert plan.trajectory is not None
    assert np.array_equal(plan.trajectory.waypoint, maasi.candidates.waypoints(altitude)[best])
    assert plan.objective == pytest.approx(expected[best], rel=1e-9)
    gain = 0.7 * plan.terms["refinement"] + 0.4 * plan.terms["exploration"] - 0.01 * plan.terms["control"]
    assert plan.objective == pytest.approx(gain / plan.terms["steps"])


@pytest.mark.parametrize("period", [0.1, 0.77, 2.5])
def test_every_candidate_has_the_literal_exploration_term(period):
    setup = team(3, "ab")
    others = others_of(setup, 9, "b")
    given = problem(setup, 9, others=others, period=period, clusters=0, start=[20.0, 20.0, 20.0])
    config = Maasi.Config(alpha=0.0, beta=1.0, control_cost=0.0)
    waypoints = np.array([[22.0, 20.0, 20.0], [10.0, 15.0, 20.0], [55.0, -9.0, 20.0]])  # the last is outside
    view = outlook(given, setup, waypoints, given.others)
    seen = [("b", t, q) for t, q in slow_looks(others[0], given.start_time, 60.0)]
    for i, waypoint in enumerate(waypoints):
        expected = slow_objective(given, setup, waypoint, config, seen) * view.steps[i]
        assert view.exploration[i] == pytest.approx(expected, rel=1e-9)


def test_value_falls_where_another_robot_will_look():
    setup = team(2)
    alone = problem(setup, 3, clusters=0, start=[5.0, 5.0, 10.0])
    vehicle = setup.vehicles["b"]
    start = vehicle.initial_state(np.array([30.0, 5.0, 10.0, 0.0]))
    other = committed(vehicle.trajectory(start, np.array([35.0, 35.0, 10.0]), 3.0, 1.0))
    waypoints = np.array([[35.0, 35.0, 10.0], [5.0, 35.0, 10.0]])
    free = outlook(alone, setup, waypoints, ()).exploration
    shared = outlook(alone, setup, waypoints, (other,)).exploration
    assert (shared < free).all()
    assert shared[0] / free[0] < shared[1] / free[1] - 0.1


def test_two_robots_of_one_mind_part_when_one_has_committed():
    setup = team(2)
    given = problem(setup, 0, clusters=0, start=[20.0, 20.0, 10.0])
    given = dataclasses.replace(given, exploration=Exploration.unexplored(setup.area, [9, 9]))
    maasi = planner(setup)
    first = maasi.plan(given)
    second = maasi.plan(dataclasses.replace(given, robot="b", others=(committed(first.trajectory, "a"),)))
    assert not np.array_equal(first.trajectory.waypoint, second.trajectory.waypoint)


def test_ties_go_to_the_lowest_index():
    setup = team(2)
    given = problem(setup, 0, clusters=0, start=[20.0, 20.0, 10.0])
    given = dataclasses.replace(given, exploration=Exploration(np.zeros((5, 5)), *_corners(setup)))
    maasi = planner(setup, control_cost=0.0)
    plan = maasi.plan(given)
    assert plan.objective == 0.0
    assert plan.reason.startswith("candidate 0 ")


def _corners(setup):
    return setup.area.low, setup.area.high


def test_fully_explored_and_without_clusters_it_still_goes_somewhere():
    setup = team(3)
    given = problem(setup, 1, clusters=0)
    given = dataclasses.replace(given, exploration=Exploration(np.zeros((5, 5, 5)), *_corners(setup)))
    plan = planner(setup).plan(given)
    assert plan.trajectory is not None
    assert plan.terms["refinement"] == plan.terms["exploration"] == 0.0


def test_candidate_where_it_stands_is_no_choice():
    setup = team(2)
    maasi = planner(setup)
    for waypoint in maasi.candidates.waypoints(10.0):
        plan = maasi.plan(problem(setup, 2, start=waypoint))
        assert not np.array_equal(plan.trajectory.waypoint, waypoint)
    only = planner(setup, points=1).plan(problem(setup, 2, start=[20.0, 20.0, 10.0]))
    assert only.trajectory is None
    assert "only candidate" in only.reason


def test_flying_robots_search_a_plane_at_their_altitude():
    setup = team(2)
    plan = planner(setup).plan(problem(setup, 4, start=[3.0, 3.0, 17.0]))
    assert plan.trajectory.waypoint[2] == 17.0


def gap(first, second):
    """Smallest distance of two trajectories, densely sampled."""
    dense = np.linspace(first.start_time, first.end_time, 3000)
    there = [
        np.interp(dense, first.times, first.poses[:, axis])
        - np.interp(dense, second.times, second.poses[:, axis])
        for axis in range(3)
    ]
    return np.linalg.norm(there, axis=0).min()


@pytest.mark.parametrize("seed", range(8))
def test_chosen_way_keeps_the_separation(seed):
    setup = team(2, "ab")
    vehicle = setup.vehicles["b"]
    rng = np.random.default_rng(seed)
    start = vehicle.initial_state(np.array([38.0, 38.0, 10.0, 0.0]))
    there = vehicle.trajectory(start, np.array([*rng.uniform(2, 38, 2), 10.0]), 3.0, 1.0)
    given = problem(setup, seed, others=[committed(there)], start=[2.0, 2.0, 10.0], separation=6.0)
    plan = planner(setup, points=3).plan(given)
    assert plan.trajectory is not None
    assert gap(plan.trajectory, there) >= 6.0 - 0.05


def standing(robot, place, time=0.0):
    poses = np.append(np.array(place, dtype=float), 0.0)[None]
    return Commitment(robot, 1, np.zeros(0), np.zeros((0, 4)), np.array([time]), poses, 1.0)


def test_separation_can_forbid_the_best_candidate():
    setup = team(2, "ab")
    free = planner(setup).plan(problem(setup, 5, start=[20.0, 20.0, 10.0]))
    guard = standing("b", free.trajectory.waypoint)
    kept = planner(setup).plan(problem(setup, 5, others=[guard], start=[20.0, 20.0, 10.0], separation=5.0))
    assert not np.array_equal(kept.trajectory.waypoint, free.trajectory.waypoint)


def test_holds_with_a_reason_when_every_way_is_blocked():
    setup = team(2, "ab")
    maasi = planner(setup, points=1)
    plan = maasi.plan(
        problem(setup, 5, others=[standing("b", [20.0, 20.0, 10.0])], start=[2.0, 2.0, 10.0], separation=5.0)
    )
    assert plan.trajectory is None
    assert "5 m" in plan.reason


def test_robots_too_close_already_may_part():
    setup = team(2, "ab")
    near = standing("b", [19.0, 20.0, 10.0])
    plan = planner(setup).plan(problem(setup, 5, others=[near], start=[20.0, 20.0, 10.0], separation=5.0))
    assert plan.trajectory is not None
    assert plan.trajectory.waypoint[0] > 20.0


def test_own_and_unknown_and_damaged_commitments_do_no_harm():
    setup = team(2, "ab")
    given = problem(setup, 6, separation=0.0)
    expected = planner(setup).plan(given)
    own = standing("a", given.state[:3])
    stranger = standing("z", [1.0, 1.0, 1.0])
    damaged = dataclasses.replace(standing("b", [1.0, 1.0, 1.0]), poses=np.full((1, 4), np.nan))
    nothing = np.zeros(0)
    empty = Commitment("b", 1, nothing, np.zeros((0, 4)), nothing, np.zeros((0, 4)), 1.0)
    for other in (own, stranger, damaged, empty):
        plan = planner(setup).plan(dataclasses.replace(given, others=(other,)))
        assert plan.objective == expected.objective


def test_read_only_arrays_are_fine():
    setup = team(2, "ab")
    other = standing("b", [30.0, 20.0, 10.0])
    given = problem(setup, 6, others=[other], separation=2.0)
    expected = planner(setup).plan(given).objective
    for array in (given.state, given.clusters, given.exploration.values, other.poses, other.times):
        array.flags.writeable = False
    assert planner(setup).plan(given).objective == expected


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"state": np.full(18, np.nan)}, "not finite"),
        ({"start_time": math.inf}, "not finite"),
        ({"measure_period": 0.0}, "measurement period"),
        ({"measure_period": math.nan}, "measurement period"),
        ({"robot": "nobody"}, "nobody"),
    ],
)
def test_awkward_problem_holds_with_a_reason(change, named):
    setup = team(2)
    plan = planner(setup).plan(dataclasses.replace(problem(setup, 0), **change))
    assert plan.trajectory is None
    assert plan.reason.startswith("holds")
    assert named in plan.reason


def test_clusters_that_are_not_finite_are_left_out():
    setup = team(2)
    given = problem(setup, 0)
    damaged = np.column_stack([given.clusters, [np.nan, 1.0]])
    plan = planner(setup).plan(dataclasses.replace(given, clusters=damaged))
    assert plan.objective == planner(setup).plan(given).objective


def test_damaged_exploration_holds_with_a_reason():
    setup = team(2)
    damaged = Exploration(np.full((5, 5), np.nan), *_corners(setup))
    plan = planner(setup).plan(dataclasses.replace(problem(setup, 0), exploration=damaged))
    assert plan.trajectory is None
    assert "not a number" in plan.reason


def test_without_candidates_in_the_mission_the_area_has_some():
    for dimension, count in ((2, 16), (3, 27)):
        maasi = Maasi(Maasi.Config(), team(dimension))
        assert len(maasi.candidates.waypoints(0.0)) == count


def test_terms_do_not_depend_on_how_the_work_is_cut(monkeypatch):
    setup = team(3, "ab")
    given = problem(setup, 7, others=others_of(setup, 7, "b"), period=0.2)
    expected = planner(setup).plan(given)
    monkeypatch.setattr("planner.maasi.coverage.CALL", 1)
    monkeypatch.setattr("planner.maasi.coverage.BATCH", 100)
    monkeypatch.setattr("planner.maasi.outlook.BATCH", 10)
    plan = planner(setup).plan(given)
    assert plan.objective == pytest.approx(expected.objective, rel=1e-12)


def test_unknown_key_in_the_mission_is_refused():
    with pytest.raises(msgspec.ValidationError, match="gamma"):
        msgspec.convert({"alpha": 0.5, "gamma": 1.0}, Maasi.Config)


def test_any_sensor_and_vehicle_may_differ_by_robot():
    near, far = team(2, "ab", reach=3.0), team(2, "ab", reach=12.0)
    mixed = PlannerSetup(near.vehicles, {"a": near.sensors["a"], "b": far.sensors["b"]}, near.area)
    others = others_of(near, 1, "b")
    given = problem(near, 1, others=others)
    maasi = planner(mixed)
    plan = maasi.plan(given)
    seen = [("b", t, q) for t, q in slow_looks(others[0], given.start_time, 60.0)]
    expected = slow_objective(given, mixed, plan.trajectory.waypoint, maasi.config, seen)
    assert plan.objective == pytest.approx(expected, rel=1e-9)
