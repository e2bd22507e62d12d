"""Which motions keep robots apart for ever, each robot deciding for itself: a reciprocal barrier.

The barrier is as of Squires, Pierpaoli and Egerstedt (2018): two robots are safe while, if both gave up their
ways now (braked, or circled), they would stay D apart at every instant t from then on. How two robots share
the responsibility is derived here. Let b_i(t) be where i will be if it halts now, f_i(t) if it goes straight
on for one tick and halts then, and p_i(t) if it does what is being asked about. It may if at every t,
against every other j,

    (a)  |p_i(t) - x| >= D for all x between b_j(t) and f_j(t), and
    (b)  p_i(t) lies between b_i(t) and f_i(t), or n(t) (p_i(t) - b_i(t)) >= -(|b_i(t) - b_j(t)| - D) / 2,

n(t) being the direction from b_j(t) to b_i(t). Two robots that move between halting and going straight on are
safe by (a); if one of them swerves, by its (a); if both swerve, by (b): each gives away no more than half of
what is left between them. So the barrier holds after the tick, and halting is always allowed. Crossing
traffic that misses by D is left alone.

What is known of j is old: b_j begins at its last pose, f_j goes straight on from there until after the tick,
D is larger by an uncertainty that grows with the pose's age, and the half in (b) is only that part of a half
that the tick is of tick and age: what is left must last for all decisions based on one pose.
"""

import math

import numpy as np

from estimator.arrays import BoolArray, FloatArray
from estimator.kernels import exact_kernel
from planner.avoidance.halt import ahead, halted

BESIDE = 0.1  # m off the way between halting and going on that still counts as on it
SLIP = 0.01  # m: two computations of one way differ
TINY = 1e-5  # m, of robots that are too near


@exact_kernel
def allowed(
    own: FloatArray,
    asked: FloatArray,
    others: FloatArray,
    ages: FloatArray,
    apart: FloatArray,
    tick: float,
    step: float,
    count: int,
) -> tuple[BoolArray, FloatArray]:
    """Which of c motions a robot may take for the next tick.

    Args:
        own: (COLUMNS,) its motion now.
        asked: (c, COLUMNS) its motion after the tick, for each of those asked about.
        others: (j, COLUMNS) motions of the others at their last poses.
        ages: (j,) seconds since then.
        apart: (j,) metres to keep from each, uncertainty included.
        tick: seconds.
        step, count: the ways are compared at `count` instants `step` seconds apart, from the tick on.

    Returns:
        (c,) whether each may be taken, and (c,) the least distance in metres on each of these ways.
    """
    c, j = asked.shape[0], others.shape[0]
    fine = np.ones(c, dtype=np.bool_)
    swerves = np.zeros(c, dtype=np.bool_)
    gives_way = np.ones(c, dtype=np.bool_)  # keeps (b)'s second half
    least = np.full(c, np.inf)
    on = ahead(own, tick)
    others_on = np.empty_like(others)
    for q in range(j):
        others_on[q] = ahead(others[q], ages[q] + tick)
    b, f, theirs, further, away = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    ways = np.empty((c, 3))
    for k in range(count):
        t = k * step
        halted(own, tick + t, b)
        halted(on, t, f)
        for i in range(c):
            halted(asked[i], t, ways[i])
            if not swerves[i] and _off(ways[i], b, f) > BESIDE:
                swerves[i] = True
        for q in range(j):
            halted(others[q], ages[q] + tick + t, theirs)
            halted(others_on[q], t, further)
            share = _nearest(b, theirs, further)
            square = 0.0
            for axis in range(3):
                away[axis] = b[axis] - theirs[axis] - share * (further[axis] - theirs[axis])
                square += away[axis] ** 2
            gap = math.sqrt(square)
            # Robots that are too near already come no nearer; not even by rounding, tick after tick.
            need = apart[q] - SLIP if gap > apart[q] else gap - TINY
            # Going on, the other may cover where this robot halts, and then nothing is asked of it: against
            # the other halting there is always something to ask.
            if_both_halt = _off(b, theirs, theirs)
            braked = apart[q] - SLIP if if_both_halt > apart[q] else if_both_halt - TINY
            most = 0.5 * tick / (tick + ages[q]) * (gap - apart[q]) + SLIP if gap > apart[q] else TINY
            for i in range(c):
                distance = _off(ways[i], theirs, further)
                least[i] = min(least[i], distance)
                if distance < need or _off(ways[i], theirs, theirs) < braked:
                    fine[i] = False
                toward = 0.0
                for axis in range(3):
                    toward -= away[axis] * (ways[i, axis] - b[axis])
                if toward > most * max(gap, 1e-9):
                    gives_way[i] = False
    for i in range(c):
        fine[i] = fine[i] and (gives_way[i] or not swerves[i])
    return fine, least


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
