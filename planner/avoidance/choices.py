"""Ways out: velocities to choose among, and how dear each is.

A velocity is the dearer the further it is from the one wanted and the sooner it would meet somebody, who is
expected to do half of what is needed (van den Berg, Lin and Manocha 2008, reciprocal velocity obstacles), or
nothing if he stands. All turn to the right a little more gladly than to the left, so that two that meet
head-on, or twenty on a ring, do not wait for each other.
"""

import math

import numpy as np

from estimator.arrays import FloatArray
from estimator.kernels import exact_kernel

RIGHT = (15.0, 30.0, 50.0, 70.0, 90.0, 115.0, 145.0)  # degrees from the way wanted, and as many to the left
SHARES = (1.0, 0.6, 0.25)  # of the speed
TILTS = (0.0, 40.0, -40.0, 80.0, -80.0)
LEFT = 0.1  # how much dearer a way is that goes a quarter turn to the left
HASTE = 1.0  # how dear it is to meet somebody after a second
STANDS = 0.1  # share of its own speed below which another robot is taken to stand


def directions(*, level: bool) -> FloatArray:
    """(k, 3) directions about east, as unit vectors; with `level` in the plane alone."""
    rows = []
    for angle in (0.0, *(side * turn for turn in RIGHT for side in (1.0, -1.0)), 180.0):
        for tilt in (0.0,) if level or abs(angle) > 90.0 else TILTS:
            a, e = math.radians(angle), math.radians(tilt)
            rows.append([math.cos(a) * math.cos(e), -math.sin(a) * math.cos(e), math.sin(e)])
    return np.array(rows)


@exact_kernel
def fan(directions: FloatArray, wanted: FloatArray, speed: float, shares: FloatArray) -> FloatArray:
    """(k s, 3) velocities at s shares of a speed: directions (k, 3), turned so that east is `wanted` (3,)."""
    level = math.hypot(wanted[0], wanted[1])
    length = max(math.hypot(level, wanted[2]), 1e-12)
    if level > 1e-9 * length:
        c, s = wanted[0] / level, wanted[1] / level
    else:
        c, s = 1.0, 0.0
    ce, se = level / length, wanted[2] / length
    out = np.empty((directions.shape[0] * shares.size, 3))
    for k in range(directions.shape[0]):
        x, y, z = directions[k, 0], directions[k, 1], directions[k, 2]
        x, z = ce * x - se * z, se * x + ce * z
        for i in range(shares.size):
            row = k * shares.size + i
            out[row, 0] = (c * x - s * y) * speed * shares[i]
            out[row, 1] = (s * x + c * y) * speed * shares[i]
            out[row, 2] = z * speed * shares[i]
    return out


@exact_kernel
def soonest(
    velocity: FloatArray, own: FloatArray, others: FloatArray, ages: FloatArray, keeps: FloatArray
) -> float:
    """Seconds until a robot that takes a velocity (3,) now comes within `keeps` (j,) metres of anybody.

    Args:
        own: (COLUMNS,) its motion now.
        others: (j, COLUMNS) motions of the others `ages` (j,) seconds ago.
    """
    least = np.inf
    speed2 = 0.0
    for axis in range(3):
        speed2 += velocity[axis] ** 2
    speed2 = max(speed2, own[3] ** 2 + own[4] ** 2 + own[5] ** 2)
    for q in range(ages.size):
        aim2 = others[q, 6] ** 2 + others[q, 7] ** 2 + others[q, 8] ** 2
        stands = aim2 <= STANDS * STANDS * speed2
        rr, rw, ww = 0.0, 0.0, 0.0
        for axis in range(3):
            theirs = others[q, 6 + axis]
            r = others[q, axis] + theirs * ages[q] - own[axis]
            w = velocity[axis] - theirs if stands else 2.0 * velocity[axis] - own[6 + axis] - theirs
            rr += r * r
            rw += r * w
            ww += w * w
        if rw <= 0.0:
            continue
        inside = rr - keeps[q] * keeps[q]
        if inside <= 0.0:
            least = 0.0
            continue
        root = rw * rw - ww * inside
        if root > 0.0:
            least = min(least, (rw - math.sqrt(root)) / ww)
    return least


@exact_kernel
def prices(
    velocities: FloatArray,
    wanted: FloatArray,
    speed: float,
    own: FloatArray,
    others: FloatArray,
    ages: FloatArray,
    keeps: FloatArray,
    ahead: float,
) -> FloatArray:
    """How dear each of velocities (c, 3) is to a robot that wants another (3,); it looks `ahead` seconds."""
    out = np.empty(velocities.shape[0])
    for i in range(out.size):
        off2, cross = 0.0, wanted[0] * velocities[i, 1] - wanted[1] * velocities[i, 0]
        for axis in range(3):
            off2 += (velocities[i, axis] - wanted[axis]) ** 2
        out[i] = math.sqrt(off2) / speed
        if cross > 0.0:
            out[i] += LEFT * cross / (speed * speed)
        meets = soonest(velocities[i], own, others, ages, keeps)
        if meets < ahead:
            out[i] += HASTE * (1.0 / max(meets, 0.05) - 1.0 / ahead)
    return out
