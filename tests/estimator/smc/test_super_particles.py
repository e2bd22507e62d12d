"""Super-particles, Dames & Kumar (2015) section IV-B."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.arrays import FloatArray
from estimator.smc.super_particles import at_most, super_particles


def cloud(seed: int, d: int = 2, n: int = 300) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    weights = rng.random(n) * (rng.random(n) < 0.8)
    return 10.0 * rng.standard_normal((d, n)), weights


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.floats(0.01, 100.0))
def test_mass_and_mean_are_kept_and_every_cell_has_one(seed: int, d: int, side: float) -> None:
    points, weights = cloud(seed, d)
    merged, masses = super_particles(points, weights, side)
    assert masses.sum() == pytest.approx(weights.sum())
    assert np.allclose(merged @ masses, points @ weights)
    low = points[:, weights > 0].min(axis=1)
    cells = {tuple(cell) for cell in np.floor((points[:, weights > 0].T - low) / side).astype(int)}
    assert masses.size == len(cells)


def test_a_super_particle_lies_in_the_weighted_middle_of_its_cell() -> None:
    points = np.array([[0.0, 0.3, 5.0, 5.2], [0.0, 0.0, 5.0, 5.0]])
    merged, masses = super_particles(points, np.array([1.0, 2.0, 0.5, 0.5]), 1.0)
    assert np.allclose(merged, [[0.2, 5.1], [0.0, 5.0]])
    assert np.allclose(masses, [3.0, 1.0])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 400))
def test_there_are_never_more_than_asked(seed: int, size: int) -> None:
    points, weights = cloud(seed)
    merged, masses = at_most(points, weights, size)
    assert 0 < masses.size <= size
    assert merged.shape == (2, masses.size)
    assert masses.sum() == pytest.approx(weights.sum())
    assert np.allclose(merged @ masses, points @ weights)


def test_cells_are_not_coarser_than_they_need_be() -> None:
    axis = np.arange(32.0)
    points = np.stack([a.ravel() for a in np.meshgrid(axis, axis)])
    _, masses = at_most(points, np.ones(1024), 256)
    assert 100 <= masses.size <= 256


def test_particles_at_one_place_are_one() -> None:
    merged, masses = at_most(np.full((3, 50), 2.5), np.full(50, 0.1), 10)
    assert np.allclose(merged, 2.5)
    assert merged.shape == (3, 1)
    assert masses == pytest.approx([5.0])


def test_nothing_makes_nothing() -> None:
    for merged, masses in (
        super_particles(np.zeros((2, 3)), np.zeros(3), 1.0),
        at_most(np.zeros((2, 0)), np.zeros(0), 5),
        at_most(np.ones((2, 3)), np.ones(3), 0),
    ):
        assert merged.shape == (2, 0)
        assert masses.size == 0


@pytest.mark.parametrize("side", [0.0, -1.0, np.nan, np.inf])
def test_a_bad_side_is_refused_by_name(side: float) -> None:
    with pytest.raises(ValueError, match="side"):
        super_particles(np.zeros((2, 1)), np.ones(1), side)


def test_a_weight_too_few_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="weights"):
        super_particles(np.zeros((2, 3)), np.ones(2), 1.0)
