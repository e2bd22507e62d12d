"""OSPA and OSPA(2), against the definition with every permutation, hand computation and Stone Soup."""

from datetime import datetime
from itertools import permutations

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.metrics.ospa import ospa, ospa2

WHEN = datetime(2024, 1, 1)


def by_definition(distances: FloatArray, c: float, p: float) -> float:
    """OSPA of sets whose elements have these distances (n, k), over all permutations."""
    if distances.shape[0] > distances.shape[1]:
        distances = distances.T
    m, n = distances.shape
    if n == 0:
        return 0.0
    best = min(
        sum(min(distances[i, j], c) ** p for i, j in enumerate(order)) for order in permutations(range(n), m)
    )
    return float(((best + c**p * (n - m)) / n) ** (1 / p))


def tracks_by_definition(x: FloatArray, y: FloatArray, c: float, q: float) -> float:
    """The base distance of two tracks (d, t), instant by instant."""
    errors = []
    for a, b in zip(x.T, y.T, strict=True):
        if np.isnan(a[0]) and np.isnan(b[0]):
            continue
        both = not np.isnan(a[0]) and not np.isnan(b[0])
        errors.append(min(np.linalg.norm(a - b), c) ** q if both else c**q)
    return float((sum(errors) / len(errors)) ** (1 / q)) if errors else 0.0


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("n", "k"), [(4, 4), (5, 3), (2, 5), (0, 2), (0, 0)])
@pytest.mark.parametrize("p", [1.0, 2.0, 3.0])
def test_ospa_is_its_definition(seed: int, n: int, k: int, p: float) -> None:
    rng = np.random.default_rng(seed)
    truth, estimates = rng.uniform(0, 6, (3, n)), rng.uniform(0, 6, (3, k))
    apart = np.linalg.norm(truth[:, :, None] - estimates[:, None], axis=0)
    ours = ospa(truth, estimates, c=2.5, p=p)
    assert ours.total == pytest.approx(by_definition(apart, 2.5, p))
    assert ours.total**p == pytest.approx(ours.localisation**p + ours.cardinality**p)


@pytest.mark.parametrize("seed", range(5))
def test_ospa_agrees_with_stone_soup(seed: int) -> None:
    from stonesoup.metricgenerator.ospametric import OSPAMetric
    from stonesoup.types.state import State

    rng = np.random.default_rng(seed)
    truth, estimates = rng.uniform(0, 20, (2, 7)), rng.uniform(0, 20, (2, 5))
    theirs = OSPAMetric(c=6.0, p=2.0).compute_OSPA_distance(
        [State(x[:, None], timestamp=WHEN) for x in estimates.T],
        [State(x[:, None], timestamp=WHEN) for x in truth.T],
    )
    assert ospa(truth, estimates, c=6.0, p=2.0).total == pytest.approx(float(theirs.value), rel=1e-12)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(("p", "q"), [(1.0, 1.0), (2.0, 1.0), (2.0, 2.0)])
def test_ospa2_is_its_definition(seed: int, p: float, q: float) -> None:
    rng = np.random.default_rng(seed)
    truth, estimates = rng.uniform(0, 4, (4, 2, 6)), rng.uniform(0, 4, (3, 2, 6))
    for tracks in (truth, estimates):
        tracks.transpose(0, 2, 1)[rng.random((len(tracks), 6)) < 0.3] = np.nan
    bases = np.array([[tracks_by_definition(x, y, 2.0, q) for y in estimates] for x in truth])
    assert ospa2(truth, estimates, c=2.0, p=p, q=q).total == pytest.approx(by_definition(bases, 2.0, p))


def test_ospa2_of_a_case_computed_by_hand() -> None:
    """One of two tracks is estimated 0.5 m off for half of its life, the other is not."""
    truth = np.zeros((2, 1, 4))
    truth[1] = 50.0
    estimate = np.full((1, 1, 4), 0.5)
    estimate[:, :, 2:] = np.nan
    score = ospa2(truth, estimate, c=2.0)
    assert score.total == pytest.approx(((0.5 + 0.5 + 2 + 2) / 4 + 2.0) / 2)
    assert score.cardinality == pytest.approx(2.0 / 2)


def test_labels_that_swap_cost_in_ospa2_and_not_in_ospa() -> None:
    truth = np.zeros((2, 1, 10))
    truth[1] = 5.0
    swapped = truth.copy()
    swapped[:, :, 5:] = truth[::-1, :, 5:]
    assert ospa2(truth, swapped, c=1.0).total == pytest.approx(0.5)
    assert ospa2(truth, truth[::-1], c=1.0).total == 0.0
    assert all(ospa(truth[:, :, t].T, swapped[:, :, t].T, c=1.0).total == 0.0 for t in range(10))


def test_a_track_that_does_not_exist_in_the_window_is_no_element() -> None:
    truth = np.zeros((1, 2, 3))
    ghosts = np.concatenate([truth, np.full((2, 2, 3), np.nan)])
    assert ospa2(truth, ghosts, c=1.0).total == 0.0
    assert ospa2(ghosts[1:], ghosts[1:], c=1.0).total == 0.0
    assert ospa2(ghosts[1:], truth, c=1.0).total == 1.0


def test_bad_input_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="c, p"):
        ospa(np.zeros((2, 1)), np.zeros((2, 1)), c=1.0, p=0.5)
    with pytest.raises(ValueError, match="finite"):
        ospa(np.zeros((2, 1)), np.full((2, 1), np.inf), c=1.0)
    half = np.zeros((1, 2, 3))
    half[0, 1, 1] = np.nan
    with pytest.raises(ValueError, match="estimates"):
        ospa2(np.zeros((1, 2, 3)), half, c=1.0)
    with pytest.raises(ValueError, match="truth"):
        ospa2(np.zeros((2, 3)), half, c=1.0)
    with pytest.raises(ValueError, match="estimates"):
        ospa2(np.zeros((1, 2, 3)), np.zeros((1, 2, 4)), c=1.0)
