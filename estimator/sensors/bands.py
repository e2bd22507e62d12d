"""Likelihoods under Gaussian noise at the few points that each measurement can touch.

Points are sorted into bands of the first number of a measurement (a bearing, a range, an x), so that those
inside a measurement's gate lie next to each other in memory. Unlike `estimator.sensors.gating`, which cuts
range and direction at once, this serves any sensor whose noiseless measurement can be computed.
"""

from math import pi

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import exp_negative, kernel

GATE_SIGMAS = 6.0  # a component further off than this has likelihood 0; 2e-9 of the Gaussian lies beyond
_BANDS = 256
_BLOCK = 512  # points worked on at once, so that their numbers stay in the fastest cache
_OUTSIDE = 1e6  # added to the exponent of what lies outside the gate


@kernel
def arctangent(y: float, x: float) -> float:
    """arctan2(y, x) to 1e-14, 0 at the origin; loops of it become vector instructions."""
    across, along = abs(y), abs(x)
    small, big = min(across, along), max(across, along)
    far = small > 0.41421356237309503 * big  # tan(pi / 8)
    t = ((small - big) if far else small) / ((small + big if far else big) + 1e-300)
    q = t * t
    p = 1.0 / 33.0
    p = 1.0 / 31.0 - q * p
    p = 1.0 / 29.0 - q * p
    p = 1.0 / 27.0 - q * p
    p = 1.0 / 25.0 - q * p
    p = 1.0 / 23.0 - q * p
    p = 1.0 / 21.0 - q * p
    p = 1.0 / 19.0 - q * p
    p = 1.0 / 17.0 - q * p
    p = 1.0 / 15.0 - q * p
    p = 1.0 / 13.0 - q * p
    p = 1.0 / 11.0 - q * p
    p = 1.0 / 9.0 - q * p
    p = 1.0 / 7.0 - q * p
    p = 1.0 / 5.0 - q * p
    p = 1.0 / 3.0 - q * p
    angle = t * (1.0 - q * p) + (0.25 * pi if far else 0.0)
    angle = 0.5 * pi - angle if across > along else angle
    angle = pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@kernel
def gated_gaussian(
    coordinates: FloatArray,
    kept: IntArray,
    measurements: FloatArray,
    sigmas: FloatArray,
    gate: float,
    circular: bool,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Compressed rows (offsets (m + 1,), indices, likelihood) of N(z; coordinates, sigmas^2).

    coordinates (s, k) are the noiseless measurements of the points with the numbers kept (k,), measurements
    are (m, s), sigmas (s,). Rows hold what is within `gate` sigmas in every component. `circular`: the first
    component is an angle in radians, in the coordinates within -pi..pi.
    """
    m = measurements.shape[0]
    low, high = -pi, pi
    if not circular:
        low, high = np.inf, -np.inf
        for j in range(m):
            low, high = min(low, measurements[j, 0]), max(high, measurements[j, 0])
        low, high = low - gate * sigmas[0], high + gate * sigmas[0]
    scale = _BANDS / (high - low) if m > 0 else 0.0
    starts, order = _by_band(coordinates[0], low if m > 0 else 0.0, scale)
    ordered = np.empty((coordinates.shape[0], order.size))
    for a in range(coordinates.shape[0]):
        for i in range(order.size):
            ordered[a, i] = coordinates[a, order[i]]
    parts = np.empty((m, 4), np.int64)  # two stretches of `ordered` for each measurement
    total = 0
    for j in range(m):
        _stretches(measurements[j, 0], gate * sigmas[0], low, scale, circular, starts, parts[j])
        total += parts[j, 1] - parts[j, 0] + parts[j, 3] - parts[j, 2]
    offsets = np.zeros(m + 1, np.int64)
    indices, likelihood = np.empty(total, np.int64), np.empty(total)
    exponent, density = np.empty(_BLOCK), np.empty(_BLOCK)
    count = 0
    for j in range(m):
        for part in range(0, 4, 2):
            for begin in range(parts[j, part], parts[j, part + 1], _BLOCK):
                size = min(_BLOCK, parts[j, part + 1] - begin)
                block = ordered[:, begin : begin + size]
                _densities(block, measurements[j], sigmas, gate, circular, exponent, density)
                for i in range(size):
                    indices[count] = kept[order[begin + i]]
                    likelihood[count] = density[i]
                    count += density[i] > 0.0
        offsets[j + 1] = count
    return offsets, indices[:count], likelihood[:count]


@kernel
def _by_band(values: FloatArray, low: float, scale: float) -> tuple[IntArray, IntArray]:
    """Offsets (bands + 1,) and the numbers of the values, band by band; those outside are left out."""
    bands = np.empty(values.size, np.int32)
    starts = np.zeros(_BANDS + 2, np.int64)
    for i in range(values.size):
        x = (values[i] - low) * scale
        bands[i] = min(int(x), _BANDS - 1) if 0.0 <= x <= _BANDS else _BANDS
        starts[bands[i] + 1] += 1
    for b in range(_BANDS + 1):
        starts[b + 1] += starts[b]
    filled = starts[: _BANDS + 1].copy()
    order = np.empty(values.size, np.int64)
    for i in range(values.size):
        order[filled[bands[i]]] = i
        filled[bands[i]] += 1
    return starts[: _BANDS + 1], order[: starts[_BANDS]]


@kernel
def _stretches(
    z: float, width: float, low: float, scale: float, circular: bool, starts: IntArray, out: IntArray
) -> None:
    """Two stretches [from, to) of sorted points (out (4,)) that hold all within `width` of z."""
    if circular:
        z -= 2.0 * pi * np.floor(z / (2.0 * pi) + 0.5)
    first = int(np.floor((z - width - low) * scale)) - 1  # one more, for rounding
    last = int(np.floor((z + width - low) * scale)) + 1
    if circular and last - first >= _BANDS - 1:
        first, last = 0, _BANDS - 1
    out[0], out[1] = starts[max(first, 0)], starts[min(last, _BANDS - 1) + 1]
    out[2], out[3] = 0, 0
    if circular and first < 0:
        out[2], out[3] = starts[first + _BANDS], starts[_BANDS]
    elif circular and last >= _BANDS:
        out[2], out[3] = 0, starts[last - _BANDS + 1]


@kernel
def _densities(
    block: FloatArray,
    z: FloatArray,
    sigmas: FloatArray,
    gate: float,
    circular: bool,
    exponent: FloatArray,
    density: FloatArray,
) -> None:
    """Gaussian densities of measurement z (s,) at coordinates (s, b), 0 outside the gate."""
    size = block.shape[1]
    norm = 1.0
    for a in range(block.shape[0]):
        row, width, weight, at = block[a], gate * sigmas[a], 0.5 / (sigmas[a] * sigmas[a]), z[a]
        norm /= np.sqrt(2.0 * pi) * sigmas[a]
        if a == 0 and circular:
            for i in range(size):
                off = row[i] - at
                off -= 2.0 * pi * np.floor(off * (0.5 / pi) + 0.5)
                exponent[i] = weight * off * off + (0.0 if abs(off) <= width else _OUTSIDE)
        elif a == 0:
            for i in range(size):
                off = row[i] - at
                exponent[i] = weight * off * off + (0.0 if abs(off) <= width else _OUTSIDE)
        else:
            for i in range(size):
                off = row[i] - at
                exponent[i] += weight * off * off + (0.0 if abs(off) <= width else _OUTSIDE)
    for i in range(size):
        value = norm * exp_negative(-exponent[i])
        density[i] = value if exponent[i] < _OUTSIDE else 0.0
