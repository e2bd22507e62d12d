import dataclasses
import itertools

import numpy as np
import pytest

from estimator.exploration import Exploration
from planner.allocation.desk import Assignment
from planner.allocation.planner import Cbba
from planner.allocation.tasks import Request
from planner.plan import Budget, Commitment
from tests.planner.problems import committed, problem, team


def planner(setup, **changes):
    return Cbba(Cbba.Config(**{"control_cost": 0.0, **changes}), setup)


def standing(robot, place, version=0):
    pose = np.array([*place, 0.0])
    return Commitment(robot, version, np.zeros(0), np.zeros((0, 4)), np.array([3.0]), pose[None], 1.0)


def fresh(given):
    """The same problem with nothing explored."""
    e = given.exploration
    return dataclasses.replace(given, exploration=dataclasses.replace(e, values=np.ones(e.values.shape)))


def task_of(plan):
    return plan.reason.split(":")[0]


PLACES = {"a": (3.0, 3.0, 5.0), "b": (37.0, 3.0, 5.0), "c": (3.0, 37.0, 5.0), "d": (37.0, 37.0, 5.0)}


def assigned(setup, given, *path, requests=()):
    """The problem with an allocation that was settled before."""
    made = planner(setup).desk(given.robot).tasks(given, requests)
    names = {task.name for task in made}
    assert set(path) <= names, names
    return dataclasses.replace(given, context={"assignment": Assignment(made, path)})


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_robot_goes_to_the_first_of_the_tasks_that_it_was_given(dimension, order):
    setup = team(dimension, "ab")
    given = fresh(problem(setup, 1, "a", clusters=0, start=PLACES["a"]))
    requests = [Request("near", given.area.low + 8.0), Request("far", given.area.high - 4.0)]
    path = [requests[i].name for i in order]
    plan = planner(setup).plan(assigned(setup, given, *path, requests=requests))
    assert plan.task == task_of(plan) == path[0]
    place = requests[order[0]].place
    assert plan.trajectory.waypoint[:dimension] == pytest.approx(place)


def test_a_robot_that_was_given_nothing_takes_what_is_worth_most_to_itself():
    setup = team(2, "ab")
    given = problem(setup, 1, "a", [standing("b", PLACES["a"])], clusters=0, start=PLACES["a"])
    e = given.exploration
    wishes = (Request("far", np.array([37.0, 37.0]), 2.0), Request("crowd", np.array([5.0, 5.0]), 9.0, 2))
    given = dataclasses.replace(
        given,
        exploration=Exploration(np.zeros(e.values.shape), e.low, e.high),
        context={"requests": wishes},
    )
    assert planner(setup).plan(given).task == "far"  # and not one that needs two


def test_a_robot_stays_with_its_task_until_it_is_done():
    setup = team(2, "ab")
    cbba = planner(setup)
    given = fresh(problem(setup, 1, "a", [standing("b", PLACES["d"])], clusters=1, start=PLACES["a"]))
    tasks = []
    for _ in range(6):
        plan = cbba.plan(given)
        assert plan.trajectory is not None
        tasks.append(task_of(plan))
        way = plan.trajectory
        explored = given.exploration.after(setup.sensors["a"], way.measure_poses)
        given = dataclasses.replace(given, state=way.end_state, exploration=explored, start_time=way.end_time)
    changes = sum(a != b for a, b in itertools.pairwise(tasks))
    assert changes <= 4


def test_the_way_keeps_apart_from_the_others_and_within_the_budget():
    setup = team(2, "ab")
    vehicle = setup.vehicles["b"]
    across = committed(
        vehicle.trajectory(
            vehicle.initial_state(np.array([20.0, 0.0, 5.0, 0.0])), np.array([20.0, 40.0, 5.0]), 3.0, 1.0
        )
    )
    for distance in (0.0, 5.0, 15.0, 60.0):
        for home in (None, np.array([3.0, 3.0, 5.0])):
            given = fresh(problem(setup, 2, "a", [across], separation=4.0, start=PLACES["a"]))
            given = dataclasses.replace(given, budget=Budget(distance=distance, home=home))
            plan = planner(setup).plan(given)
            if plan.trajectory is None:
                assert "budget" in plan.reason
                continue
            way = np.diff(plan.trajectory.poses[:, :2], axis=0)
            back = 0.0 if home is None else float(np.linalg.norm(plan.trajectory.waypoint - home))
            assert np.linalg.norm(way, axis=1).sum() + back <= distance * 1.02
            assert distance > 5.0 or home is None


@pytest.mark.parametrize("seconds", [0.0, 2.0, 8.0])
def test_no_plan_takes_longer_than_the_budget(seconds):
    setup = team(2, "a")
    given = fresh(problem(setup, 2, "a", start=PLACES["a"]))
    given = dataclasses.replace(given, budget=Budget(time=seconds))
    plan = planner(setup).plan(given)
    if plan.trajectory is not None:
        assert plan.trajectory.end_time - given.start_time <= seconds
    assert (plan.trajectory is None) == (seconds < 2.0) or seconds == 2.0


def test_nothing_left_to_do_is_a_hold_with_the_reason():
    setup = team(2, "a")
    given = problem(setup, 1, "a", clusters=0)
    e = given.exploration
    given = dataclasses.replace(given, exploration=Exploration(np.zeros(e.values.shape), e.low, e.high))
    plan = planner(setup).plan(given)
    assert plan.trajectory is None
    assert plan.reason.startswith("holds: there are no tasks")


def test_an_operators_request_is_a_task_like_any_other():
    setup = team(2, "a")
    given = problem(setup, 1, "a", clusters=0, start=PLACES["a"])
    e = given.exploration
    given = dataclasses.replace(
        given,
        exploration=Exploration(np.zeros(e.values.shape), e.low, e.high),
        context={"requests": (Request("north-wall", np.array([20.0, 39.0])),)},
    )
    plan = planner(setup).plan(given)
    assert plan.trajectory is not None
    assert task_of(plan) == "north-wall"
    assert plan.trajectory.waypoint == pytest.approx([20.0, 39.0, 5.0])


def test_a_robot_without_tasks_helps_with_the_nearest_also_where_its_own_are_gone():
    setup = team(2, "ab")
    given = problem(setup, 1, "b", [standing("a", (20.0, 20.0, 5.0))], clusters=0, start=PLACES["d"])
    e = given.exploration
    given = dataclasses.replace(given, exploration=Exploration(np.zeros(e.values.shape), e.low, e.high))
    requests = (Request("here", np.array([21.0, 20.0])), Request("there", np.array([1.0, 1.0])))
    plan = planner(setup).plan(assigned(setup, given, requests=requests))
    assert plan.trajectory is not None
    assert plan.reason.startswith("all tasks are others'")
    assert plan.task == "here"
    made = assigned(setup, given, requests=requests).context["assignment"]
    gone = dataclasses.replace(given, context={"assignment": dataclasses.replace(made, path=("no-more",))})
    assert planner(setup).plan(gone).task == "here"


@pytest.mark.parametrize("seed", range(3))
def test_unknown_and_damaged_others_and_clusters_are_planned_around(seed):
    setup = team(2, "ab")
    nan = np.full((1, 4), np.nan)
    others = [
        standing("stranger", PLACES["c"]),
        Commitment("b", 0, np.zeros(0), np.zeros((0, 4)), np.array([3.0]), nan, 1.0),
        Commitment("b", 0, np.zeros(0), np.zeros((0, 4)), np.zeros(0), np.zeros((0, 4)), 1.0),
    ]
    given = fresh(problem(setup, seed, "a", others, start=PLACES["a"]))
    clusters = given.clusters.copy()
    clusters[0, 0] = np.nan
    plan = planner(setup).plan(dataclasses.replace(given, clusters=clusters))
    assert plan.trajectory is not None
    assert np.isfinite(plan.trajectory.poses).all()


def test_a_robot_without_a_model_or_a_finite_state_holds():
    setup = team(2, "a")
    given = problem(setup, 1, "a")
    assert "no vehicle" in planner(setup).plan(dataclasses.replace(given, robot="x")).reason
    assert "finite" in planner(setup).plan(dataclasses.replace(given, state=given.state * np.nan)).reason


def test_two_hundred_robots_plan():
    robots = [f"r{i:03d}" for i in range(200)]
    setup = team(2, robots, side=400.0)
    rng = np.random.default_rng(0)
    others = [standing(robot, (*rng.uniform(0, 400, 2), 5.0)) for robot in robots[1:]]
    given = fresh(problem(setup, 1, robots[0], others, start=(200.0, 200.0, 5.0)))
    plan = planner(setup).plan(given)
    assert plan.trajectory is not None


def test_requests_that_no_team_can_meet_and_budgets_that_are_no_numbers_are_held_for():
    setup = team(2, "a")
    given = fresh(problem(setup, 1, "a", clusters=0, start=PLACES["a"]))
    wishes = (
        Request("crowd", np.array([5.0, 5.0]), 99.0, robots=10**9),
        Request("crowd", np.array([9.0, 9.0])),
    )
    plan = planner(setup).plan(dataclasses.replace(given, context={"requests": wishes}))
    assert plan.trajectory is not None
    assert task_of(plan).startswith("explore")
    spent = planner(setup).plan(dataclasses.replace(given, budget=Budget(time=np.nan)))
    assert "budget" in spent.reason


def test_it_remembers_nothing_from_one_plan_to_the_next():
    setup = team(2, "ab")
    given = fresh(problem(setup, 1, "a", [standing("b", PLACES["d"])], clusters=1, start=PLACES["a"]))
    expected = planner(setup).plan(given).reason
    elsewhere = dataclasses.replace(
        given, state=setup.vehicles["a"].initial_state(np.array([30.0, 9.0, 5.0, 0]))
    )
    cbba = planner(setup)
    cbba.plan(dataclasses.replace(elsewhere, start_time=0.0, context={"rehearsal": True}))
    assert cbba.plan(given).reason == expected
    cbba.plan(dataclasses.replace(elsewhere, start_time=99.0))
    assert cbba.plan(given).reason == expected


@pytest.mark.parametrize("seconds", [0.0, 0.001, 0.005, 10.0])
def test_a_deadline_leaves_the_best_plan_so_far_or_a_hold(seconds):
    setup = team(2, "ab")
    given = fresh(problem(setup, 1, "a", [standing("b", PLACES["d"])], clusters=1, start=PLACES["a"]))
    plan = planner(setup).plan(dataclasses.replace(given, deadline_s=seconds))
    assert plan.trajectory is not None or plan.reason.startswith("holds")
    if seconds == 0.0:
        assert plan.trajectory is None
    if seconds == 10.0:
        assert plan.objective == pytest.approx(planner(setup).plan(given).objective)


class Wall:
    """A wall across the middle with a gap at the top."""

    def clear(self, points):
        return ~((abs(points[0] - 20.0) < 1.0) & (points[1] < 35.0))

    def segments_clear(self, starts, ends):
        return ((starts[0] < 20.0) == (ends[0] < 20.0)) | ((starts[1] > 35.0) & (ends[1] > 35.0))

    def path(self, start, goal, over=None):
        return np.stack([start, [18.0, 37.0], [22.0, 37.0], goal], axis=1)

    def paths(self, start, goals, over=None):
        return [self.path(start, goal) for goal in goals.T]

    def distances(self, goal, points, over=None, within=np.inf):
        return np.linalg.norm(points - goal[:, None], axis=0)


def test_obstacles_are_gone_around():
    setup = dataclasses.replace(team(2, "a"), ground=Wall())
    given = problem(setup, 1, "a", clusters=0, start=PLACES["a"])
    e = given.exploration
    request = Request("behind", np.array([35.0, 5.0]))
    given = dataclasses.replace(
        given,
        exploration=Exploration(np.zeros(e.values.shape), e.low, e.high),
        context={"requests": (request,)},
    )
    plan = planner(setup).plan(given)
    assert plan.trajectory is not None
    assert plan.trajectory.route[:, :2].tolist() == [[18.0, 37.0], [22.0, 37.0], [35.0, 5.0]]
    assert plan.trajectory.poses[-1, :2] == pytest.approx([35.0, 5.0], abs=1.0)
    short = dataclasses.replace(given, budget=Budget(distance=40.0))
    assert planner(setup).plan(short).trajectory is None
