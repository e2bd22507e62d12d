"""Gaussian densities of one range-bearing(-elevation) measurement at many points, (MA)ASI (10)."""

import numpy as np

from estimator.arrays import FloatArray, IndexArray, IntArray
from estimator.kernels import exp_negative, kernel

BLOCK = 512  # points worked on at once, so that their numbers stay in the fastest cache
_SMALL = 0.25  # radians up to which the arcsine's series below is good to 1e-11


@kernel
def _arcsine(s: float) -> float:
    """arcsin(s) for |s| <= 0.25."""
    q = s * s
    tail = 35.0 / 1152.0 + q * (63.0 / 2816.0 + q * (231.0 / 13312.0 + q * (143.0 / 10240.0)))
    return s * (1.0 + q * (1.0 / 6.0 + q * (3.0 / 40.0 + q * (5.0 / 112.0 + q * tail))))


@kernel
def own_likelihoods(
    points: FloatArray,
    pose: FloatArray,
    measurements: FloatArray,
    owners: IntArray,
    sigmas: FloatArray,
    gate: float,
) -> tuple[FloatArray, bool]:
    """The likelihood (n,) of each point (d, n) under one measurement, that of row `owners` (n,).

    0 outside the gate. Runs of one owner are worked on together.
    """
    n = points.shape[1]
    out, block = np.empty(n), np.empty(BLOCK, np.uint32)
    buffer, density = np.empty((5, BLOCK)), np.empty(BLOCK)
    begin, total = 0, 0.0
    while begin < n:
        end = begin + 1
        while end < n and end - begin < BLOCK and owners[end] == owners[begin]:
            end += 1
        for k in range(begin, end):
            block[k - begin] = k
            for a in range(points.shape[0]):
                total += points[a, k]
        some, z = block[: end - begin], measurements[owners[begin]]
        if points.shape[0] == 3:
            densities_3d(points, pose, some, z, sigmas, gate, buffer, density)
        else:
            densities_2d(points, pose, some, z, sigmas, gate, buffer, density)
        for k in range(begin, end):
            out[k] = density[k - begin]
        begin = end
    return out, np.isfinite(total)


@kernel
def densities_2d(
    points: FloatArray,
    pose: FloatArray,
    block: IndexArray,
    z: FloatArray,
    sigmas: FloatArray,
    gate: float,
    buffer: FloatArray,
    density: FloatArray,
) -> None:
    """Gaussian densities of measurement z (2,) at the points in `block`, 0 outside the gate.

    One loop that fetches, and loops that compute and that the compiler can do four wide.
    """
    px, py, x, y = points[0], points[1], pose[0], pose[1]
    off, ahead, aside = buffer[0], buffer[1], buffer[2]
    cosine, sine = np.cos(z[1]), np.sin(z[1])
    for k in range(block.size):
        ahead[k], aside[k] = px[block[k]], py[block[k]]
    for k in range(block.size):
        dx, dy = ahead[k] - x, aside[k] - y
        r = np.sqrt(dx * dx + dy * dy)
        dx = dx if r > 0.0 else 1.0
        inverse = 1.0 / (r if r > 0.0 else 1.0)
        off[k] = r - z[0]
        ahead[k] = (cosine * dx + sine * dy) * inverse
        aside[k] = (cosine * dy - sine * dx) * inverse
    width, half = gate * sigmas[0], gate * sigmas[1]
    limit = np.sin(min(half, 1.0))
    weight_r, weight_b = 0.5 / sigmas[0] ** 2, 0.5 / sigmas[1] ** 2
    norm = 1.0 / (2.0 * np.pi * sigmas[0] * sigmas[1])
    if half <= _SMALL:
        for k in range(block.size):
            turn = _arcsine(aside[k])
            value = norm * exp_negative(-(weight_r * off[k] * off[k] + weight_b * turn * turn))
            inside = (abs(off[k]) <= width) & (ahead[k] > 0.0) & (abs(aside[k]) <= limit)
            density[k] = value if inside else 0.0
    else:
        for k in range(block.size):
            turn = np.arctan2(aside[k], ahead[k])
            value = norm * exp_negative(-(weight_r * off[k] * off[k] + weight_b * turn * turn))
            density[k] = value if (abs(off[k]) <= width) & (abs(turn) <= half) else 0.0


@kernel
def densities_3d(
    points: FloatArray,
    pose: FloatArray,
    block: IndexArray,
    z: FloatArray,
    sigmas: FloatArray,
    gate: float,
    buffer: FloatArray,
    density: FloatArray,
) -> None:
    """As `densities_2d`, with the elevation."""
    px, py, pz = points[0], points[1], points[2]
    off, ahead, aside, along, rise = buffer[0], buffer[1], buffer[2], buffer[3], buffer[4]
    width, half, up_half = gate * sigmas[0], gate * sigmas[1], gate * sigmas[2]
    narrow = half <= _SMALL and up_half <= _SMALL
    cosine, sine = np.cos(z[1]), np.sin(z[1])
    # wide gates: `rise` and `along` are of the elevation itself, which does not wrap
    up_cosine, up_sine = (np.cos(z[2]), np.sin(z[2])) if narrow else (1.0, 0.0)
    for k in range(block.size):
        off[k], ahead[k], aside[k] = px[block[k]], py[block[k]], pz[block[k]]
    for k in range(block.size):
        dx, dy, dz = off[k] - pose[0], ahead[k] - pose[1], aside[k] - pose[2]
        level2 = dx * dx + dy * dy
        level, r = np.sqrt(level2), np.sqrt(level2 + dz * dz)
        above, on = level == 0.0, r == 0.0
        dx = 1.0 if above else dx
        inverse, up_inverse = 1.0 / (1.0 if above else level), 1.0 / (1.0 if on else r)
        ce, se = (1.0 if on else level) * up_inverse, dz * up_inverse
        off[k] = r - z[0]
        ahead[k] = (cosine * dx + sine * dy) * inverse
        aside[k] = (cosine * dy - sine * dx) * inverse
        along[k] = ce * up_cosine + se * up_sine
        rise[k] = se * up_cosine - ce * up_sine
    limit, up_limit = np.sin(min(half, 1.0)), np.sin(min(up_half, 1.0))
    weight_r, weight_b, weight_e = 0.5 / sigmas[0] ** 2, 0.5 / sigmas[1] ** 2, 0.5 / sigmas[2] ** 2
    norm = 1.0 / ((2.0 * np.pi) ** 1.5 * sigmas[0] * sigmas[1] * sigmas[2])
    if narrow:
        for k in range(block.size):
            turn, climb = _arcsine(aside[k]), _arcsine(rise[k])
            exponent = weight_r * off[k] * off[k] + weight_b * turn * turn + weight_e * climb * climb
            value = norm * exp_negative(-exponent)
            inside = (abs(off[k]) <= width) & (ahead[k] > 0.0) & (abs(aside[k]) <= limit)
            inside = inside & (along[k] > 0.0) & (abs(rise[k]) <= up_limit)
            density[k] = value if inside else 0.0
    else:
        for k in range(block.size):
            turn = np.arctan2(aside[k], ahead[k])
            climb = np.arctan2(rise[k], along[k]) - z[2]
            exponent = weight_r * off[k] * off[k] + weight_b * turn * turn + weight_e * climb * climb
            value = norm * exp_negative(-exponent)
            inside = (abs(off[k]) <= width) & (abs(turn) <= half) & (abs(climb) <= up_half)
            density[k] = value if inside else 0.0
