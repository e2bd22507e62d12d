from math import log

import numpy as np
import pytest

from planner.information.conditional import conditional_entropies
from tests.planner.information import brute


def truth(detection: np.ndarray, weights: np.ndarray, clutter: np.ndarray) -> np.ndarray:
    total = np.zeros(len(clutter))
    for p, counts in brute.populations(weights):
        for i, e in enumerate(brute.empties(detection, clutter, counts)):
            total[i] -= p * sum(q * log(q) for q in (e, 1 - e) if q > 0.0)
    return total


@pytest.mark.parametrize("terms", [1, 2, 10, 100])
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("clutter_free", [False, True])
def test_the_truth_lies_within_the_stated_error(seed: int, terms: int, clutter_free: bool) -> None:
    detection, weights, clutter = brute.random_case(seed, 3)
    clutter = np.zeros(3) if clutter_free else clutter
    ours, exact = (
        conditional_entropies(detection, weights, clutter, terms),
        truth(detection, weights, clutter),
    )
    assert (np.abs(ours.value - exact) <= ours.error + 1e-12).all()
    assert (ours.stated >= exact - 1e-12).all()
    assert (ours.error <= 0.5 / terms).all()


def test_the_papers_ten_terms_are_those_of_24() -> None:
    detection, weights, clutter = brute.random_case(3, 1)
    d, w, mu = detection[0], weights, clutter[0]
    z = [np.exp(-k * mu - w @ (1 - (1 - d) ** k)) for k in range(11)]
    beta = -w @ ((1 - d) * np.log(1 - d))
    stated = (mu + beta) * z[1] + z[1] - sum(z[k] / (k * (k - 1)) for k in range(2, 11))
    assert conditional_entropies(detection, weights, clutter).stated[0] == pytest.approx(stated, rel=1e-12)


def test_the_papers_sensor_needs_no_more_than_ten_terms() -> None:
    """With mu = 0.532 false measurements, section IV-A, ten terms are within 0.2 thousandths of a nat."""
    detection = np.full((1, 50), 0.5)
    assert conditional_entropies(detection, np.full(50, 0.01), np.array([0.532])).error[0] < 2e-4


def test_a_measurement_that_sees_nothing_and_errs_never_is_certain() -> None:
    ours = conditional_entropies(np.zeros((1, 4)), np.ones(4), np.zeros(1))
    assert ours.value[0] == pytest.approx(0.0, abs=1e-15)
    assert ours.error[0] == 0.0
    assert ours.stated[0] == pytest.approx(0.1)  # what the paper's ten terms leave out


def test_certain_detection_is_no_infinity() -> None:
    ours = conditional_entropies(np.ones((1, 2)), np.array([0.5, 0.7]), np.array([0.3]))
    assert np.isfinite(ours.value).all()


def test_without_terms_there_is_no_series() -> None:
    with pytest.raises(ValueError, match=r"^terms: "):
        conditional_entropies(np.zeros((1, 1)), np.ones(1), np.zeros(1), 0)
