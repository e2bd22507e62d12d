"""Interpolation and integrals on a grid."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from estimator.grid import interpolate, node_volumes, nodes


@pytest.mark.parametrize("shape", [(5, 7), (4, 5, 6), (2, 2), (3, 1)])
def test_interpolation_agrees_with_scipy(shape: tuple[int, ...]) -> None:
    d, rng = len(shape), np.random.default_rng(1)
    low, high = np.full(d, -2.0), np.arange(3.0, 3.0 + d)
    values, points = rng.random(shape), rng.uniform(-2.0, 3.0, (d, 200))
    ours = interpolate(values, low, high, points)
    if 1 in shape:
        assert np.allclose(ours, interpolate(values[:, :1].repeat(2, 1), low, high, points))
        return
    axes = [np.linspace(low[i], high[i], shape[i]) for i in range(d)]
    assert np.allclose(ours, RegularGridInterpolator(axes, values)(points.T), rtol=1e-12)


def test_interpolation_at_a_node_is_its_value() -> None:
    values = np.arange(24.0).reshape(2, 3, 4)
    low, high = np.zeros(3), np.array([1.0, 2.0, 3.0])
    assert np.allclose(interpolate(values, low, high, nodes((2, 3, 4), low, high)), values.ravel())


def test_outside_the_box_the_nearest_point_of_the_box_counts() -> None:
    values = np.array([[0.0, 1.0], [2.0, 3.0]])
    outside = np.array([[-5.0, 9.0, 0.5], [-5.0, 9.0, 9.0]])
    assert np.allclose(interpolate(values, np.zeros(2), np.ones(2), outside), [0.0, 3.0, 2.0])


def test_nan_positions_give_nan_and_touch_no_memory() -> None:
    point = np.array([[np.nan], [0.5]])
    assert np.isnan(interpolate(np.ones((3, 3)), np.zeros(2), np.ones(2), point)).all()


def test_node_volumes_integrate_the_interpolant_exactly() -> None:
    low, high, shape = np.zeros(2), np.array([2.0, 3.0]), (5, 4)
    x, y = nodes(shape, low, high)
    integral = np.sum((1.0 + 2.0 * x + 3.0 * y) * node_volumes(shape, low, high).ravel())
    assert integral == pytest.approx(6.0 + 2.0 * 6.0 + 3.0 * 9.0)


def test_a_point_set_of_another_dimension_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="points"):
        interpolate(np.ones((3, 3)), np.zeros(2), np.ones(2), np.zeros((3, 4)))
