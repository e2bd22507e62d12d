"""Pruning, merging and the cap."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.gaussian.components import Components, first_indefinite
from estimator.gaussian.reduction import grouped, reduced, together


def mixture(k: int, seed: int, n: int = 2) -> Components:
    rng = np.random.default_rng(seed)
    root = rng.normal(0.0, 0.7, (k, n, n))
    covariances = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(n)
    return Components(rng.uniform(0.01, 1.0, k), rng.uniform(-6.0, 6.0, (k, n)), covariances)


def vo_and_ma(c: Components, sigmas: float, mutual: bool) -> Any:
    """Table II of the paper, word for word, with numpy."""
    left, groups, count = set(range(c.count)), np.full(c.count, -1), 0
    while left:
        leader = max(left, key=lambda i: (c.weights[i], -i))
        for i in sorted(left):
            step = c.means[i] - c.means[leader]
            near = step @ np.linalg.solve(c.covariances[i], step) <= sigmas**2
            if mutual:
                near = near and step @ np.linalg.solve(c.covariances[leader], step) <= sigmas**2
            if near or i == leader:
                groups[i] = count
        left -= set(np.flatnonzero(groups == count).tolist())
        count += 1
    return groups, count


@pytest.mark.parametrize("mutual", [False, True])
@pytest.mark.parametrize("n", [2, 3, 6])
@given(seed=st.integers(0, 2**32 - 1), k=st.integers(0, 60), sigmas=st.floats(0.0, 5.0))
@settings(max_examples=15, deadline=None)
def test_merging_is_table_2_of_vo_and_ma(n: int, mutual: bool, seed: int, k: int, sigmas: float) -> None:
    c = mixture(k, seed, n)
    groups, count = grouped(c, sigmas, mutual)
    expected, expected_count = vo_and_ma(c, sigmas, mutual)
    assert count == expected_count
    assert np.array_equal(groups, expected)


@given(seed=st.integers(0, 2**32 - 1), sigmas=st.floats(0.0, 10.0))
@settings(max_examples=25, deadline=None)
def test_merging_keeps_mass_mean_and_covariance_of_the_whole(seed: int, sigmas: float) -> None:
    c = mixture(40, seed)
    groups, count = grouped(c, sigmas)
    merged = together(c, groups, count)

    def moments(c: Components) -> Any:
        mean = c.weights @ c.means
        second = c.covariances + c.means[:, :, None] * c.means[:, None, :]
        return c.weights.sum(), mean, np.einsum("k,kij->ij", c.weights, second)

    for ours, whole in zip(moments(merged), moments(c), strict=True):
        assert np.allclose(ours, whole)
    assert first_indefinite(merged.covariances) == -1


def test_a_component_alone_stays_as_it_is_to_the_last_bit() -> None:
    c = mixture(5, 0)
    c = Components(c.weights, c.means * 1000.0, c.covariances)
    after = reduced(c, prune=0.0, merge_sigmas=3.0, most=5)
    order = np.argsort(-c.weights)
    assert np.array_equal(after.means, c.means[order])
    assert np.array_equal(after.covariances, c.covariances[order])


def test_light_components_go_and_the_heaviest_stay() -> None:
    c = mixture(50, 1)
    after = reduced(c, prune=0.2, merge_sigmas=0.0, most=7)
    assert np.array_equal(after.weights, np.sort(c.weights)[::-1][:7])
    assert reduced(c, prune=2.0, merge_sigmas=1.0, most=7).count == 0


def test_a_wide_component_beside_a_narrow_one_merges_only_if_asked_one_sided() -> None:
    c = Components(
        np.array([1.0, 0.1]),
        np.array([[0.0, 0.0], [0.16, 0.0]]),
        np.stack([1e-4 * np.eye(2), 0.02 * np.eye(2)]),
    )
    assert grouped(c, 2.0, mutual=False)[1] == 1
    assert grouped(c, 2.0, mutual=True)[1] == 2


def test_a_covariance_that_is_none_is_named() -> None:
    c = mixture(3, 2)
    c.covariances[1] = -np.eye(2)
    with pytest.raises(ValueError, match="covariances: number 1"):
        grouped(c, 1.0)
