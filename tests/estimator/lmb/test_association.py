"""Marginal association probabilities, against the enumeration of all joint associations."""

from itertools import product

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.lmb.association import CERTAIN, Marginals, Pairs, associated


def enumerated(psi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """P(track i made j) (n, m) and P(track i unseen) (n,), by brute force over all joint associations."""
    n, m = psi.shape
    pairs, unseen, total = np.zeros((n, m)), np.zeros(n), 0.0
    for choice in product(range(-1, m), repeat=n):
        taken = [j for j in choice if j >= 0]
        if len(taken) != len(set(taken)):
            continue
        weight = float(np.prod([psi[i, j] for i, j in enumerate(choice) if j >= 0]))
        total += weight
        for i, j in enumerate(choice):
            if j >= 0:
                pairs[i, j] += weight
            else:
                unseen[i] += weight
    return pairs / total, unseen / total


def sparse(psi: FloatArray) -> Pairs:
    """The pairs with psi > 0."""
    rows, columns = np.nonzero(psi)
    counts = np.bincount(rows, minlength=len(psi))
    return Pairs(np.append(0, np.cumsum(counts)), columns.astype(np.int64), psi[rows, columns], psi.shape[1])


def dense(found: Marginals, psi: FloatArray) -> FloatArray:
    out = np.zeros_like(psi)
    out[np.nonzero(psi)] = found.pairs
    return out


def weights(seed: int, shape: tuple[int, int] | None = None, fill: float = 0.7) -> FloatArray:
    rng = np.random.default_rng(seed)
    n, m = shape or (int(rng.integers(1, 5)), int(rng.integers(1, 5)))
    return 10.0 ** rng.uniform(-2.0, 3.0, (n, m)) * (rng.random((n, m)) < fill)


@pytest.mark.parametrize("seed", range(30))
def test_small_groups_are_solved_exactly(seed: int) -> None:
    psi = weights(seed)
    found = associated(sparse(psi))
    pairs, unseen = enumerated(psi)
    assert np.allclose(dense(found, psi), pairs, atol=1e-12)
    assert np.allclose(found.unseen, unseen, atol=1e-12)
    assert np.allclose(found.others, 1.0 - pairs.sum(axis=0), atol=1e-12)


@pytest.mark.parametrize("shape", [(2, 6), (6, 2)])
def test_small_groups_are_solved_exactly_whichever_side_is_the_smaller(shape: tuple[int, int]) -> None:
    psi = weights(1, shape, 1.0)
    assert np.allclose(dense(associated(sparse(psi)), psi), enumerated(psi)[0], atol=1e-12)


@pytest.mark.parametrize("seed", range(30))
def test_belief_propagation_is_near_the_exact_marginals(seed: int) -> None:
    """Hard cases: in 300 of them the mean error is 0.006, the worst 0.29."""
    psi = weights(seed)
    found = associated(sparse(psi), "lbp", exact_up_to=0)
    pairs, unseen = enumerated(psi)
    assert found.converged
    assert np.abs(dense(found, psi) - pairs).max() < 0.15
    assert np.abs(found.unseen - unseen).max() < 0.15


@pytest.mark.parametrize("seed", range(10))
def test_belief_propagation_is_exact_on_a_tree(seed: int) -> None:
    """Tracks 0..3 in a chain: each shares one measurement with the next."""
    psi = np.zeros((4, 5))
    for i in range(4):
        psi[i, i : i + 2] = weights(seed, (1, 2), 1.0)
    found = associated(sparse(psi), "lbp", exact_up_to=0)
    assert np.allclose(dense(found, psi), enumerated(psi)[0], atol=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_gibbs_sampling_that_visits_every_association_is_exact(seed: int) -> None:
    psi = weights(seed)
    found = associated(sparse(psi), "gibbs", exact_up_to=0, sweeps=3000, rng=np.random.default_rng(seed))
    pairs, unseen = enumerated(psi)
    assert np.allclose(dense(found, psi), pairs, atol=2e-3)
    assert np.allclose(found.unseen, unseen, atol=2e-3)


def test_gibbs_sampling_of_one_generator_is_repeatable_and_needs_one() -> None:
    psi = weights(3, (8, 8), 1.0)
    results = [associated(sparse(psi), "gibbs", rng=np.random.default_rng(seed)).pairs for seed in (1, 1, 2)]
    assert np.array_equal(results[0], results[1])
    assert not np.array_equal(results[0], results[2])
    with pytest.raises(ValueError, match="rng"):
        associated(sparse(psi), "gibbs")


@pytest.mark.parametrize("seed", range(5))
def test_both_methods_agree_on_groups_too_large_to_enumerate(seed: int) -> None:
    rng = np.random.default_rng(seed)
    psi = np.exp(-0.5 * (rng.uniform(0, 6, (10, 1)) - rng.uniform(0, 6, (1, 12))) ** 2 / 0.1) * 20.0
    psi[psi < 1e-3] = 0.0
    lbp = dense(associated(sparse(psi), "lbp", exact_up_to=0), psi)
    gibbs = dense(associated(sparse(psi), "gibbs", exact_up_to=0, sweeps=4000, rng=rng), psi)
    exact = dense(associated(sparse(psi), exact_up_to=12), psi)
    assert np.abs(lbp - exact).max() < 0.15
    assert np.abs(gibbs - exact).max() < 0.15


@pytest.mark.parametrize("method", ["lbp", "gibbs"])
@pytest.mark.parametrize("limit", [0, 5])
def test_groups_that_share_nothing_are_independent(method: str, limit: int) -> None:
    psi = np.zeros((6, 6))
    psi[:3, :3], psi[3:, 3:] = weights(1, (3, 3), 1.0), weights(2, (3, 3), 1.0)
    options = {"exact_up_to": limit, "sweeps": 2000}
    whole = dense(associated(sparse(psi), method, rng=np.random.default_rng(1), **options), psi)  # type: ignore[arg-type]
    part = associated(sparse(psi[:3, :3]), method, rng=np.random.default_rng(2), **options)  # type: ignore[arg-type]
    assert np.allclose(whole[:3, :3], dense(part, psi[:3, :3]), atol=3e-3)


@pytest.mark.parametrize("limit", [0, 5])
def test_permuting_measurements_permutes_the_marginals(limit: int) -> None:
    psi = weights(4, (7, 8), 0.6)
    order = np.random.default_rng(0).permutation(8)
    plain = dense(associated(sparse(psi), exact_up_to=limit), psi)
    permuted = dense(associated(sparse(psi[:, order]), exact_up_to=limit), psi[:, order])
    assert np.allclose(plain[:, order], permuted, atol=1e-6)


@pytest.mark.parametrize("limit", [0, 5])
def test_certain_pairs_stay_finite(limit: int) -> None:
    """Neither clutter nor a way to go unseen: psi is infinite and the best joint association takes all."""
    psi = np.array([[np.inf, 0.0, 0.0], [1e-3, np.inf, 0.0], [0.0, 5.0, 0.0]])
    found = associated(sparse(psi), exact_up_to=limit)
    assert np.allclose(dense(found, psi)[:2, :2], np.eye(2), atol=1e-9)
    assert found.unseen[2] == pytest.approx(1.0)
    assert np.isfinite(CERTAIN)
    # two measurements that only one track can have made: it made one of them
    one = associated(sparse(np.array([[np.inf, np.inf]])), exact_up_to=limit)
    assert one.pairs == pytest.approx([0.5, 0.5])


def test_nothing_to_associate_leaves_everything_alone() -> None:
    found = associated(Pairs(np.zeros(4, np.int64), np.zeros(0, np.int64), np.zeros(0), 2))
    assert found.unseen.tolist() == [1.0] * 3
    assert found.others.tolist() == [1.0] * 2
    none = associated(Pairs(np.zeros(1, np.int64), np.zeros(0, np.int64), np.zeros(0), 0))
    assert none.unseen.size == none.others.size == 0


@pytest.mark.parametrize("value", [-1.0, np.nan])
def test_weights_that_are_none_are_refused_by_name(value: float) -> None:
    with pytest.raises(ValueError, match="psi"):
        associated(sparse(np.array([[1.0, value]])))


def test_groups_without_limit_are_never_left_unsolved() -> None:
    psi = weights(5, (12, 20), 0.3)
    found = associated(sparse(psi))
    assert np.allclose(dense(found, psi).sum(axis=1) + found.unseen, 1.0)
    assert (found.others >= 0.0).all()
