"""The partial assignment, against scipy and against every partial assignment there is."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from estimator.metrics.assignment import assigned, cut_off_gains


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 5), st.integers(0, 5), st.integers(0, 2**32 - 1))
def test_no_other_partial_assignment_gains_more(n: int, m: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    gains = np.round(rng.uniform(-3.0, 5.0, (n, m)))  # rounded: ties are common
    rows, columns = assigned(gains)
    assert len(set(rows)) == len(rows)
    assert len(set(columns)) == len(columns)
    assert (gains[rows, columns] > 0).all()
    wide = np.zeros((n, m + n))  # a column of its own for each row that stays alone
    wide[:, :m] = gains
    best = max(
        (sum(wide[i, j] for i, j in enumerate(order)) for order in permutations(range(m + n), n)), default=0.0
    )
    assert gains[rows, columns].sum() == pytest.approx(best)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize(("n", "m"), [(100, 100), (60, 90), (90, 60), (1, 40), (40, 1)])
@pytest.mark.parametrize("c", [0.1, 0.3, 5.0])
def test_large_assignments_gain_what_scipys_do(seed: int, n: int, m: int, c: float) -> None:
    gains = cut_off_gains(np.random.default_rng(seed).uniform(0.0, 1.0, (n, m)), c, 2.0)
    rows, columns = assigned(gains)
    theirs = linear_sum_assignment(-gains)
    assert len(set(columns)) == len(columns)
    assert gains[rows, columns].sum() == pytest.approx(gains[theirs].sum(), rel=1e-12)


def test_equal_gains_everywhere_assign_everyone() -> None:
    rows, columns = assigned(np.ones((50, 70)))
    assert rows.tolist() == list(range(50))
    assert len(set(columns)) == 50
