"""Which motions keep robots apart for ever, each robot deciding for itself: a reciprocal barrier.

The barrier is as of Squires, Pierpaoli and Egerstedt (2018): two robots are safe while, if both gave up their
ways now (braked, or circled), they would stay D apart at every instant t from then on. How two robots share
the responsibility is derived here. Let b_i(t) be where i will be if it halts now, f_i(t) if it goes straight
on for one tick and halts then, and p_i(t) if it does what is being asked about. It may if at every t,
against every other j and for every place x between b_j(t) and f_j(t) to which j may go,

    (a)  |p_i(t) - x| >= D, and
    (b)  p_i(t) lies between b_i(t) and f_i(t), or (b_i(t) - x) (p_i(t) - b_i(t)) >= -|b_i(t) - x| g / 2,

with g = |b_i(t) - x| - D. By (a) of its own, j may not go to places nearer than D to b_i(t), b_j(t) itself
excepted. Two robots that move between halting and going straight on are safe by (a); if one of them swerves,
by its (a); if both swerve, by (b): each gives away no more than half of what is left between them. So the
barrier holds after the tick, and halting is always allowed. Crossing traffic that misses by D is left alone.

What is known of j is old: b_j begins at its last pose, f_j goes straight on from there until after the tick,
and D is larger by how far j may have swerved since: half its acceleration times the square of the age.
"""

import math

import numpy as np

from estimator.arrays import BoolArray, FloatArray
from estimator.kernels import exact_kernel
from planner.avoidance.halt import going_on, halted, settling

BESIDE = 0.02  # of the way of a tick, beside that between halting and going on, which still counts as on it
SLIP = 1e-4  # of what is to be kept: two computations of one way differ
TINY = 1e-5  # m, of robots that are too near
PLACES = 5  # between halting and going on, at which another robot may be
FINE_S = 0.05  # between instants at which ways are compared where it is close
LOOKS = 12  # at a robot's own way, to see whether it swerves
ROUNDS = 4.0  # of two circles that take different times, which are compared


@exact_kernel
def allowed(
    own: FloatArray,
    asked: FloatArray,
    others: FloatArray,
    ages: FloatArray,
    apart: FloatArray,
    base: FloatArray,
    tick: float,
) -> tuple[BoolArray, FloatArray]:
    """Which of c motions a robot may take for the next tick.

    Args:
        own: (COLUMNS,) its motion now.
        asked: (c, COLUMNS) its motion after the tick, for each of those asked about.
        others: (j, COLUMNS) motions of the others at their last poses.
        ages: (j,) seconds since then.
        apart, base: (j,) metres to keep from each, with what is uncertain of it and without.
        tick: seconds.

    Returns:
        (c,) whether each may be taken, and (c,) the distance in metres, on each of these ways, at which the
        asking ended: the least one where it is small, a lower bound of it where that is enough.
    """
    c, j = asked.shape[0], others.shape[0]
    fine = np.ones(c, dtype=np.bool_)
    least = np.full(c, np.inf)
    on = going_on(own, tick)
    others_on = np.empty_like(others)
    for q in range(j):
        others_on[q] = going_on(others[q], ages[q] + tick)
    for i in range(c):
        swerves = _swerves(own, on, asked[i], tick)
        for q in range(j):
            fine_here, near = _keeps(
                own, asked[i], others[q], others_on[q], ages[q], apart[q], base[q], tick, swerves
            )
            least[i] = min(least[i], near)
            fine[i] = fine[i] and fine_here
    return fine, least


@exact_kernel
def _swerves(own: FloatArray, on: FloatArray, asked: FloatArray, tick: float) -> bool:
    """Whether the way asked about leaves what lies between halting now and after a tick of going on."""
    b, f, way = np.empty(3), np.empty(3), np.empty(3)
    horizon = max(settling(own), settling(asked))
    beside = BESIDE * tick * max(_speed(own), _speed(asked))
    for k in range(LOOKS):
        t = k * horizon / (LOOKS - 1)
        halted(own, tick + t, b)
        halted(on, t, f)
        halted(asked, t, way)
        if _off(way, b, f) > beside:
            return True
    return False


@exact_kernel
def _keeps(
    own: FloatArray,
    asked: FloatArray,
    other: FloatArray,
    other_on: FloatArray,
    age: float,
    apart: float,
    base: float,
    tick: float,
    swerves: bool,
) -> tuple[bool, float]:
    """(a) and, of a way that swerves, (b) against one other.

    From every instant it goes on to the first at which, by the speeds, anything could be violated.
    """
    b, way, theirs, further = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    horizon = max(settling(own), settling(asked), settling(other), settling(other_on))
    if asked[12] > 0.0 and other[12] > 0.0 and abs(asked[12] - other[12]) > 1e-9 * asked[12]:
        horizon *= ROUNDS
    v_own, v_way = _speed(own), _speed(asked)
    v_other = max(_speed(other), _speed(other_on))
    slip = SLIP * apart
    least = np.inf
    t = 0.0
    while True:
        halted(own, tick + t, b)
        halted(asked, t, way)
        halted(other, age + tick + t, theirs)
        halted(other_on, t, further)
        wait = np.inf
        nearest = _nearest(way, theirs, further)
        for k in range(PLACES + 1):
            share = k / (PLACES - 1) if k < PLACES else nearest
            gap2, distance2, toward, beside2 = 0.0, 0.0, 0.0, 0.0
            for axis in range(3):
                x = theirs[axis] + share * (further[axis] - theirs[axis])
                swerve = way[axis] - b[axis]
                gap2 += (b[axis] - x) ** 2
                distance2 += (way[axis] - x) ** 2
                toward -= (b[axis] - x) * swerve
                beside2 += swerve * swerve
            gap, distance = math.sqrt(gap2), math.sqrt(distance2)
            if gap < base and share > 0.0:
                # The other may not go on to here, since this robot may halt there. What it may can change.
                wait = 0.0
                continue
            least = min(least, distance)
            # Robots that are too near already come no nearer; not even by rounding, tick after tick.
            if distance < (apart - slip if gap > apart else gap - TINY):
                return False, least
            wait = min(wait, (min(distance, gap) - apart) / max(max(v_way, v_own) + v_other, 1e-9))
            if swerves:
                give = 0.5 * max(gap - apart, 0.0)
                if toward > (give + slip) * gap:
                    return False, least
                wait = min(wait, (give - math.sqrt(beside2)) / max(1.5 * v_own + 0.5 * v_other + v_way, 1e-9))
        if t >= horizon:
            return True, least
        t = min(t + max(wait, FINE_S), horizon)


@exact_kernel
def _speed(row: FloatArray) -> float:
    """The most speed of a vehicle with this motion while it halts."""
    now = row[3] * row[3] + row[4] * row[4] + row[5] * row[5]
    aim = row[6] * row[6] + row[7] * row[7] + row[8] * row[8]
    return math.sqrt(max(now, aim))


@exact_kernel
def _nearest(x: FloatArray, a: FloatArray, b: FloatArray) -> float:
    """Which share of the way from a to b is nearest to x."""
    along, length = 0.0, 0.0
    for axis in range(3):
        along += (x[axis] - a[axis]) * (b[axis] - a[axis])
        length += (b[axis] - a[axis]) ** 2
    return min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0


@exact_kernel
def _off(x: FloatArray, a: FloatArray, b: FloatArray) -> float:
    """Metres from x to the way from a to b."""
    share = _nearest(x, a, b)
    square = 0.0
    for axis in range(3):
        square += (x[axis] - a[axis] - share * (b[axis] - a[axis])) ** 2
    return math.sqrt(square)
