"""The corrector of several sensors at once, against the exact posterior and its own symmetries."""

from itertools import permutations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.arrays import FloatArray
from estimator.multisensor import jointly_corrected
from estimator.sensor import Look
from estimator.smc.correction import corrected
from tests.estimator.exact import Sighting, posterior_intensity
from tests.estimator.looks import dense_look


def some_looks(n: int, sizes: list[int], seed: int, sparse: float = 0.3) -> tuple[FloatArray, list[Any]]:
    """Prior weights (n,) and, of each sensor, p_D, g and c."""
    rng = np.random.default_rng(seed)
    looks = []
    for m in sizes:
        g = rng.gamma(1.0, 2.0, (m, n)) * (rng.random((m, n)) > sparse)
        looks.append((rng.uniform(0.2, 0.95, n), g, rng.uniform(0.05, 1.0, m)))
    return rng.uniform(0.02, 0.15, n), looks


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("sizes", [[1, 1], [2, 1], [2, 2], [1, 0, 2], [1, 1, 1]])
def test_the_posterior_is_the_exact_one(sizes: list[int], seed: int) -> None:
    prior, looks = some_looks(3, sizes, seed)
    exact = posterior_intensity(prior, [Sighting(*look) for look in looks], most=9)
    assert np.allclose(jointly_corrected(prior, [dense_look(*look) for look in looks]), exact, rtol=1e-6)


def test_the_iterated_corrector_is_not_the_exact_one() -> None:
    prior, looks = some_looks(3, [2, 1], 0)
    exact = posterior_intensity(prior, [Sighting(*look) for look in looks], most=9)
    w = prior
    for look in looks:
        w = corrected(w, dense_look(*look))
    assert np.abs(w / exact - 1.0).max() > 0.01


@given(seed=st.integers(0, 2**32 - 1), m=st.integers(0, 6))
@settings(max_examples=25, deadline=None)
def test_with_one_sensor_it_is_the_usual_corrector(seed: int, m: int) -> None:
    prior, looks = some_looks(20, [m], seed)
    look = dense_look(*looks[0])
    assert np.allclose(jointly_corrected(prior, [look]), corrected(prior, look), rtol=1e-12)


@pytest.mark.parametrize("most", [4, 12])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_any_order_of_the_sensors_gives_the_same_to_1e_9(most: int, seed: int) -> None:
    prior, looks = some_looks(40, [3, 2, 4, 2], seed, sparse=0.85)
    made = [dense_look(*look) for look in looks]
    first = jointly_corrected(prior, made, most)
    for order in permutations(range(4)):
        assert np.allclose(jointly_corrected(prior, [made[s] for s in order], most), first, rtol=1e-9, atol=0)


def test_sensors_that_look_at_different_points_are_correctors_for_themselves() -> None:
    prior, looks = some_looks(10, [2, 2], 3, sparse=0.0)
    (p1, g1, c1), (p2, g2, c2) = looks
    p1[5:], g1[:, 5:], p2[:5], g2[:, :5] = 0.0, 0.0, 0.0, 0.0
    one, two = dense_look(p1, g1, c1), dense_look(p2, g2, c2)
    assert np.allclose(
        jointly_corrected(prior, [one, two]), corrected(corrected(prior, one), two), rtol=1e-12
    )


def test_sets_that_the_model_holds_impossible_leave_no_nan() -> None:
    sure, nothing = np.ones(3), np.zeros(1)
    apart = [np.array([[2.0, 0.0, 0.0]]), np.array([[0.0, 3.0, 0.0]])]  # each certain to see every target
    looks = [dense_look(sure, g, nothing) for g in apart]
    after = jointly_corrected(np.full(3, 0.3), looks)
    assert np.array_equal(after, np.zeros(3))
    far = dense_look(np.full(3, 0.5), np.zeros((1, 3)), nothing)
    assert np.allclose(jointly_corrected(np.full(3, 0.3), [far, far]), 0.3 * 0.25)


def test_no_sensor_no_point_and_empty_sets_are_fine() -> None:
    prior, looks = some_looks(4, [0, 0], 1)
    made = [dense_look(*look) for look in looks]
    assert np.array_equal(jointly_corrected(prior, []), prior)
    missed = prior * (1 - looks[0][0]) * (1 - looks[1][0])
    assert np.allclose(jointly_corrected(prior, made), missed)
    none = Look(np.zeros(0), np.zeros(3, np.int64), np.zeros(0, np.int64), np.zeros(0), np.ones(2))
    assert jointly_corrected(np.zeros(0), [none]).size == 0
    with pytest.raises(ValueError, match="weights"):
        jointly_corrected(prior[:2], made)


def test_two_sensors_without_clutter_that_see_one_target_keep_one_target() -> None:
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, 500)
    g = [np.exp(-0.5 * ((x - 0.2) / 0.1) ** 2)[None] * 4.0 for _ in range(4)]
    looks = [dense_look(np.full(500, 0.9), one, np.zeros(1)) for one in g]
    after = jointly_corrected(np.full(500, 3.0 / 500), looks)
    assert after.sum() == pytest.approx(1.0, abs=0.08)
