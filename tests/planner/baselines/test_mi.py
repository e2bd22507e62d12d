import dataclasses
from itertools import product

import numpy as np
import pytest
from scipy.stats import poisson

from planner.baselines.mi import Mi, information
from tests.planner import contract


def brute(detection, masses, most=40):
    """H(e) - H(e | X) summed over all numbers of targets at each centre, in nat."""

    def h(p):
        return sum(-q * np.log(q) for q in (p, 1 - p) if q > 0)

    nothing, given = 0.0, 0.0
    for counts in product(range(most), repeat=len(masses)):
        chance = np.prod(poisson.pmf(counts, masses))
        p = np.prod((1 - np.array(detection)) ** counts)
        nothing += chance * p
        given += chance * h(p)
    return h(nothing) - given


@pytest.mark.parametrize(
    ("detection", "masses"),
    [([0.5], [1.0]), ([0.98, 0.2], [1.0, 0.5]), ([1.0], [0.7]), ([1e-3], [3.0]), ([0.0, 0.9], [2.0, 1.5])],
)
def test_information_is_that_of_all_target_sets_summed_up(detection, masses) -> None:
    found = information(np.array([detection]), np.array(masses))[0]
    assert found == pytest.approx(brute(detection, masses), abs=2e-4)


def test_of_nothing_nothing_is_learnt() -> None:
    assert information(np.zeros((3, 2)), np.ones(2)) == pytest.approx(0.0, abs=1e-12)
    assert (information(np.full((1, 1), 0.9), np.array([1e-9])) < 1e-6).all()


def test_it_goes_to_where_clusters_are_and_not_to_the_unexplored() -> None:
    setup = contract.team("drones_2d")
    problem = contract.ordinary(setup)
    place = np.array([[52.0], [52.0]])
    known = dataclasses.replace(
        problem.intensity, means=place, masses=np.ones(1), covariances=np.eye(2)[None]
    )
    alone = dataclasses.replace(problem, others=(), clusters=place, intensity=known)
    plan = Mi(Mi.Config(), setup).plan(alone)
    assert np.linalg.norm(plan.trajectory.waypoint[:2] - place[:, 0]) < 12.0
    assert plan.objective > 0


def test_without_a_cluster_it_goes_anywhere_by_its_seed() -> None:
    setup = contract.team("drones_2d")
    problem = contract.AWKWARD["no clusters"](contract.ordinary(setup))
    mi = Mi(Mi.Config(), setup)
    goals = {tuple(mi.plan(dataclasses.replace(problem, seed=s)).trajectory.waypoint) for s in range(8)}
    assert len(goals) > 2
