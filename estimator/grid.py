"""Functions of position held on a regular grid over a box: nodes, integral, multilinear interpolation."""

from functools import lru_cache

import numpy as np

from estimator.arrays import FloatArray
from estimator.kernels import kernel

Shape = tuple[int, ...]


@lru_cache(maxsize=64)
def _nodes(shape: Shape, low: tuple[float, ...], high: tuple[float, ...]) -> FloatArray:
    axes = [np.linspace(low[i], high[i], shape[i]) for i in range(len(shape))]
    points = np.ascontiguousarray(np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")]))
    points.flags.writeable = False
    return points


def nodes(shape: Shape, low: FloatArray, high: FloatArray) -> FloatArray:
    """The grid's nodes (d, g1 * ... * gd), last axis fastest, like `values.ravel()`. Read-only, shared."""
    return _nodes(tuple(shape), tuple(low.tolist()), tuple(high.tolist()))


@lru_cache(maxsize=64)
def _node_volumes(shape: Shape, low: tuple[float, ...], high: tuple[float, ...]) -> FloatArray:
    volumes = np.ones(())
    for i, count in enumerate(shape):
        width = np.full(count, (high[i] - low[i]) / max(count - 1, 1))
        if count > 1:
            width[[0, -1]] /= 2
        volumes = np.multiply.outer(volumes, width)
    volumes = np.ascontiguousarray(volumes)
    volumes.flags.writeable = False
    return volumes


def node_volumes(shape: Shape, low: FloatArray, high: FloatArray) -> FloatArray:
    """What each node counts for in the integral of the interpolant, m^d, shape `shape`. Read-only, shared."""
    return _node_volumes(tuple(shape), tuple(low.tolist()), tuple(high.tolist()))


def interpolate(values: FloatArray, low: FloatArray, high: FloatArray, points: FloatArray) -> FloatArray:
    """Multilinear interpolation (n,) of values (g1, ..., gd) on the box low..high at points (d, n).

    Outside the box the value of the nearest point of the box is taken.

    Raises:
        ValueError: if the dimensions do not match or are not 2 or 3.
    """
    if values.ndim not in (2, 3) or points.ndim != 2 or points.shape[0] != values.ndim:
        raise ValueError(f"points: expected shape ({values.ndim}, n) with 2 or 3 rows, got {points.shape}")
    out = np.empty(points.shape[1])
    if values.ndim == 2:
        interpolate_2d(values, low, high, points, out)
    else:
        interpolate_3d(values, low, high, points, out)
    return out


@kernel
def _cell(x: float, low: float, high: float, count: int) -> tuple[int, float]:
    """Index of the node below x and the fraction of the way to the next."""
    if count < 2 or not high > low:
        return 0, 0.0
    u = (x - low) / (high - low) * (count - 1)
    u = min(max(u, 0.0), count - 1.0)
    i = min(int(u), count - 2)
    return i, u - i


@kernel
def interpolate_2d(
    values: FloatArray, low: FloatArray, high: FloatArray, points: FloatArray, out: FloatArray
) -> None:
    """Bilinear values at points (2, n) into out (n,). NaN where a coordinate is NaN."""
    g0, g1 = values.shape
    for k in range(points.shape[1]):
        x, y = points[0, k], points[1, k]
        if np.isnan(x) or np.isnan(y):
            out[k] = np.nan
            continue
        i, a = _cell(x, low[0], high[0], g0)
        j, b = _cell(y, low[1], high[1], g1)
        i1, j1 = min(i + 1, g0 - 1), min(j + 1, g1 - 1)
        below = values[i, j] * (1.0 - b) + values[i, j1] * b
        above = values[i1, j] * (1.0 - b) + values[i1, j1] * b
        out[k] = below * (1.0 - a) + above * a


@kernel
def interpolate_3d(
    values: FloatArray, low: FloatArray, high: FloatArray, points: FloatArray, out: FloatArray
) -> None:
    """Trilinear values at points (3, n) into out (n,). NaN where a coordinate is NaN."""
    g0, g1, g2 = values.shape
    for k in range(points.shape[1]):
        x, y, z = points[0, k], points[1, k], points[2, k]
        if np.isnan(x) or np.isnan(y) or np.isnan(z):
            out[k] = np.nan
            continue
        i, a = _cell(x, low[0], high[0], g0)
        j, b = _cell(y, low[1], high[1], g1)
        l, c = _cell(z, low[2], high[2], g2)
        i1, j1, l1 = min(i + 1, g0 - 1), min(j + 1, g1 - 1), min(l + 1, g2 - 1)
        v00 = values[i, j, l] * (1.0 - c) + values[i, j, l1] * c
        v01 = values[i, j1, l] * (1.0 - c) + values[i, j1, l1] * c
        v10 = values[i1, j, l] * (1.0 - c) + values[i1, j, l1] * c
        v11 = values[i1, j1, l] * (1.0 - c) + values[i1, j1, l1] * c
        out[k] = (v00 * (1.0 - b) + v01 * b) * (1.0 - a) + (v10 * (1.0 - b) + v11 * b) * a
