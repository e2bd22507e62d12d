"""Consensus: conserved sums, the limit, and information on circles."""

import numpy as np
import pytest

from estimator.arrays import BoolArray, FloatArray
from estimator.averaging.belief import Belief, Size, average
from estimator.averaging.consensus import consensus, metropolis, own_shares
from tests.estimator.averaging.scene import ALL, belief, moments


def links(kind: str, n: int) -> BoolArray:
    out = np.zeros((n, n), dtype=np.bool_)
    for i in range(n - 1):
        out[i, i + 1] = out[i + 1, i] = True
    if kind == "ring":
        out[0, n - 1] = out[n - 1, 0] = True
    if kind == "complete":
        out[:] = ~np.eye(n, dtype=np.bool_)
    return out


@pytest.mark.parametrize("kind", ["line", "ring", "complete"])
@pytest.mark.parametrize("n", [2, 5, 9])
def test_metropolis_weights_are_doubly_stochastic_and_come_to_the_mean(kind: str, n: int) -> None:
    weights = metropolis(links(kind, n))
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights, weights.T)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    x = np.random.default_rng(n).normal(size=n)
    np.testing.assert_allclose(np.linalg.matrix_power(weights, 500) @ x, x.mean(), atol=1e-9)


def test_metropolis_weights_of_a_line_of_three_by_hand() -> None:
    third = 1 / 3
    np.testing.assert_allclose(
        metropolis(links("line", 3)), [[2 * third, third, 0], [third, third, third], [0, third, 2 * third]]
    )
    np.testing.assert_allclose(own_shares(2, [1, 1]), [third, third, third])


def numerators(beliefs: list[Belief]) -> FloatArray:
    """Of each belief the sum over the team that consensus must not change: a v, at nodes and components."""
    total = np.zeros(0)
    for b in beliefs:
        nodes = b.undetected.nodes()
        at_nodes = b.attention.at(nodes) * b.undetected.values.ravel()
        parts = [at_nodes, b.attention.values.ravel(), [np.sum(b.attention.at(b.positions()) * b.weights)]]
        total = total + np.concatenate(parts) if total.size else np.concatenate(parts)
    return total


@pytest.mark.parametrize("kind", ["line", "ring", "complete"])
@pytest.mark.parametrize("points", [False, True])
def test_what_the_team_knows_is_neither_lost_nor_multiplied(kind: str, points: bool) -> None:
    beliefs = [belief(i, points=points) for i in range(4)]
    later = consensus(beliefs, metropolis(links(kind, 4)), 3, Size(0.0, 1e-9, 10**6, 10**6))
    np.testing.assert_allclose(numerators(later), numerators(beliefs), rtol=1e-9)


@pytest.mark.parametrize("kind", ["line", "ring", "complete"])
def test_all_come_to_the_same_belief_which_is_the_average_of_all(kind: str) -> None:
    beliefs = [belief(i) for i in range(4)]
    everybody = average(beliefs, np.full(4, 0.25), ALL)
    for one in consensus(beliefs, metropolis(links(kind, 4)), 60, Size(0.0, 1e-9, 10**6)):
        np.testing.assert_allclose(one.undetected.values, everybody.undetected.values, rtol=1e-5)
        np.testing.assert_allclose(one.attention.values, everybody.attention.values, rtol=1e-5)
        np.testing.assert_allclose(np.sort(one.weights), np.sort(everybody.weights), rtol=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_information_on_a_circle_never_raises_mass_nor_lowers_covariance(seed: int) -> None:
    """What one robot saw goes round a ring a hundred times, and comes back to it by two ways each time."""
    source = belief(seed)
    ring = metropolis(links("ring", 5))
    later = consensus([source] * 5, ring, 100)
    mass, mean, covariance = moments(source)
    for one in later:
        got_mass, got_mean, got_covariance = moments(one)
        assert got_mass <= mass * (1 + 1e-9)
        assert got_mass == pytest.approx(mass, rel=1e-9)
        assert got_mean == pytest.approx(mean, rel=1e-9)
        assert np.linalg.eigvalsh(got_covariance - covariance).min() >= -1e-9
        assert one.covariances is not None
        assert source.covariances is not None
        least = np.linalg.eigvalsh(source.covariances).min()
        assert np.linalg.eigvalsh(one.covariances).min() >= least * (1 - 1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_different_beliefs_on_a_circle_keep_their_mass_within_what_was_believed(seed: int) -> None:
    """Equal attention everywhere, so that the team's mass is the mean of the robots' masses for ever."""
    attention = belief(0).attention
    beliefs = [
        Belief(b.weights, b.means, b.covariances, b.undetected, attention)
        for b in (belief(10 * seed + i) for i in range(5))
    ]
    masses = [b.mass for b in beliefs]
    for rounds in (1, 7, 40):
        later = [b.mass for b in consensus(beliefs, metropolis(links("ring", 5)), rounds, Size(prune=0.0))]
        assert np.mean(later) == pytest.approx(np.mean(masses), rel=1e-9)
        assert max(later) <= max(masses) * (1 + 1e-9)
        assert min(later) >= min(masses) * (1 - 1e-9)
    assert later == pytest.approx([np.mean(masses)] * 5, rel=1e-4)


def test_bad_input_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="links"):
        metropolis(np.array([[False, True], [False, False]]))
    with pytest.raises(ValueError, match="rounds"):
        consensus([belief(1)], np.ones((1, 1)), -1)
    with pytest.raises(ValueError, match="weights"):
        consensus([belief(1)], np.ones((2, 2)), 1)
