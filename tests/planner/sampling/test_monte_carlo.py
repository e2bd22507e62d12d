"""Planners `monte_carlo` and `greedy_paths`: what they are asked, and what they answer."""

import dataclasses
import math

import numpy as np
import pytest

from estimator.exploration import Exploration
from estimator.filter import Area
from planner.others import Others
from planner.plan import Intensity
from planner.sampling.grid import Grid, believed, unobserved
from planner.sampling.monte_carlo import GreedyPaths, MonteCarlo
from planner.sampling.sight import Surveyed, in_the_open
from tests.planner import contract

KINDS = [GreedyPaths, MonteCarlo]


class Wall:
    """Ground with a wall x = 30 that is open above y = 50, and a fence 1 m inside the area."""

    def clear(self, points):
        x, y = points[:2]
        inside = (points[:2] > 1).all(axis=0) & (points[:2] < 59).all(axis=0)
        return inside & ~((abs(x - 30) < 2) & (y < 50))

    def segments_clear(self, starts, ends):
        along = np.linspace(0, 1, 60)
        ok = [self.clear(starts + (ends - starts) * u) for u in along]
        return np.all(ok, axis=0)

    def path(self, start, goal):
        return (
            np.stack([start, goal], axis=1) if self.segments_clear(start[:, None], goal[:, None])[0] else None
        )

    def distances(self, goal, points, over=None, within=np.inf):
        return np.linalg.norm(points - goal[:, None], axis=0)


def planned(kind, problem, setup, **keys):
    plan = kind(kind.Config(**keys), setup).plan(problem)
    contract.check(plan, problem, setup)
    return plan


def alone(setup, **changes):
    return dataclasses.replace(contract.ordinary(setup), others=(), **changes)


def at(*place):
    return Intensity(np.array([place]).T, np.ones(1), np.zeros((2, 0)), np.zeros((0, 2, 2)), np.zeros(0))


@pytest.mark.parametrize("kind", KINDS)
def test_it_goes_where_the_only_target_is_believed(kind):
    setup = contract.team("drones_2d")
    problem = alone(setup, intensity=at(50.0, 45.0))
    plan = planned(kind, problem, setup, undetected=0.0, follow=1.0, steps=12)
    nearest = np.linalg.norm(plan.trajectory.poses[:, :2] - [50.0, 45.0], axis=1).min()
    assert nearest < 8.0
    assert plan.objective == pytest.approx(1.0, abs=0.25)


def test_another_robots_committed_looks_take_the_reward():
    setup = contract.team("drones_2d")
    problem = alone(setup, intensity=at(50.0, 45.0))
    stands = contract.standing("b", 50.0, 45.0, 20.0)
    shared = dataclasses.replace(problem, others=(stands,), separation=0.0)
    own = planned(MonteCarlo, problem, setup, undetected=0.0)
    left = planned(MonteCarlo, shared, setup, undetected=0.0)
    assert own.objective > 0.7
    assert left.trajectory is None or left.objective < 0.01 * own.objective


@pytest.mark.parametrize("seed", range(3))
def test_others_looks_leave_the_product_of_what_each_misses(seed):
    setup = contract.team("drones_2d")
    problem = contract.ordinary(setup, seed)
    grid = Grid.over(setup.area, 5.0, 10_000)
    values = believed(problem, grid, 1.0)
    others = Others(problem.others, problem)
    left = unobserved(values, others, grid, setup.sensors, problem.start_time + 20.0)
    slow = values.copy()
    for other in problem.others:
        poses = [q for t, q in zip(other.measure_times, other.measure_poses, strict=True) if t >= 5.0]
        arrival = float(other.times[-1])
        poses += [other.poses[-1]] * math.ceil(25.0 - arrival)
        for pose in poses:
            slow *= 1 - setup.sensors[other.robot].detection(grid.centres(), pose[None])[0]
    np.testing.assert_allclose(left, slow, atol=1e-12)


def test_all_that_is_believed_is_on_the_grid():
    setup = contract.team("drones_2d")
    problem = contract.ordinary(setup)
    e = Exploration(np.full((7, 7), 0.5), setup.area.low, setup.area.high)
    problem = dataclasses.replace(problem, exploration=e)
    grid = Grid.over(setup.area, 7.0, 10_000)
    assert believed(problem, grid, 4.0).sum() == pytest.approx(problem.intensity.weights.sum() + 2.0)
    nothing = np.zeros((2, 0))
    only = dataclasses.replace(problem.intensity, points=nothing, weights=np.zeros(0))
    clusters = dataclasses.replace(problem, intensity=only)
    assert believed(clusters, grid, 0.0).sum() == pytest.approx(problem.intensity.masses.sum())
    unheard = dataclasses.replace(problem, intensity=None)
    assert believed(unheard, grid, 0.0).sum() == problem.clusters.shape[1]


@pytest.mark.parametrize("side", [(60.0, 60.0), (33.0, 70.0)])
def test_the_stencil_sees_what_the_survey_of_every_cell_sees(side):
    setup = contract.team("drones_2d")
    grid = Grid.over(Area(np.zeros(2), np.array(side)), 5.0, 10_000)
    sensor = setup.sensors["a"]
    surveyed = Surveyed(sensor, grid, 0.0, 1.0, 1).rows(lambda: False)
    open_rows = in_the_open(sensor, grid, 0.0, 1.0, 1)

    def dense(rows):
        made = np.zeros((grid.cells, grid.cells))
        made[np.repeat(np.arange(grid.cells), np.diff(rows[0])), rows[1]] = rows[2]
        return made

    one, two = dense(surveyed), dense(open_rows)
    assert abs(one - two).max() < 0.3  # one asks for the middles of cells, the other for means over them
    np.testing.assert_allclose(one.sum(axis=1), two.sum(axis=1), rtol=0.2)


def test_a_survey_goes_on_where_the_time_was_over():
    setup = contract.team("drones_2d")
    grid = Grid.over(setup.area, 10.0, 10_000)
    survey = Surveyed(setup.sensors["a"], grid, 0.0, 1.0, 1)
    asked = iter([False, True, False, False, False])
    assert survey.rows(lambda: next(asked)) is None
    rows = survey.rows(lambda: next(asked))
    whole = Surveyed(setup.sensors["a"], grid, 0.0, 1.0, 1).rows(lambda: False)
    for part, same in zip(rows, whole, strict=True):
        np.testing.assert_array_equal(part, same)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_a_path_stays_on_open_ground_and_finds_its_way_around_a_wall(kind, seed):
    setup = dataclasses.replace(contract.team("drones_2d"), ground=Wall())
    problem = alone(setup, intensity=at(45.0, 10.0), seed=seed)
    plan = (
        planned(kind, problem, setup, undetected=0.0, follow=1.0, steps=40, paths=500)
        if (kind is MonteCarlo)
        else planned(kind, problem, setup, undetected=0.0, follow=1.0, steps=40)
    )
    assert plan.objective > 0.7
    route = np.vstack([plan.trajectory.poses[:1, :3], plan.trajectory.route])[:, :2].T
    assert Wall().segments_clear(route[:, :-1], route[:, 1:]).all()
    assert np.linalg.norm(plan.trajectory.poses[:, :2] - [45.0, 10.0], axis=1).min() < 9.0


def test_a_wall_all_around_leaves_no_step():
    class Nowhere(Wall):
        def clear(self, points):
            return np.zeros(points.shape[1], dtype=bool)

    setup = dataclasses.replace(contract.team("drones_2d"), ground=Nowhere())
    plan = planned(MonteCarlo, alone(setup), setup)
    assert plan.trajectory is None
    assert "open" in plan.reason or "may not be" in plan.reason


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_left_is_said_in_words(kind):
    setup = contract.team("drones_2d")
    plan = planned(kind, contract.AWKWARD["nothing left"](contract.ordinary(setup)), setup)
    assert plan.trajectory is None
    assert "nothing is left" in plan.reason


@pytest.mark.parametrize("kind", KINDS)
def test_no_time_is_said_in_words(kind):
    setup = contract.team("drones_2d")
    plan = planned(kind, alone(setup, deadline_s=0.0), setup)
    assert plan.trajectory is None
    assert "deadline" in plan.reason


def test_threads_do_not_change_a_plan():
    setup = contract.team("drones_2d")
    problem = contract.ordinary(setup)
    one, three = (planned(MonteCarlo, problem, setup, threads=n) for n in (1, 3))
    contract.same(one, three)


def test_another_seed_is_another_path():
    setup = contract.team("drones_2d")
    problem = alone(setup)
    plans = [
        planned(MonteCarlo, dataclasses.replace(problem, seed=s), setup, follow=1.0, paths=50) for s in (1, 2)
    ]
    assert plans[0].objective != plans[1].objective
