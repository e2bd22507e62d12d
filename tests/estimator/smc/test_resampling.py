"""Systematic resampling and jitter."""

import numpy as np
import pytest

from estimator.smc.resampling import effective_size, effective_sizes, gathered, jittered, systematic


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("count", [1, 7, 1000])
def test_every_particle_occurs_floor_or_ceil_of_its_share(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    w = rng.exponential(1.0, 100) * (rng.random(100) < 0.7)
    chosen = systematic(w, count, rng.random())
    assert chosen.size == count
    assert (np.diff(chosen) >= 0).all()
    share = count * w / w.sum()
    times = np.bincount(chosen, minlength=100)
    assert (times >= np.floor(share - 1e-9)).all()
    assert (times <= np.ceil(share + 1e-9)).all()


def test_resampling_is_unbiased() -> None:
    w = np.array([0.1, 0.25, 0.05, 0.6])
    times = sum(np.bincount(systematic(w, 3, (k + 0.5) / 1000), minlength=4) for k in range(1000))
    assert np.allclose(times / 3000, w, atol=2e-3)


@pytest.mark.parametrize("offset", [0.0, np.nextafter(1.0, 0.0)])
def test_particles_without_weight_are_never_chosen(offset: float) -> None:
    w = np.array([0.0, 1.0, 0.0, 2.0, 0.0])
    assert set(systematic(w, 10, offset).tolist()) == {1, 3}


def test_effective_size_counts_equal_weights() -> None:
    assert effective_size(np.array([2.0, 2.0, 2.0, 0.0])) == pytest.approx(3.0)
    assert effective_size(np.zeros(4)) == 0.0
    labels = np.array([0, 0, -1, 1, 1, 1])
    assert np.allclose(effective_sizes(np.ones(6), labels, 3), [2.0, 3.0, 0.0])


@pytest.mark.parametrize("d", [2, 3])
def test_jitter_keeps_each_clusters_mean_and_covariance_however_often(d: int) -> None:
    rng = np.random.default_rng(0)
    root = np.tril(rng.normal(size=(d, d)))
    x = np.concatenate([root @ rng.standard_normal((d, 4000)), 50.0 + rng.standard_normal((d, 4000))], axis=1)
    labels = np.repeat([0, 1], 4000)
    before = [(x[:, labels == j].mean(axis=1), np.cov(x[:, labels == j])) for j in (0, 1)]
    for _ in range(20):
        noise = rng.standard_normal(x.shape)
        jittered(x, labels, np.full(2, 30.0), 1.0, noise, np.full(d, -1e3), np.full(d, 1e3))
    for j, (mean, covariance) in enumerate(before):
        assert np.allclose(x[:, labels == j].mean(axis=1), mean, atol=0.2)
        assert np.allclose(np.cov(x[:, labels == j]), covariance, atol=0.15 * np.trace(covariance))


def test_jitter_parts_copies_but_leaves_strays_and_the_area_alone() -> None:
    rng = np.random.default_rng(1)
    few = rng.uniform(0.0, 1.0, (2, 20))
    x = gathered(few, np.repeat(np.arange(20), 50))
    labels = np.zeros(1000, dtype=np.int64)
    labels[:100] = -1
    before = x.copy()
    jittered(x, labels, np.array([20.0]), 0.5, rng.standard_normal(x.shape), np.zeros(2), np.ones(2))
    assert np.array_equal(x[:, :100], before[:, :100])
    assert np.unique(x[0, 100:]).size > 800
    assert ((x >= 0.0) & (x <= 1.0)).all()
