"""Gated likelihoods in bands against the same written out."""

from math import pi

import numpy as np
import pytest
from scipy import stats

from estimator.sensors.bands import arctangent, gated_gaussian


def test_the_arctangent_is_that_of_the_library() -> None:
    rng = np.random.default_rng(0)
    angles = np.append(rng.uniform(-pi, pi, 5000), np.arange(-8, 9) * pi / 8)
    y, x = 10 ** rng.uniform(-5, 5, angles.size) * np.stack([np.sin(angles), np.cos(angles)])
    mine = np.array([arctangent(a, b) for a, b in zip(y, x, strict=True)])
    np.testing.assert_allclose(mine, np.arctan2(y, x), atol=1e-14)
    assert arctangent(0.0, 0.0) == 0.0


@pytest.mark.parametrize("seed", range(24))
def test_rows_hold_what_is_within_the_gate_and_nothing_else(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, circular = 1 + seed % 3, seed % 2 == 0
    sigmas = 10 ** rng.uniform(-3, 0, size)
    sigmas[0] = 10 ** rng.uniform(-3, -0.3)  # from a hundredth of a band to all around
    coordinates = rng.uniform(-pi, pi, (size, 900))
    coordinates[0, :2] = -pi, pi
    kept = np.sort(rng.choice(5000, 900, replace=False))
    z = np.concatenate([rng.uniform(-pi, pi, (20, size)), coordinates[:, :20].T])
    z[:3, 0] += np.array([2 * pi, -2 * pi, 1e-12])
    offsets, indices, likelihood = gated_gaussian(coordinates, kept, z, sigmas, 6.0, circular)
    off = coordinates.T[None] - z[:, None]
    if circular:
        off[..., 0] = (off[..., 0] + pi) % (2 * pi) - pi
    expected = np.prod(stats.norm.pdf(off, scale=sigmas), axis=-1)
    expected[(np.abs(off) > 6.0 * sigmas).any(axis=-1)] = 0.0
    found = np.zeros((40, 5000))
    for j in range(40):
        row = slice(offsets[j], offsets[j + 1])
        found[j, indices[row]] = likelihood[row]
    np.testing.assert_allclose(found[:, kept], expected, rtol=1e-9, atol=1e-9 * expected.max())
    assert np.count_nonzero(found) == indices.size == np.count_nonzero(expected)


@pytest.mark.parametrize("circular", [False, True])
def test_no_points_and_no_measurements_give_empty_rows(circular: bool) -> None:
    none = np.zeros(0, np.int64)
    offsets, indices, _ = gated_gaussian(np.zeros((2, 0)), none, np.ones((3, 2)), np.ones(2), 6.0, circular)
    assert (offsets.tolist(), indices.size) == ([0, 0, 0, 0], 0)
    offsets, indices, _ = gated_gaussian(
        np.ones((1, 4)), np.arange(4), np.ones((0, 1)), np.ones(1), 6.0, circular
    )
    assert (offsets.tolist(), indices.size) == ([0], 0)
