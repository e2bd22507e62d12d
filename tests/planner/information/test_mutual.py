import numpy as np
import pytest

from planner.information.mutual import components, mutual_information
from tests.planner.information import brute

MANY = 4000  # Taylor terms, so that their error does not count


@pytest.mark.parametrize(
    ("events", "points", "seed"),
    [(m, n, seed) for m, n, cases in ((1, 2, 6), (2, 2, 6), (3, 2, 6), (2, 3, 2)) for seed in range(cases)],
)
def test_it_is_that_of_all_targets_and_outcomes_enumerated(seed: int, events: int, points: int) -> None:
    detection, weights, clutter = brute.random_case(seed, events, points)
    weights = weights[:points] * (0.5 if points == 3 else 1.0)
    ours = mutual_information(detection, weights, clutter, MANY)
    assert ours.exact
    assert abs(ours.value - brute.information(detection, weights, clutter)) <= ours.error + 1e-10
    assert ours.error < 1e-3


@pytest.mark.parametrize("seed", range(10))
def test_it_is_never_negative_and_grows_with_every_measurement(seed: int) -> None:
    detection, weights, clutter = brute.random_case(seed, 9, points=30)
    weights /= 10
    before = 0.0
    for m in range(10):
        value = mutual_information(detection[:m], weights, clutter[:m], MANY).value
        assert value >= before - 1e-4
        before = value


@pytest.mark.parametrize("seed", range(5))
def test_robots_can_be_taken_in_any_order(seed: int) -> None:
    detection, weights, clutter = brute.random_case(seed, 8, points=30)
    order = np.random.default_rng(seed).permutation(8)
    one = mutual_information(detection, weights, clutter).value
    assert mutual_information(detection[order], weights, clutter[order]).value == pytest.approx(
        one, abs=1e-11
    )


def test_robots_that_see_different_targets_say_the_sum() -> None:
    detection, weights, clutter = brute.random_case(1, 4, points=20)
    apart = np.block([[detection, np.zeros((4, 20))], [np.zeros((4, 20)), detection]])
    both = mutual_information(apart, np.tile(weights, 2), np.tile(clutter, 2))
    assert both.value == pytest.approx(2 * mutual_information(detection, weights, clutter).value, abs=1e-11)
    assert [len(c) for c in components(apart)] == [4, 4]


def test_a_hundred_robots_that_are_apart_are_exact() -> None:
    detection = np.kron(np.eye(100), np.array([[0.5, 0.7]]))
    ours = mutual_information(detection, np.full(200, 0.2), np.full(100, 0.3))
    alone = mutual_information(detection[:1, :2], np.full(2, 0.2), np.full(1, 0.3))
    assert ours.exact
    assert ours.value == pytest.approx(100 * alone.value)


@pytest.mark.parametrize("limit", [2, 4, 6])
@pytest.mark.parametrize("seed", range(6))
def test_beyond_the_limit_the_truth_lies_within_the_error_that_it_says(seed: int, limit: int) -> None:
    rng = np.random.default_rng(seed)
    middles = np.sort(rng.uniform(0, 10, 12))  # events along a line, each with its neighbours in common
    detection = 0.8 * (np.abs(np.linspace(0, 10, 40) - middles[:, None]) < 1.2)
    weights, clutter = np.full(40, 0.05), np.full(12, 0.2)
    exact = mutual_information(detection, weights, clutter, MANY)
    ours = mutual_information(detection, weights, clutter, MANY, limit)
    assert exact.exact
    assert abs(ours.value - exact.value) <= ours.error + exact.error
    assert ours.error < exact.value  # it says something


def test_thirty_robot_steps_that_share_targets_are_bounded() -> None:
    middles = np.linspace(0, 10, 30)
    detection = 0.8 * (np.abs(np.linspace(0, 10, 100) - middles[:, None]) < 1.0)
    ours = mutual_information(detection, np.full(100, 0.02), np.full(30, 0.2), limit=10)
    assert not ours.exact
    assert 0.0 < ours.error <= ours.value + 1e-9


def test_one_certain_target_or_none_is_worth_what_a_coin_is() -> None:
    """p_D = 1, no clutter: y says exactly whether there is a target."""
    w = np.log(2.0)  # there is one with probability 1/2
    ours = mutual_information(np.ones((1, 1)), np.array([w]), np.zeros(1), MANY)
    assert ours.value == pytest.approx(np.log(2.0), abs=ours.error + 1e-12)


@pytest.mark.parametrize("limit", [1, 25])
def test_a_limit_that_cannot_be_is_named(limit: int) -> None:
    with pytest.raises(ValueError, match=r"^limit: "):
        mutual_information(np.zeros((1, 1)), np.ones(1), np.zeros(1), limit=limit)
