"""Fisher information, A-optimality, the tree, and value iteration against things outside them."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from estimator.filter import Area
from estimator.sensors.bearing_only import BearingOnly
from estimator.sensors.range_bearing import RangeBearing
from planner.irrt.fisher import a_optimality, accumulate, information
from planner.irrt.irrt import Irrt
from planner.irrt.kinematics import FREE, ON_THE_SPOT, identified
from planner.irrt.value_iteration import neighbours, values
from planner.plan import PlannerSetup
from tests.planner import contract


def _range_bearing(d):
    config = RangeBearing.Config(
        period_s=1.0,
        range_sigma_m=0.7,
        bearing_sigma_deg=3.0,
        elevation_sigma_deg=2.0 if d == 3 else None,
        reach_m=[9.0] * d,
    )
    return RangeBearing.of(config, Area(np.zeros(d), np.full(d, 40.0)))


def _bearing(d):
    return BearingOnly.of(BearingOnly.Config(period_s=1.0), Area(np.zeros(2), np.full(2, 40.0)))


def _wrapped(z, angular):
    return np.where(angular, np.angle(np.exp(1j * z)), z)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("make", "d"), [(_range_bearing, 2), (_range_bearing, 3), (_bearing, 2)])
def test_information_is_the_hessian_of_the_expected_log_likelihood(make, d, seed):
    """E log g(z | x') over z drawn at x has the Hessian -H' R^-1 H at x' = x (the mean of z suffices)."""
    rng = np.random.default_rng(seed)
    sensor = make(d)
    pose = np.array([*rng.uniform(5, 15, 3), rng.uniform(-3, 3)])
    target = rng.uniform(18, 30, (d, 1))
    weight = np.linalg.inv(sensor.noise)
    mean = sensor.measure(target, pose)[0]

    def expected(offset):  # up to what does not depend on x'
        off = _wrapped(sensor.measure(target + offset[:, None], pose)[0] - mean, sensor.angular)
        return -0.5 * off @ weight @ off

    h = 1e-3
    hessian = np.empty((d, d))
    for i, j in itertools.product(range(d), repeat=2):
        a, b = h * np.eye(d)[i], h * np.eye(d)[j]
        corners = expected(a + b) - expected(a - b) - expected(b - a) + expected(-a - b)
        hessian[i, j] = corners / (4 * h * h)
    detection = sensor.detection(target, pose[None])[0, 0]
    found = information(sensor, pose[None], target)[0, 0]
    np.testing.assert_allclose(found, -detection * hessian, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("d", [2, 3])
def test_a_optimality_is_the_trace_of_the_inverse(d, seed):
    root = np.random.default_rng(seed).standard_normal((d, d))
    matrix = root @ root.T + 0.1 * np.eye(d)
    assert a_optimality(matrix) == pytest.approx(np.trace(np.linalg.inv(matrix)), rel=1e-9)


def _planned(**config):
    setup = contract.team("ground_2d")
    planner = Irrt(Irrt.Config(nodes=300, **config), setup)
    problem = contract.ordinary(setup)
    return setup, planner, problem, planner.plan(problem)


def test_the_information_of_every_node_is_that_of_the_looks_on_its_path():
    setup, planner, problem, _ = _planned(explore=0.0)
    tree = planner._memories["a"].tree
    means = problem.intensity.means
    for node in (1, tree.count // 2, tree.count - 1):
        looks = np.vstack([tree.looks[n] for n in tree.path(node)])
        gained = tree.edges.each * information(setup.sensors["a"], looks, means).sum(axis=0)
        np.testing.assert_allclose(tree.fisher[node] - tree.fisher[0], gained, rtol=1e-6, atol=1e-9)
        traces = [np.trace(np.linalg.inv(j)) for j in tree.fisher[node]]
        assert tree.cost[node] == pytest.approx(np.mean(traces), rel=1e-9)


def test_the_tree_is_kept_and_valued_anew():
    setup, planner, problem, plan = _planned()
    before = planner._memories["a"].tree
    node = before.path(before.count - 1)[0]
    moved = before.moved(before.poses[node], 0.1, 0.1)
    assert moved is not None
    assert 1 <= moved.count <= before.count
    assert moved.times[0] == 0.0
    for n in range(1, moved.count):
        assert moved.times[n] == pytest.approx(moved.times[moved.parents[n]] + before.edges.duration)
    assert before.moved(np.array([1e3, 1e3, 0.0, 0.0]), 1.0, 1.0) is None
    way = plan.trajectory
    following = dataclasses.replace(problem, state=way.end_state, start_time=way.end_time, others=())
    again = planner.plan(following)
    contract.check(again, following, setup)


def test_another_seed_grows_another_tree_and_the_same_seed_the_same():
    _, first, _, one = _planned()
    _, second, _, two = _planned()
    contract.same(one, two)
    assert np.array_equal(first._memories["a"].tree.poses, second._memories["a"].tree.poses)


def test_the_kinds_of_vehicles_are_told_apart():
    for name, mode in (("drones_2d", FREE), ("ground_2d", ON_THE_SPOT)):
        setup = contract.team(name)
        found = identified(setup.vehicles["a"], contract.state(setup, "a", 20, 20, 5), 20.0)
        assert found.mode == mode
        assert found.speed == pytest.approx(5.0 if mode == FREE else 3.0, rel=0.1)


def test_a_target_to_learn_of_is_approached_and_looked_at():
    setup = contract.team("ground_2d", "a")
    problem = dataclasses.replace(contract.ordinary(setup), others=())
    planner = Irrt(Irrt.Config(nodes=600, explore=0.0), setup)
    first = planner.plan(problem)
    assert first.terms["information"] < first.terms["information_here"]


class Wall:
    """A wall at x = 20 with a gap above y = 30."""

    def clear(self, points):
        return np.abs(points[0] - 20.0) > 1.0

    def segments_clear(self, starts, ends):
        share = np.linspace(0, 1, 41)[:, None]
        x = starts[0] + share * (ends[0] - starts[0])
        y = starts[1] + share * (ends[1] - starts[1])
        return ~((np.abs(x - 20.0) < 1.0) & (y < 30.0)).any(axis=0)

    def path(self, start, goal):
        return None

    def distances(self, goal, points, over=None, within=np.inf):
        return np.full(points.shape[1], np.inf)


def test_no_edge_of_the_tree_and_no_plan_goes_through_a_wall():
    open_setup = contract.team("ground_2d", "a")
    setup = PlannerSetup(open_setup.vehicles, open_setup.sensors, open_setup.area, Wall())
    problem = dataclasses.replace(contract.ordinary(setup), others=())
    planner = Irrt(Irrt.Config(nodes=500), setup)
    plan = planner.plan(problem)
    tree = planner._memories["a"].tree
    nodes = np.arange(1, tree.count)
    before = np.concatenate([tree.poses[tree.parents[nodes], None], tree.looks[nodes, :-1]], axis=1)
    starts = before.reshape(-1, 4)[:, :2].T
    ends = tree.looks[nodes].reshape(-1, 4)[:, :2].T
    assert Wall().segments_clear(starts, ends).all()
    if plan.trajectory is not None:
        places = plan.trajectory.poses[:, :2].T
        assert Wall().segments_clear(places[:, :-1], places[:, 1:]).all()


@pytest.mark.parametrize("seed", range(3))
def test_value_iteration_gives_the_shortest_ways(seed):
    rng = np.random.default_rng(seed)
    shape = (7, 6)
    centres = np.stack(np.meshgrid(np.arange(7.0), np.arange(6.0), indexing="ij")).reshape(2, -1)
    moves = neighbours(shape, centres, None)
    moves[rng.random(moves.shape) < 0.5] = -1
    lengths = np.linalg.norm(centres[:, moves] - centres[:, :, None], axis=0)
    rows, columns = np.nonzero(moves >= 0)
    graph = csr_array((lengths[rows, columns], (rows, moves[rows, columns])), shape=(42, 42))
    expected = dijkstra(graph.T, indices=11)
    np.testing.assert_allclose(values(moves, lengths, 11, 42), expected)


@pytest.mark.parametrize("looks", [3, 4, 7, 12])
@pytest.mark.parametrize("metres", [2.0, 6.0])
def test_looks_from_all_around_leave_what_the_closed_form_of_11_to_13_says(looks, metres):
    """m looks from equally spaced directions at r: J = m p_D / 2 (1/s_r^2 + 1/(r s_b)^2) I (or no s_r)."""
    target, bearing = np.array([[20.0], [20.0]]), math.radians(3.0)
    angles = 2 * np.pi * np.arange(looks) / looks
    poses = np.zeros((looks, 4))
    poses[:, :2] = target.T + metres * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    poses[:, 3] = angles + np.pi  # towards it
    prior = np.diag([9.0, 9.0])
    for sensor, along in ((_range_bearing(2), 1 / 0.7**2), (_bearing(2), 0.0)):
        seen = sensor.detection(target, poses)[:, 0]
        assert seen == pytest.approx(seen[0])
        across = bearing if along else float(np.sqrt(sensor.noise[0, 0]))
        each = 0.5 * looks * seen[0] * (along + 1 / (metres * across) ** 2)
        total = information(sensor, poses, target).sum(axis=0)[0]
        np.testing.assert_allclose(total, each * np.eye(2), rtol=1e-6, atol=1e-9 * each)
        assert a_optimality(np.linalg.inv(prior) + total) == pytest.approx(2 / (1 / 9 + each), rel=1e-6)


def test_the_cost_of_a_tree_is_the_weighted_sum_of_traces_along_each_path():
    """(11): information adds up from the root; (13): sum of w tr J^-1, by numpy on the paths written out."""
    rng = np.random.default_rng(3)
    parents = np.array([-1, 0, 0, 1, 3, 2])
    gains = rng.normal(size=(5, 2, 3, 2, 2))
    gains = gains @ gains.swapaxes(-1, -2)
    weights = np.array([0.5, 0.3, 0.2])
    fisher, cost = np.zeros((6, 3, 2, 2)), np.zeros(6)
    fisher[0] = np.eye(2) / np.array([4.0, 9.0, 25.0])[:, None, None]
    accumulate(parents, gains, weights, 1, 6, fisher, cost)
    for node in range(1, 6):
        total, at = fisher[0].copy(), node
        while at > 0:
            total += gains[at - 1].sum(axis=0)
            at = parents[at]
        expected = sum(w * np.trace(np.linalg.inv(j)) for w, j in zip(weights, total, strict=True))
        assert cost[node] == pytest.approx(expected, rel=1e-9)
