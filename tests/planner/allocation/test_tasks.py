import dataclasses

import numpy as np
import pytest

from estimator.exploration import Exploration
from planner.allocation.identity import matched
from planner.allocation.partition import equal_shares
from planner.allocation.tasks import Request, TaskBoard, TaskRules, churn
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


def test_tasks_are_clusters_regions_and_requests_with_what_they_stand_for():
    request = Request("look-here", np.array([5.0, 5.0]), 2.0, robots=2)
    given = clusters([(20, 20), (24, 20), (80, 80)], [2.0, 1.0, 0.5])
    board = TaskBoard().renewed(RULES, unexplored(), given, (request,))
    by_name = {task.name: task for task in board.tasks}
    assert [task.kind for task in board.tasks] == ["refine"] * 2 + ["explore"] * 6 + ["request"]
    near = by_name["refine-0"]  # two clusters closer than the spacing are one task
    assert near.mass == pytest.approx(3.0)
    assert near.place == pytest.approx([20 + 4 / 3, 20])
    assert near.covariances.shape == (2, 2, 2)
    regions = [task for task in board.tasks if task.kind == "explore"]
    assert sum(task.mass for task in regions) == pytest.approx(1.0)
    assert max(task.mass for task in regions) < 1.15 * min(task.mass for task in regions)
    assert (by_name["look-here"].robots, by_name["look-here"].mass) == (2, 2.0)


def test_names_stay_while_the_posterior_changes_slowly_and_allocations_do_not_churn():
    """A robot explores a field line by line, and targets wander a little: little changes."""
    rng = np.random.default_rng(3)
    means = rng.uniform(10, 90, (8, 2))
    exploration, board, lost = unexplored(), TaskBoard(), []
    for step in range(60):
        means = means + rng.normal(0, 0.3, means.shape)
        path = np.array([[5 + 1.5 * step, 10.0 + 20 * (step % 5)]])
        exploration = after_looks(exploration, path)
        order = rng.permutation(8)  # filters give clusters in any order
        before, board = board, board.renewed(RULES, exploration, clusters(means[order]))
        if step:
            lost.append(churn(before, board))
            old = {task.name: task.place for task in before.tasks}
            moved = [np.linalg.norm(t.place - old[t.name]) for t in board.tasks if t.name in old]
            assert max(moved) < 30.0
    assert np.mean(lost) < 0.01
    assert max(lost) <= 0.5


def test_a_target_that_appears_gets_a_new_name_and_one_that_is_gone_gives_its_name_to_nobody():
    board = TaskBoard().renewed(RULES, unexplored(), clusters([(20, 20), (80, 80)]))
    names = [task.name for task in board.tasks if task.kind == "refine"]
    one = board.renewed(RULES, unexplored(), clusters([(80, 81)]))
    assert [task.name for task in one.tasks if task.kind == "refine"] == [names[1]]
    two = one.renewed(RULES, unexplored(), clusters([(20, 20), (80, 81)]))
    assert [task.name for task in two.tasks if task.kind == "refine"] == ["refine-2", names[1]]


def test_what_is_explored_is_no_task_and_what_is_not_finite_is_left_out():
    explored = dataclasses.replace(unexplored(), values=np.full((21, 21), 0.01))
    assert TaskBoard().renewed(RULES, explored, Intensity.empty(2)).tasks == ()
    bad = clusters([(20, 20), (np.nan, 3), (50, 50)], [1.0, 1.0, np.inf])
    damaged = explored.values.copy()
    damaged[3, 3] = np.nan
    requests = (
        Request("a", np.array([np.inf, 0.0])),
        Request("b", np.zeros(3)),
        Request("c", np.zeros(2), robots=0),
        Request("d#1", np.zeros(2)),
    )
    board = TaskBoard().renewed(RULES, dataclasses.replace(explored, values=damaged), bad, requests)
    assert [task.name for task in board.tasks] == ["refine-0"]


def test_a_three_dimensional_area_has_tasks_too():
    exploration = Exploration(np.ones((6, 6, 6)), np.zeros(3), np.full(3, 50.0))
    board = TaskBoard().renewed(RULES, exploration, Intensity.empty(3))
    assert len(board.tasks) == 6
    assert all(task.place.shape == (3,) for task in board.tasks)
