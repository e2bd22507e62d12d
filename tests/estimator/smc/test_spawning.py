"""Spawning, and what a removed cluster takes along."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from estimator.filter import Area
from estimator.smc.smc_phd import SmcPhd, SmcPhdState

AREA = Area(np.zeros(3), np.full(3, 100.0))
CENTRES = np.array([[20.0, 50.0, 80.0], [20.0, 60.0, 30.0], [50.0, 50.0, 50.0]])
MASSES = np.array([1.0, 0.4, 2.9])
EACH = 400


def clouds(filter: SmcPhd, stray: float = 0.05) -> SmcPhdState:
    """Clusters of MASSES at CENTRES with 0.5 m on every axis, and one stray particle far from them."""
    rng = np.random.default_rng(3)
    centres, masses = np.repeat(CENTRES, EACH, axis=1), np.repeat(MASSES / EACH, EACH)
    positions = np.concatenate(
        [centres + 0.5 * rng.standard_normal(centres.shape), [[50.0], [5.0], [5.0]]], axis=1
    )
    state = replace(
        filter.init(AREA, rng),
        states=positions,
        weights=np.append(masses, stray),
        labels=np.full(positions.shape[1], -1),
    )
    state, clusters = filter.clusters(state, rng)
    assert clusters.masses.size == 3
    return state


def filter_with(**changes: Any) -> SmcPhd:
    return SmcPhd(SmcPhd.Config(**{"expected_targets": 0.0, "cluster_cutoff_m": 4.0, **changes}))


def masses(state: SmcPhdState) -> list[float]:
    """Of the three clouds as they stand in CENTRES, and of the stray."""
    return [float(part.sum()) for part in np.split(state.weights, [EACH, 2 * EACH, 3 * EACH])]


def test_a_detected_target_spawns_at_its_rate_up_to_the_limit() -> None:
    filter = filter_with(spawning=0.4, spawning_to=3.0)
    state = clouds(filter)
    later = filter.predict(state, 0.5, np.random.default_rng(0))
    assert masses(later) == pytest.approx([np.exp(0.2), 0.4, 3.0, 0.05])
    for _ in range(100):
        later = filter.predict(later, 1.0, np.random.default_rng(0))
    assert masses(later) == pytest.approx([3.0, 0.4, 3.0, 0.05])


def test_what_is_rather_nothing_spawns_nothing_and_strays_never_do() -> None:
    filter = filter_with(spawning=0.4, spawning_from=0.0, spawning_to=10.0)
    later = filter.predict(clouds(filter), 1.0, np.random.default_rng(0))
    assert masses(later)[1] == pytest.approx(0.4 * np.exp(0.4))
    assert masses(later)[3] == 0.05
    careful = filter_with(spawning=0.4, spawning_from=1.5, spawning_to=10.0)
    later = careful.predict(clouds(careful), 1.0, np.random.default_rng(0))
    assert masses(later) == pytest.approx([1.0, 0.4, 2.9 * np.exp(0.4), 0.05])


def test_a_mass_beyond_the_limit_is_left_as_it_is() -> None:
    filter = filter_with(spawning=0.4, spawning_to=2.0)
    assert masses(filter.predict(clouds(filter), 1.0, np.random.default_rng(0)))[2] == pytest.approx(2.9)


def test_spawning_in_two_steps_is_spawning_in_one() -> None:
    filter, rng = filter_with(spawning=0.3, survival=0.99), np.random.default_rng(0)
    state = clouds(filter)
    twice = filter.predict(filter.predict(state, 0.5, rng), 0.5, rng)
    assert masses(twice)[0] == pytest.approx(masses(filter.predict(state, 1.0, rng))[0])


def test_before_the_first_clusters_nothing_spawns() -> None:
    filter = filter_with(spawning=0.3)
    state = replace(clouds(filter), labels=np.full(3 * EACH + 1, -1), centres=np.zeros((3, 0)))
    later = filter.predict(state, 1.0, np.random.default_rng(0))
    assert np.array_equal(later.weights, state.weights)


@pytest.mark.parametrize(("sigmas", "left"), [(0.0, 4), (6.0, 2), (20.0, 1)])
def test_a_removed_cluster_takes_the_strays_of_its_tail(sigmas: float, left: int) -> None:
    """Strays at 4, 5 and 10 standard deviations of cluster 0's cloud, and one far away."""
    filter = filter_with(stray_sigmas=sigmas, jitter=0.0)
    state = clouds(filter)
    tail = CENTRES[:, [2]] + np.array([[2.0, 0.0, -5.0], [0.0, 2.5, 0.0], [0.0, 0.0, 0.0]])
    n = tail.shape[1]
    state = replace(
        state,
        states=np.concatenate([state.positions, tail], axis=1),
        weights=np.concatenate([state.weights, np.full(n, 1e-3)]),
        labels=np.concatenate([state.labels, np.full(n, -1)]),
    )
    after = filter.remove(state, np.array([0]))  # the heaviest: the third cloud
    assert np.count_nonzero(after.labels < 0) == left
    assert np.count_nonzero(after.labels >= 0) == 2 * EACH
