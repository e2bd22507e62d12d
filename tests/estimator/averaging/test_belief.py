"""Averages of beliefs, against their definition."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.averaging.attention import Attention
from estimator.averaging.belief import Belief, Size, average
from estimator.filter import Area
from estimator.undetected import Undetected
from tests.estimator.averaging.scene import ALL, AREA, belief, intensity, moments

PLACES = np.random.default_rng(0).uniform(0.0, 20.0, (2, 400))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 5), st.booleans())
def test_averaging_equal_beliefs_changes_nothing(seed: int, count: int, points: bool) -> None:
    one = belief(seed, points=points)
    shares = np.random.default_rng(seed).dirichlet(np.ones(count))
    same = average([one] * count, shares, replace(ALL, merge_sigmas=1e-6))
    assert same.weights.size == one.weights.size
    order, other = np.argsort(one.weights), np.argsort(same.weights)
    np.testing.assert_allclose(same.weights[other], one.weights[order], rtol=1e-12)
    np.testing.assert_allclose(same.means[other], one.means[order], rtol=1e-12)
    if not points:
        assert same.covariances is not None
        assert one.covariances is not None
        np.testing.assert_allclose(same.covariances[other], one.covariances[order], rtol=1e-9)
    np.testing.assert_allclose(same.undetected.values, one.undetected.values, rtol=1e-12)
    np.testing.assert_allclose(same.attention.values, one.attention.values, rtol=1e-12)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 4))
def test_no_place_gets_more_than_the_most_or_less_than_the_least_believed(seed: int, count: int) -> None:
    """Equal attention: the weights are then the same over a component's whole width."""
    beliefs = [replace(belief(seed + i), attention=belief(seed).attention) for i in range(count)]
    fused = average(beliefs, np.random.default_rng(seed).dirichlet(np.ones(count)), ALL)
    values = np.array([intensity(b, PLACES) for b in beliefs])
    got = intensity(fused, PLACES)
    assert (got <= values.max(axis=0) * (1 + 1e-9) + 1e-15).all()
    assert (got >= values.min(axis=0) * (1 - 1e-9) - 1e-15).all()


@pytest.mark.parametrize("seed", range(5))
def test_the_average_is_equation_1(seed: int) -> None:
    """Undetected part at the nodes and weights of components at their means, written out."""
    rng = np.random.default_rng(seed)
    beliefs, shares = [belief(10 * seed + i) for i in range(3)], rng.dirichlet(np.ones(3))
    fused = average(beliefs, shares, ALL)

    def part(k: int, places: np.ndarray) -> np.ndarray:
        numerators = [m * b.attention.at(places) for m, b in zip(shares, beliefs, strict=True)]
        return np.asarray(numerators[k] / sum(numerators))

    nodes = fused.undetected.nodes()
    expected = sum(part(k, nodes) * b.undetected.values.ravel() for k, b in enumerate(beliefs))
    np.testing.assert_allclose(fused.undetected.values.ravel(), expected, rtol=1e-12)
    weights = np.concatenate([part(k, b.positions()) * b.weights for k, b in enumerate(beliefs)])
    np.testing.assert_allclose(np.sort(fused.weights), np.sort(weights), rtol=1e-12)


def test_a_place_is_as_the_one_believes_who_looked_there() -> None:
    west, east = (belief(seed, components=0) for seed in (1, 2))
    looked = np.full((11, 11), 1e-6)
    looked[:6] = 3.0
    west = replace(west, attention=Attention(looked, AREA))
    east = replace(east, attention=Attention(looked[::-1].copy(), AREA))
    places = np.array([[4.0, 16.0], [9.0, 9.0]])
    mine = replace(west, weights=np.ones(2), means=places.T, covariances=np.tile(0.1 * np.eye(2), (2, 1, 1)))
    fused = average([mine, east], np.full(2, 0.5))
    # what the west one believes of the east goes, what it saw in the west stays
    assert fused.means[np.argmax(fused.weights)] == pytest.approx([4.0, 9.0])
    assert fused.weights.max() == pytest.approx(1.0, abs=1e-5)
    assert fused.weights.sum() == pytest.approx(1.0, abs=1e-5)
    assert fused.undetected.at(places) == pytest.approx(
        [west.undetected.at(places)[0], east.undetected.at(places)[1]], rel=1e-4
    )


@pytest.mark.parametrize("seed", range(5))
def test_merging_keeps_mass_mean_and_covariance(seed: int) -> None:
    beliefs = [belief(seed, 30), belief(seed + 50, 30)]
    shares = np.array([0.3, 0.7])
    full, few = (average(beliefs, shares, s) for s in (ALL, Size(prune=0.0, merge_sigmas=2.0)))
    assert few.weights.size < full.weights.size
    for one, other in zip(moments(full), moments(few), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)


def test_more_points_than_allowed_are_resampled_without_a_change_of_mass() -> None:
    beliefs = [belief(1, 3000, points=True), belief(2, 3000, points=True)]
    full, few = (average(beliefs, np.array([0.5, 0.5]), s) for s in (ALL, Size(points=2000)))
    assert few.weights.size == 2000
    assert few.mass == pytest.approx(full.mass)
    np.testing.assert_allclose(moments(few)[1], moments(full)[1], atol=0.5)  # 4 standard deviations


def test_directions_of_undetected_targets_are_averaged_with_them() -> None:
    beliefs = []
    for seed in (1, 2):
        one = belief(seed)
        parts = np.random.default_rng(seed).uniform(0.0, 0.1, (2, 2, 9, 9))
        moving = replace(one.undetected, values=parts.sum(axis=(0, 1)), parts=parts, travelled=(0.1, 0.1))
        beliefs.append(replace(one, undetected=moving))
    fused = average(beliefs, np.array([0.4, 0.6])).undetected
    assert fused.parts is not None
    np.testing.assert_allclose(fused.parts.sum(axis=(0, 1)), fused.values)
    mixed = average([beliefs[0], belief(3)], np.array([0.4, 0.6])).undetected
    assert mixed.parts is None
    assert mixed.travelled == ()


def test_attention_is_the_sum_of_detection_probabilities_and_ages() -> None:
    class Half:
        def detection(self, points: np.ndarray, poses: np.ndarray) -> np.ndarray:
            return np.full((len(poses), points.shape[1]), 0.5)

    looked = Attention.none(AREA, (3, 4)).after(Half(), np.zeros((6, 4)))  # type: ignore[arg-type]
    assert looked.values == pytest.approx(np.full((3, 4), 3.0), rel=1e-5)
    assert looked.aged(0.1).values == pytest.approx(np.full((3, 4), 0.3), rel=1e-5)
    assert (looked.aged(0.0).values > 0).all()
    with pytest.raises(ValueError, match="share"):
        looked.aged(1.5)


def test_beliefs_that_cannot_be_averaged_are_refused_by_name() -> None:
    one, two = belief(1), belief(2)
    with pytest.raises(ValueError, match="shares"):
        average([one, two], np.array([1.0]))
    with pytest.raises(ValueError, match="shares"):
        average([one, two], np.array([0.7, 0.7]))
    with pytest.raises(ValueError, match="shares"):
        average([one, two], np.array([np.nan, 1.0]))
    with pytest.raises(ValueError, match="shares"):
        average([], np.zeros(0))
    with pytest.raises(ValueError, match="some are points"):
        average([one, belief(2, points=True)], np.full(2, 0.5))
    other = Area(np.zeros(2), np.full(2, 21.0))
    with pytest.raises(ValueError, match="area of number 1"):
        average([one, replace(two, undetected=Undetected(two.undetected.values, other))], np.full(2, 0.5))
    with pytest.raises(ValueError, match="attention grid of number 1"):
        average([one, replace(two, attention=Attention.none(AREA, (3, 3)))], np.full(2, 0.5))


def test_a_robot_that_believes_nothing_can_be_averaged() -> None:
    empty: Belief = belief(3, components=0)
    fused = average([empty, empty], np.full(2, 0.5))
    assert fused.weights.size == 0
    assert average([empty, belief(4)], np.full(2, 0.5)).weights.size == 6
