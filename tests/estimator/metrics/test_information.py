"""Entropy of the intensity and the termination criterion, Dames & Kumar (25)-(28)."""

from itertools import product
from math import exp, factorial, log, prod

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.arrays import FloatArray
from estimator.metrics.information import entropy, excess_entropy, is_settled


def summed_entropy(weights: FloatArray, most: int) -> float:
    """H of a Poisson set on cells by its definition: -sum over sets of p log f, f the set density (6).

    A set of n targets has the density f = n! p(n) prod v = e^-lambda prod w, and is met in 1 / n! of the
    ordered tuples of cells.
    """
    mass, total = float(weights.sum()), 0.0
    for n in range(most + 1):
        for cells in product(range(weights.size), repeat=n):
            density = exp(-mass) * prod(float(weights[i]) for i in cells)
            total -= density * log(density) / factorial(n) if density > 0 else 0.0
    return total


@pytest.mark.parametrize("weights", [[0.5], [0.2, 0.3], [0.4, 0.1, 0.3]])
def test_entropy_is_that_of_the_poisson_set_summed_over_all_sets(weights: list[float]) -> None:
    w = np.array(weights)
    assert entropy(w) == pytest.approx(summed_entropy(w, 9), rel=1e-5)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(1e-6, 5.0), min_size=1, max_size=30))
def test_the_two_forms_of_the_criterion_are_one(weights: list[float]) -> None:
    w = np.array(weights)
    mass = w.sum()
    share = w / mass
    assert excess_entropy(w) == pytest.approx(-np.sum(share * np.log(share)) - np.log(mass), abs=1e-9)  # (27)
    assert entropy(w) == pytest.approx(mass * (1.0 + excess_entropy(w)), abs=1e-9)  # (26)


@pytest.mark.parametrize("count", [1, 7, 100])
def test_targets_known_exactly_have_no_excess_and_as_much_entropy_as_their_number(count: int) -> None:
    assert excess_entropy(np.ones(count)) == pytest.approx(0.0, abs=1e-12)
    assert entropy(np.ones(count)) == pytest.approx(count)


def test_excess_falls_as_the_mass_gathers() -> None:
    spread = [excess_entropy(np.full(n, 1.0 / n)) for n in (64, 16, 4, 1)]
    assert spread == pytest.approx([log(64), log(16), log(4), 0.0], abs=1e-12)


def test_entropy_of_a_density_does_not_depend_on_the_cells() -> None:
    coarse, fine = entropy(np.full(10, 0.3), 2.0), entropy(np.full(1000, 0.003), 0.02)
    assert fine == pytest.approx(coarse)
    assert coarse == pytest.approx(3.0 - 3.0 * log(0.15))  # v is 0.15 everywhere, on 20


def test_empty_places_do_not_count() -> None:
    assert entropy(np.array([0.5, 0.0, 0.0])) == entropy(np.array([0.5]))


def test_a_search_is_settled_when_each_target_lies_in_a_cell() -> None:
    rng = np.random.default_rng(0)
    targets = np.array([[2.5, 7.5, 12.5], [3.5, 8.5, 1.5]])
    narrow = np.repeat(targets, 50, axis=1) + 0.05 * rng.standard_normal((2, 150))
    wide = np.repeat(targets, 50, axis=1) + 1.5 * rng.standard_normal((2, 150))
    assert is_settled(np.append(narrow, [[0.0], [0.0]], axis=1), np.full(151, 0.02), 1.0, 0.15)
    assert not is_settled(wide, np.full(150, 0.02), 1.0, 0.15)
    assert is_settled(wide, np.full(150, 0.02), 100.0, 0.15)


def test_nothing_at_all_is_no_estimate() -> None:
    assert entropy(np.zeros(0)) == 0.0
    assert excess_entropy(np.zeros(3)) == np.inf
    assert not is_settled(np.zeros((2, 0)), np.zeros(0), 1.0, 0.05)


@pytest.mark.parametrize("weights", [[-1.0], [np.nan], [np.inf], [[1.0]]])
def test_bad_weights_are_refused_by_name(weights: list[float]) -> None:
    for function in (entropy, excess_entropy):
        with pytest.raises(ValueError, match="weights"):
            function(np.array(weights))


def test_bad_cells_and_limits_are_refused_by_name() -> None:
    with pytest.raises(ValueError, match="volumes"):
        entropy(np.ones(2), 0.0)
    with pytest.raises(ValueError, match="side"):
        is_settled(np.zeros((2, 1)), np.ones(1), 0.0, 0.1)
    with pytest.raises(ValueError, match="epsilon"):
        is_settled(np.zeros((2, 1)), np.ones(1), 1.0, np.nan)
