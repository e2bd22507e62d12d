"""Cardinality errors of a case computed by hand."""

import numpy as np
import pytest

from estimator.metrics.cardinality import cardinality_error


def test_errors_of_a_case_computed_by_hand() -> None:
    error = cardinality_error(np.array([3.0, 3.0, 4.0]), np.array([2.0, 3.5, 6.0]))
    assert error.bias == pytest.approx(0.5)
    assert error.absolute == pytest.approx(3.5 / 3)
    assert error.rms == pytest.approx(np.sqrt((1 + 0.25 + 4) / 3))
    assert error.worst == 2.0


@pytest.mark.parametrize("estimated", [np.zeros(0), np.zeros(3), np.array([np.nan, 1.0])])
def test_bad_input_is_refused_by_name(estimated: np.ndarray) -> None:
    with pytest.raises(ValueError, match="estimated"):
        cardinality_error(np.zeros(2), estimated)
