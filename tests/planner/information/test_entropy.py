import numpy as np
import pytest

from planner.information.entropy import entropy, moebius, no_detection, outcome_probabilities, zeta
from tests.planner.information import brute

SEEDS = range(5)


@pytest.mark.parametrize("seed", SEEDS)
def test_every_outcome_has_the_probability_of_total_enumeration(seed: int) -> None:
    detection, weights, clutter = brute.random_case(seed, 3)
    ours = outcome_probabilities(detection, weights, clutter)
    for y, p in brute.outcomes(detection, weights, clutter).items():
        empty = sum(1 << i for i, bit in enumerate(y) if bit == 0)
        assert ours[empty] == pytest.approx(p, abs=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_detection_is_the_papers_formula_for_every_subset(seed: int) -> None:
    detection, weights, clutter = brute.random_case(seed, 6, points=40)
    ours = no_detection(detection, weights, clutter)
    for subset in range(64):
        rows = [i for i in range(6) if subset >> i & 1]
        seen = weights @ (1 - np.prod(1 - detection[rows], axis=0))  # lambda alpha, (19)
        assert ours[subset] == pytest.approx(np.exp(-clutter[rows].sum() - seen), rel=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_inclusion_exclusion_by_transform_is_that_term_by_term(seed: int) -> None:
    detection, weights, clutter = brute.random_case(seed, 7, points=30)
    z, ours = no_detection(detection, weights, clutter), outcome_probabilities(detection, weights, clutter)
    for empty in range(128):
        full = 127 ^ empty
        total, more = 0.0, full  # over all subsets C of C_1, (18)
        while True:
            total += (-1) ** more.bit_count() * z[empty | more]
            if more == 0:
                break
            more = (more - 1) & full
        assert ours[empty] == pytest.approx(total, abs=1e-12)


def test_the_transforms_undo_the_sums_that_define_them() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=32)
    table = values.copy()
    zeta(table)
    for s in range(32):
        assert table[s] == pytest.approx(sum(values[u] for u in range(32) if u & s == u), abs=1e-12)
    table = np.array([sum(values[u] for u in range(32) if u & s == s) for s in range(32)])
    moebius(table)
    np.testing.assert_allclose(table, values, atol=1e-12)


def test_fair_coins_that_see_nothing_have_their_own_entropy() -> None:
    mu = np.log(2.0)  # empty with probability 1/2
    assert entropy(np.zeros((5, 3)), np.ones(3), np.full(5, mu)) == pytest.approx(5 * np.log(2))


@pytest.mark.parametrize("seed", SEEDS)
def test_sixteen_events_are_still_probabilities(seed: int) -> None:
    detection, weights, clutter = brute.random_case(seed, 16, points=60)
    p = outcome_probabilities(detection, weights, clutter)
    assert p.sum() == pytest.approx(1.0, abs=1e-9)
    assert p.min() > -1e-11


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"detection": np.full((2, 3), 1.5)}, "detection"),
        ({"detection": np.full((2, 3), np.nan)}, "detection"),
        ({"detection": np.zeros((25, 3)), "clutter": np.zeros(25)}, "detection"),
        ({"weights": np.full(3, np.inf)}, "weights"),
        ({"weights": -np.ones(3)}, "weights"),
        ({"weights": np.ones(4)}, "weights"),
        ({"clutter": np.ones(3)}, "clutter"),
        ({"clutter": np.array([np.nan, 0.0])}, "clutter"),
    ],
)
def test_a_number_out_of_range_is_named(changed: dict[str, np.ndarray], named: str) -> None:
    whole = {"detection": np.zeros((2, 3)), "weights": np.ones(3), "clutter": np.zeros(2)} | changed
    with pytest.raises(ValueError, match=rf"^{named}: "):
        entropy(**whole)


def test_nothing_at_all_has_no_entropy() -> None:
    assert entropy(np.zeros((0, 0)), np.zeros(0), np.zeros(0)) == 0.0
    assert entropy(np.zeros((2, 0)), np.zeros(0), np.zeros(2)) == 0.0
