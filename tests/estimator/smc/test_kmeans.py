"""Weighted, trimmed K-means."""

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.smc.kmeans import kmeans


def blobs(centres: FloatArray, sigma: float, count: int, seed: int = 0) -> FloatArray:
    rng = np.random.default_rng(seed)
    d, c = centres.shape
    return np.ascontiguousarray(
        np.repeat(centres, count, axis=1) + sigma * rng.standard_normal((d, c * count))
    )


def targets(d: int, c: int, seed: int, apart: float) -> FloatArray:
    """Random points at least `apart` from each other."""
    rng, chosen = np.random.default_rng(seed), np.zeros((d, 0))
    while chosen.shape[1] < c:
        new = rng.uniform(0, 200, (d, 1))
        if chosen.size == 0 or np.linalg.norm(chosen - new, axis=0).min() > apart:
            chosen = np.concatenate([chosen, new], axis=1)
    return chosen


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_every_peak_becomes_one_cluster_with_its_mean_spread_and_mass(d: int, seed: int) -> None:
    centres = targets(d, 12, seed, 8.0)
    x = blobs(centres, 0.5, 400, seed)
    masses = np.linspace(0.3, 2.4, 12)
    found, labels = kmeans(x, np.repeat(masses / 400, 400), 2.5)
    assert found.masses.size == 12
    assert (np.diff(found.masses) <= 0).all()
    for j in range(12):
        member = np.linalg.norm(centres - found.means[:, [j]], axis=0).argmin()
        assert np.linalg.norm(centres[:, member] - found.means[:, j]) < 0.15
        assert found.masses[j] == pytest.approx(masses[member], rel=0.03)
        assert found.radii[j] == pytest.approx(0.5, rel=0.1)
        assert np.allclose(found.covariances[j], 0.25 * np.eye(d), atol=0.06)
        assert (labels[member * 400 : (member + 1) * 400] == j).mean() > 0.95


@pytest.mark.parametrize("seed", range(4))
def test_centres_are_a_fixed_point_of_scipys_weighted_lloyd_step(seed: int) -> None:
    from scipy.cluster.vq import vq

    rng = np.random.default_rng(seed)
    x = blobs(targets(2, 5, seed, 8.0), 0.8, 200, seed)
    w = rng.random(x.shape[1]) / 200
    found, labels = kmeans(x, w, 50.0)
    nearest, _ = vq(x.T, found.means.T)
    assert np.array_equal(nearest, labels)
    for j in range(found.masses.size):
        own = nearest == j
        assert np.allclose(np.average(x[:, own], axis=1, weights=w[own]), found.means[:, j], atol=1e-2)


def test_distortion_is_that_of_the_best_partition_of_a_tiny_set() -> None:
    from itertools import product

    x = np.array([[0.0, 0.3, 0.1, 5.0, 5.2, 9.0, 9.1], [0.0, 0.1, 0.4, 0.0, 0.3, 4.0, 4.2]])
    w = np.array([1.0, 2.0, 1.0, 3.0, 1.0, 1.0, 1.0])

    def distortion(labels: np.ndarray) -> float:
        total = 0.0
        for j in set(labels.tolist()):
            own = labels == j
            centre = np.average(x[:, own], axis=1, weights=w[own])
            total += np.sum(w[own] * np.sum((x[:, own] - centre[:, None]) ** 2, axis=0))
        return total

    best = min(distortion(np.array(labels)) for labels in product(range(3), repeat=7))
    found, labels = kmeans(x, w, 2.0)
    assert found.masses.size == 3
    assert distortion(labels) == pytest.approx(best)


def test_stray_mass_belongs_to_no_cluster_and_widens_none() -> None:
    rng = np.random.default_rng(1)
    peak, stray = blobs(np.array([[50.0], [50.0]]), 0.5, 500), rng.uniform(0, 200, (2, 500))
    x = np.concatenate([peak, stray], axis=1)
    found, labels = kmeans(x, np.full(1000, 1.0 / 500), 2.5)
    assert found.masses.size == 1
    assert found.radii[0] < 0.6
    assert (labels[500:] == -1).mean() > 0.98


def test_one_heavy_peak_stays_one_cluster() -> None:
    x = blobs(np.array([[10.0], [20.0], [30.0]]), 1.0, 3000)
    found, _ = kmeans(x, np.full(3000, 2.6 / 3000), 4.5)
    assert found.masses.size == 1
    assert found.masses[0] == pytest.approx(2.6, rel=0.02)


@pytest.mark.parametrize(("gap", "count"), [(2.0, 1), (6.0, 2)])
def test_two_peaks_within_the_cutoff_are_two_if_separate(gap: float, count: int) -> None:
    x = blobs(np.array([[10.0, 10.0 + gap], [0.0, 0.0]]), 1.0, 1000)
    assert kmeans(x, np.full(2000, 1e-3), 12.0)[0].masses.size == count


def test_a_start_from_the_previous_centres_gives_the_same_clusters() -> None:
    x = blobs(targets(2, 8, 5, 8.0), 0.5, 200)
    w = np.full(1600, 1.0 / 200)
    cold, labels = kmeans(x, w, 2.5)
    warm, again = kmeans(x, w, 2.5, start=cold.means[:, ::-1])
    order = np.argsort(cold.means[0]), np.argsort(warm.means[0])
    assert np.allclose(cold.means[:, order[0]], warm.means[:, order[1]], atol=0.02)
    assert np.array_equal(labels < 0, again < 0)


def test_the_same_input_gives_the_same_bits() -> None:
    x = blobs(targets(3, 8, 5, 8.0), 0.5, 200)
    w = np.full(1600, 1.0 / 200)
    first, second = kmeans(x, w, 2.5), kmeans(x, w, 2.5)
    assert first[0].means.tobytes() == second[0].means.tobytes()
    assert np.array_equal(first[1], second[1])


@pytest.mark.parametrize("shift", [np.array([[1e4], [-3e3]]), np.array([[-7.3], [0.2]])])
def test_clusters_move_with_the_frame(shift: FloatArray) -> None:
    x = blobs(targets(2, 6, 2, 8.0), 0.5, 300)
    w = np.full(1800, 1.0 / 300)
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    there, _ = kmeans(np.ascontiguousarray(turn @ x + shift), w, 2.5)
    here, _ = kmeans(x, w, 2.5)
    moved = turn @ here.means + shift
    gaps = np.linalg.norm(moved[:, :, None] - there.means[:, None, :], axis=0)
    assert gaps.shape == (6, 6)
    assert (gaps.min(axis=1) < 0.05).all()


@pytest.mark.parametrize("n", [0, 1])
def test_next_to_nothing_gives_no_cluster(n: int) -> None:
    found, labels = kmeans(np.zeros((3, n)), np.full(n, 0.01), 1.0)
    assert found.masses.size == 0
    assert (labels == -1).all()


def test_all_mass_in_one_point_is_a_cluster_of_radius_zero() -> None:
    found, _ = kmeans(np.full((2, 50), 3.0), np.full(50, 0.02), 1.0)
    assert found.masses.tolist() == pytest.approx([1.0])
    assert found.radii[0] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize(
    ("w", "cutoff", "name"),
    [(np.ones(3), 1.0, "weights"), (np.ones(4), 0.0, "cutoff"), (np.ones(4), np.nan, "cutoff")],
)
def test_bad_input_is_refused_by_name(w: FloatArray, cutoff: float, name: str) -> None:
    with pytest.raises(ValueError, match=name):
        kmeans(np.zeros((2, 4)), w, cutoff)
