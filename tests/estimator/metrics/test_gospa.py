"""GOSPA and matching, against hand computation and Stone Soup."""

from datetime import datetime
from itertools import permutations

import numpy as np
import pytest

from estimator.metrics.gospa import gospa, matched, rmse


def test_gospa_of_a_case_computed_by_hand() -> None:
    truth = np.array([[0.0, 10.0, 20.0], [0.0, 0.0, 0.0]])
    estimates = np.array([[0.0, 13.0, 90.0, 95.0], [1.0, 0.0, 0.0, 0.0]])
    score = gospa(truth, estimates, c=4.0, p=2.0)
    # 1^2 + 3^2, one of three missed, two of four false, each 4^2 / 2
    assert score.localisation == pytest.approx(np.sqrt(10.0))
    assert score.missed == pytest.approx(np.sqrt(8.0))
    assert score.false == pytest.approx(np.sqrt(16.0))
    assert score.total == pytest.approx(np.sqrt(34.0))
    assert score.pairs == ((0, 0), (1, 1))


@pytest.mark.parametrize(("n", "k"), [(0, 0), (0, 3), (2, 0)])
def test_gospa_of_empty_sets_counts_only_misses_and_false(n: int, k: int) -> None:
    score = gospa(np.zeros((2, n)), np.zeros((2, k)), c=3.0, p=2.0)
    assert score.total == pytest.approx(np.sqrt(4.5 * (n + k)))


@pytest.mark.parametrize("seed", range(8))
def test_gospa_is_the_minimum_over_all_assignments(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, estimates = rng.uniform(0, 10, (2, 4)), rng.uniform(0, 10, (2, 4))
    c, p = 3.0, 1.0 + seed % 3
    best = min(
        sum(min(np.linalg.norm(truth[:, i] - estimates[:, j]), c) ** p for i, j in enumerate(order))
        for order in permutations(range(4))
    )
    assert gospa(truth, estimates, c=c, p=p).total == pytest.approx(best ** (1 / p))


@pytest.mark.parametrize("seed", range(5))
def test_gospa_agrees_with_stone_soup(seed: int) -> None:
    from stonesoup.metricgenerator.ospametric import GOSPAMetric
    from stonesoup.types.state import State

    rng = np.random.default_rng(seed)
    truth, estimates = rng.uniform(0, 20, (2, 7)), rng.uniform(0, 20, (2, 5))
    when = datetime(2024, 1, 1)
    peer = GOSPAMetric(c=6.0, p=2.0)
    result, _ = peer.compute_gospa_metric(
        [State(x[:, None], timestamp=when) for x in estimates.T],
        [State(x[:, None], timestamp=when) for x in truth.T],
    )
    value = result.value if hasattr(result, "value") else result
    ours = gospa(truth, estimates, c=6.0, p=2.0)
    assert ours.total == pytest.approx(float(value["distance"]))
    assert ours.localisation**2 == pytest.approx(float(value["localisation"]))
    assert ours.missed**2 == pytest.approx(float(value["missed"]))
    assert ours.false**2 == pytest.approx(float(value["false"]))


def test_matching_prefers_more_pairs_over_closer_ones() -> None:
    truth, estimates = np.array([[0.0, 1.9], [0.0, 0.0]]), np.array([[1.0, -0.9], [0.0, 0.0]])
    assert matched(truth, estimates, 1.0001) == ((0, 1), (1, 0))
    assert rmse(truth, estimates, 1.0001) == pytest.approx(0.9)


def test_nothing_matches_beyond_the_distance() -> None:
    truth, estimates = np.zeros((2, 1)), np.full((2, 1), 5.0)
    assert matched(truth, estimates, 2.0) == ()
    assert rmse(truth, estimates, 2.0) is None


def test_bad_input_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="c, p"):
        gospa(np.zeros((2, 1)), np.zeros((2, 1)), c=0.0)
    with pytest.raises(ValueError, match="estimates"):
        gospa(np.zeros((2, 1)), np.zeros((3, 1)), c=1.0)
    with pytest.raises(ValueError, match="finite"):
        gospa(np.full((2, 1), np.nan), np.zeros((2, 1)), c=1.0)
