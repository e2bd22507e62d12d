"""The vectorised exponential."""

import math

import numpy as np
import pytest

from estimator.kernels import exp_negative


@pytest.mark.parametrize("x", [0.0, -1e-12, -0.3, -1.0, -18.0, -54.0, -100.0])
def test_exponential_agrees_with_the_librarys_to_eleven_digits(x: float) -> None:
    assert exp_negative(x) == pytest.approx(math.exp(x), rel=1e-11)


def test_exponential_of_far_below_stays_positive_and_tiny() -> None:
    assert 0.0 < exp_negative(-1e9) < 1e-300


def test_exponential_of_nan_is_nan() -> None:
    assert np.isnan(exp_negative(math.nan))
