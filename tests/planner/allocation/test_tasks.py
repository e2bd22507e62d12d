import dataclasses

import numpy as np
import pytest

from estimator.exploration import Exploration
from planner.allocation.identity import matched
from planner.allocation.partition import equal_shares
from planner.allocation.regions import SLACK, Regions
from planner.allocation.tasks import Request, TaskRules, make_tasks
from planner.plan import Intensity

RULES = TaskRules(regions=6)


def clusters(means, masses=None, spread=2.0):
    means = np.array(means, dtype=float).T.reshape(2, -1)
    c = means.shape[1]
    masses = np.ones(c) if masses is None else np.array(masses, dtype=float)
    return Intensity(means, masses, means, np.tile(spread**2 * np.eye(2), (c, 1, 1)), masses)


def unexplored(points=21, side=100.0):
    return Exploration(np.ones((points, points)), np.zeros(2), np.full(2, side))


def after_looks(exploration, path, reach=8.0):
    """What is left when somebody has looked around along a path (k, 2)."""
    nodes = exploration.nodes()
    left = exploration.values.ravel().copy()
    for place in path:
        left *= 1 - 0.9 * np.exp(-((nodes - place[:, None]) ** 2).sum(axis=0) / (2 * reach**2))
    return dataclasses.replace(exploration, values=left.reshape(exploration.values.shape))


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 13])
@pytest.mark.parametrize("dimension", [2, 3])
def test_regions_have_equal_shares_of_the_mass(count, dimension):
    rng = np.random.default_rng(count)
    points = rng.uniform(0, 100, (dimension, 3000))
    weights = rng.uniform(0, 1, 3000) * (points[0] > 20)
    labels, _ = equal_shares(points, weights, count)
    assert ((labels >= 0) == (weights > 0)).all()
    shares = np.bincount(labels[labels >= 0], weights[labels >= 0], count) / weights.sum()
    assert np.abs(shares - 1 / count).max() < 0.002


def test_more_regions_than_points_and_no_mass_are_nothing_special():
    points = np.arange(6.0).reshape(2, 3)
    labels, _ = equal_shares(points, np.array([1.0, 0.0, 5.0]), 9)
    assert sorted(labels) == [-1, 0, 1]
    assert (equal_shares(points, np.zeros(3), 4)[0] == -1).all()
    assert (equal_shares(points, np.ones(3), 0)[0] == -1).all()
    for name, weights in [("weights", np.array([1, -1, 1.0])), ("weights", np.array([np.nan, 1, 1]))]:
        with pytest.raises(ValueError, match=name):
            equal_shares(points, weights, 2)
    with pytest.raises(ValueError, match="shape"):
        equal_shares(points, np.ones(2), 2)
    with pytest.raises(ValueError, match="count"):
        equal_shares(points, np.ones(3), -1)


def test_a_cut_keeps_its_direction_until_the_other_is_much_longer():
    def box(width, height):
        return np.stack(
            [a.ravel() for a in np.meshgrid(np.linspace(0, width, 20), np.linspace(0, height, 20))]
        )

    _, axes = equal_shares(box(10, 9), np.ones(400), 2)
    assert axes == {"": 0}
    assert equal_shares(box(10, 12), np.ones(400), 2, axes)[1] == {"": 0}
    assert equal_shares(box(10, 12), np.ones(400), 2)[1] == {"": 1}
    assert equal_shares(box(10, 20), np.ones(400), 2, axes)[1] == {"": 1}


@pytest.mark.parametrize("seed", range(5))
def test_matching_is_the_best_of_all_by_brute_force(seed):
    import itertools

    rng = np.random.default_rng(seed)
    cost = rng.uniform(0, 10, (4, 5))
    best = min(
        itertools.permutations(range(5), 4),
        key=lambda p: (
            -sum(cost[i, j] <= 6 for i, j in enumerate(p)),
            sum(cost[i, j] for i, j in enumerate(p) if cost[i, j] <= 6),
        ),
    )
    assert matched(cost, 6.0) == [j if cost[i, j] <= 6 else -1 for i, j in enumerate(best)]
    assert matched(np.zeros((2, 0)), 1.0) == [-1, -1]
    assert matched(np.zeros((0, 2)), 1.0) == []


def regions_of(exploration, count=6):
    return Regions.of(exploration.nodes(), count)


def tasks(exploration, intensity, requests=(), known=None, rules=RULES):
    return make_tasks(rules, regions_of(exploration, rules.regions), exploration, intensity, requests, known)


def places(made):
    return {task.name: task.place for task in made}


def names(made, kind):
    return [task.name for task in made if task.kind == kind]


def test_tasks_are_clusters_regions_and_requests_with_what_they_stand_for():
    request = Request("look-here", np.array([5.0, 5.0]), 2.0, robots=2, needs=("camera",))
    given = clusters([(20, 20), (24, 20), (80, 80)], [2.0, 1.0, 0.5])
    made = tasks(unexplored(), given, (request,))
    by_name = {task.name: task for task in made}
    assert [task.kind for task in made] == ["refine"] * 2 + ["explore"] * 8 + ["request"]
    near = by_name["refine-2.2"]  # two clusters closer than the spacing are one task
    assert near.mass == pytest.approx(3.0)
    assert near.place == pytest.approx([20 + 4 / 3, 20])
    assert near.covariances.shape == (2, 2, 2)
    regions = [task for task in made if task.kind == "explore"]
    assert sum(task.mass for task in regions) == pytest.approx(1.0)
    assert max(task.mass for task in regions) < 1.15 * min(task.mass for task in regions)
    assert (by_name["look-here"].robots, by_name["look-here"].mass) == (2, 2.0)
    assert by_name["look-here"].needs == ("camera",)


@pytest.mark.parametrize("seed", range(4))
def test_regions_hold_equal_shares_of_what_is_left_up_to_a_factor_and_lose_nothing(seed):
    rng = np.random.default_rng(seed)
    exploration = after_looks(unexplored(41), rng.uniform(0, 100, (30, 2)), reach=15.0)
    cut = regions_of(exploration)
    weights = exploration.values.ravel()
    found = cut.shares(weights, 6)
    rows = np.concatenate([points for _, points in found])
    assert sorted(rows) == sorted(np.flatnonzero(weights > 0))
    masses = {number: weights[points].sum() for number, points in found}
    assert max(masses.values()) <= SLACK * weights.sum() / 6 + weights.max()
    # None is smaller than it must be: together with its other half it would hold more than its share.
    assert [number for number, _ in cut.shares(weights, 1e-9)] == [1]
    for number, mass in masses.items():
        if number > 1 and number ^ 1 in masses:
            assert mass + masses[number ^ 1] > SLACK * weights.sum() / 6 - 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_robots_that_have_seen_different_things_mean_the_same_place_by_a_regions_name(seed):
    rng = np.random.default_rng(seed)
    cut = regions_of(unexplored(41))
    seen = [after_looks(unexplored(41), rng.uniform(0, 100, (4, 2)), 9.0) for _ in range(2)]
    first, second = (dict(cut.shares(0.01 + e.values.ravel(), 6)) for e in seen)
    shared = first.keys() & second.keys()
    assert len(shared) >= 3
    assert all(first[number].tolist() == second[number].tolist() for number in shared)


def test_names_stay_while_the_posterior_changes_slowly_and_allocations_do_not_churn():
    """A robot explores a field line by line, and targets wander a little: little changes."""
    rng = np.random.default_rng(3)
    means = rng.uniform(10, 90, (8, 2))
    exploration, before, lost = unexplored(), (), []
    for step in range(60):
        means = means + rng.normal(0, 0.3, means.shape)
        path = np.array([[5 + 1.5 * step, 10.0 + 20 * (step % 5)]])
        exploration = after_looks(exploration, path)
        order = rng.permutation(8)  # filters give clusters in any order
        made = tasks(exploration, clusters(means[order]), known=places(before))
        if step:
            lost.append(len(places(before).keys() - places(made).keys()) / len(before))
            old = places(before)
            moved = [np.linalg.norm(t.place - old[t.name]) for t in made if t.name in old]
            assert max(moved) < 30.0
        before = made
    assert np.mean(lost) < 0.025
    assert max(lost) <= 0.5


@pytest.mark.parametrize("seed", range(5))
def test_robots_of_different_posteriors_name_clusters_alike_once_they_heard_each_other(seed):
    """Each has an estimate of its own of the same eight targets; some are named apart before they talk."""
    rng = np.random.default_rng(seed)
    truth = np.array([(x, y) for x in (15, 40, 65, 90) for y in (20, 75)]) + rng.uniform(-4, 4, (8, 2))
    seen = [[truth + rng.normal(0, 1.0, truth.shape) for _ in range(3)] for _ in range(3)]
    boards = [tasks(unexplored(), clusters(own[0])) for own in seen]
    apart = {frozenset(names(board, "refine")) for board in boards}
    assert len(apart) > 1, "the test must have something to show"
    for turn in (1, 2):
        heard = [places(board) for board in boards]
        for i, own in enumerate(seen):
            known = {}
            for other in heard:
                known |= other
            boards[i] = tasks(unexplored(), clusters(own[turn]), known=known | heard[i])
    for board in boards[1:]:
        mine, theirs = places(boards[0]), places(board)
        assert {n for n in mine if n.startswith("refine")} == {n for n in theirs if n.startswith("refine")}
        assert all(np.linalg.norm(mine[n] - theirs[n]) < 8.0 for n in mine if n.startswith("refine"))


def test_a_target_that_turns_up_where_another_was_named_gets_a_name_of_its_own():
    first = tasks(unexplored(), clusters([(21, 21)]))
    assert names(first, "refine") == ["refine-2.2"]
    moved = tasks(unexplored(), clusters([(34, 21)]), known=places(first))
    assert names(moved, "refine") == ["refine-2.2"]
    both = tasks(unexplored(), clusters([(34, 21), (22, 22)]), known=places(moved))
    assert names(both, "refine") == ["refine-2.2", "refine-2.2_2"]
    gone = tasks(unexplored(), clusters([(34, 21)]), known=places(both))
    assert names(gone, "refine") == ["refine-2.2"]


def test_what_is_explored_is_no_task_and_what_is_not_finite_is_left_out():
    explored = dataclasses.replace(unexplored(), values=np.full((21, 21), 5e-5))
    assert tasks(explored, Intensity.empty(2)) == ()
    bad = clusters([(20, 20), (np.nan, 3), (50, 50)], [1.0, 1.0, np.inf])
    bad = dataclasses.replace(bad, points=np.full((2, 1), np.nan), weights=np.ones(1))
    damaged = explored.values.copy()
    damaged[3, 3] = np.nan
    requests = (
        Request("a", np.array([np.inf, 0.0])),
        Request("b", np.zeros(3)),
        Request("c", np.zeros(2), robots=0),
        Request("d#1", np.zeros(2)),
    )
    known = {"refine-9.9": np.zeros(3), "explore-2": np.array([20.0, 20.0])}
    made = tasks(dataclasses.replace(explored, values=damaged), bad, requests, known)
    assert [task.name for task in made] == ["refine-2.2"]


def test_targets_that_nobody_has_seen_are_looked_for_where_all_is_explored():
    """One target is still expected, nine times as likely in the upper right as in the lower left."""
    explored = dataclasses.replace(unexplored(), values=np.full((21, 21), 5e-5))
    points = np.array([[92.0, 8.0], [91.0, 7.0]])
    intensity = dataclasses.replace(Intensity.empty(2), points=points, weights=np.array([0.9, 0.1]))
    made = tasks(explored, intensity)
    assert {task.kind for task in made} == {"explore"}
    assert sum(task.mass for task in made) == pytest.approx(RULES.unexplored)
    most = max(made, key=lambda task: task.mass)
    assert most.place == pytest.approx([90.0, 90.0], abs=2.5)
    assert most.mass / RULES.unexplored == pytest.approx(0.9)
    again = dataclasses.replace(
        explored, values=np.where(np.arange(21) == 3, 0.01, 0.0)[:, None] * np.ones(21)
    )
    made = tasks(again, dataclasses.replace(intensity, weights=0.1 * intensity.weights))
    assert {x for task in made for x in task.points[0]} == {15.0}  # none: where looks were fewest


def test_without_a_spacing_every_cluster_is_a_task():
    given = clusters([(20, 20), (20.4, 20), (80, 80)])
    made = tasks(unexplored(), given, rules=dataclasses.replace(RULES, spacing=0.0))
    assert len(names(made, "refine")) == 3


def test_of_too_many_tasks_the_least_are_left_out_and_no_request():
    rng = np.random.default_rng(0)
    given = clusters(rng.uniform(0, 1e5, (400, 2)), rng.uniform(0.5, 1.0, 400))
    request = Request("request-x", np.array([5.0, 5.0]), 0.01)
    made = tasks(unexplored(), given, (request,))
    assert len(made) == 256
    assert "request-x" in places(made)
    assert min(task.mass for task in made if task.kind == "refine") > 0.6


def test_a_three_dimensional_area_has_tasks_too():
    exploration = Exploration(np.ones((6, 6, 6)), np.zeros(3), np.full(3, 50.0))
    made = tasks(exploration, Intensity.empty(3))
    assert len(made) == 8
    assert all(task.place.shape == (3,) for task in made)
