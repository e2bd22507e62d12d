"""The rounds of CBBA on arrays: all robots build their bundles, then each hears all that it hears.

Two things keep the work small. What all robots believe alike about a task no message changes, so only tasks
that they differ on are looked at. And what a robot's tasks gain on top of the first l of its bundle depends
on these alone, so it is kept for every l, for when the tail is released.

The rounds are run in parts where somebody asks for the time in between, robot by robot; the parts make no
difference to what comes out.
"""

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import exact_kernel
from planner.allocation.auction import DIFFERING, HEARING, ROBOT, ROUND, Auction, Prices
from planner.allocation.consensus import LEAVE, NOBODY, UPDATE, beats, verdict
from planner.allocation.insertion import insertion_gains

RUNNING, CONVERGED, EXHAUSTED = 0, 1, 2  # what `run` says


@exact_kernel
def run(p: Prices, a: Auction, max_rounds: int, most: int) -> int:
    """Rounds until nobody changes anything, or there were `max_rounds`, or `most` work was done.

    Work is counted in bids and words looked at, some nanoseconds each, and after each robot.
    """
    n, t = p.values.shape
    taken = np.empty(t, dtype=np.bool_)
    y_own, z_own = np.empty(t), np.empty(t, dtype=np.int64)
    work = 0
    while a.marks[ROUND] < max_rounds:
        if not a.marks[HEARING]:
            while a.marks[ROBOT] < n:
                i = a.marks[ROBOT]
                if a.stale[i]:
                    if work >= most:
                        return RUNNING
                    work += _build(i, p, a, taken)
                a.marks[ROBOT] += 1
            if not _speak(a):
                return CONVERGED
            work += n * a.marks[DIFFERING]
            a.marks[HEARING], a.marks[ROBOT] = 1, 0
        while a.marks[ROBOT] < n:
            if work >= most:
                return RUNNING
            work += _hear(a.marks[ROBOT], p, a, y_own, z_own)
            a.marks[ROBOT] += 1
        _agree(a)
        a.marks[ROUND] += 1
        a.marks[HEARING], a.marks[ROBOT] = 0, 0
    return EXHAUSTED


@exact_kernel
def _build(i: int, p: Prices, a: Auction, taken: BoolArray) -> int:
    """Robot i bids anew; how much work it was."""
    t, capacity = p.values.shape[1], a.bundles.shape[1]
    bundle, path, y, z = a.bundles[i], a.paths[i], a.y[i], a.z[i]
    a.stale[i] = False
    taken[:] = False
    kind = p.kinds[i]
    ceiling = np.inf
    level, work = 0, 0
    while level < capacity:
        if a.computed[i] < level:
            insertion_gains(
                path,
                level,
                p.values[i],
                p.first[i],
                p.legs[kind],
                p.legs_to[kind],
                p.durations,
                p.first_e[i],
                p.legs_e[kind],
                p.legs_to_e[kind],
                p.durations_e,
                p.fuel,
                p.limits[i],
                p.home[i],
                a.gains[i, level],
                a.places[i, level],
            )
            a.computed[i] = level
            work += t * (level + 1)
        work += t
        best = _best(i, a.gains[i, level], ceiling, y, z, taken)
        if best < 0:
            break
        ceiling = min(a.gains[i, level, best], ceiling)
        if level == a.lengths[i] or bundle[level] != best:
            _shorten(i, level, y, z, bundle, path, a.lengths[i], a.dirty)
            a.computed[i] = level
            at = a.places[i, level, best]
            for m in range(level, at, -1):
                path[m] = path[m - 1]
            path[at] = best
            bundle[level] = best
            a.lengths[i] = level + 1
        if z[best] != i or y[best] != ceiling:
            y[best] = ceiling
            z[best] = i
            a.dirty[best] = True
        _take(p.groups, best, taken)
        level += 1
    if level < a.lengths[i]:
        _shorten(i, level, y, z, bundle, path, a.lengths[i], a.dirty)
        a.computed[i] = min(a.computed[i], level)
        a.lengths[i] = level
    return work


@exact_kernel
def _shorten(
    i: int,
    level: int,
    y: FloatArray,
    z: IntArray,
    bundle: IntArray,
    path: IntArray,
    length: int,
    dirty: BoolArray,
) -> None:
    """Release all but the first `level` tasks of the bundle; the path keeps their order."""
    if level >= length:
        return
    for m in range(level, length):
        j = bundle[m]
        if z[j] == i:
            z[j] = NOBODY
            y[j] = 0.0
            dirty[j] = True
    at = 0
    for m in range(length):
        for q in range(level):
            if bundle[q] == path[m]:
                path[at] = path[m]
                at += 1
                break


@exact_kernel
def _take(groups: IntArray, task: int, taken: BoolArray) -> None:
    """Mark all slots of a task."""
    for j in range(groups.size):
        if groups[j] == groups[task]:
            taken[j] = True


@exact_kernel
def _best(i: int, gains: FloatArray, ceiling: float, y: FloatArray, z: IntArray, taken: BoolArray) -> int:
    """The open task of the highest gain whose bid wins, the first of equals; -1 if there is none."""
    best, best_gain = -1, 0.0
    for j in range(gains.size):
        gain = gains[j]
        if not best_gain < gain < np.inf or taken[j]:
            continue
        if z[j] == i or beats(min(gain, ceiling), i, y[j], z[j]):
            best, best_gain = j, gain
    return best


@exact_kernel
def _speak(a: Auction) -> bool:
    """Note what all robots say of the tasks that they may differ on; whether there are any."""
    n, t = a.y.shape
    count = 0
    for j in range(t):
        if a.dirty[j]:
            a.columns[count] = j
            count += 1
    a.marks[DIFFERING] = count
    if count == 0:
        return False
    a.s_said[:] = a.s
    for k in range(n):
        a.s_said[k, k] = a.marks[ROUND]
        for m in range(count):
            a.y_said[k, m] = a.y[k, a.columns[m]]
            a.z_said[k, m] = a.z[k, a.columns[m]]
    return True


@exact_kernel
def _hear(i: int, p: Prices, a: Auction, y_own: FloatArray, z_own: IntArray) -> int:
    """Robot i hears its neighbours' words, one after another; how much work it was."""
    n, count = a.y.shape[0], a.marks[DIFFERING]
    s_own, columns = a.s[i], a.columns
    for m in range(count):
        y_own[m] = a.y_said[i, m]
        z_own[m] = a.z_said[i, m]
    for edge in range(p.offsets[i], p.offsets[i + 1]):
        k = p.edges[edge]
        z_their, y_their, s_their = a.z_said[k], a.y_said[k], a.s_said[k]
        for m in range(count):
            z_i, z_k = z_own[m], z_their[m]
            y_i, y_k = y_own[m], y_their[m]
            at_i, at_k = max(z_i, 0), max(z_k, 0)
            s_ii, s_ki = s_own[at_i], s_their[at_i]
            void = (z_i < 0) | (z_i == i) | ((z_i != k) & (s_ki <= s_ii))
            if ((z_i == z_k) & (y_i == y_k)) | ((z_k < 0) & void):
                continue  # most words say nothing new; one test that is nearly always true costs little
            s_ik, s_kk = s_own[at_k], s_their[at_k]
            action = verdict(i, k, z_i, y_i, z_k, y_k, s_ii, s_ki, s_ik, s_kk)
            if action == LEAVE:
                continue
            a.stale[i] = True
            if action == UPDATE and z_k != NOBODY:
                y_own[m] = y_k
                z_own[m] = z_k
            else:
                y_own[m] = 0.0
                z_own[m] = NOBODY
        for m in range(n):
            if m != i and s_their[m] > s_own[m]:
                s_own[m] = s_their[m]
    for m in range(count):
        a.y[i, columns[m]] = y_own[m]
        a.z[i, columns[m]] = z_own[m]
    return int((p.offsets[i + 1] - p.offsets[i]) * (count + n) + 2 * count)


@exact_kernel
def _agree(a: Auction) -> None:
    """Forget the tasks that all believe alike by now."""
    for m in range(a.marks[DIFFERING]):
        j = a.columns[m]
        a.dirty[j] = False
        for i in range(1, a.y.shape[0]):
            if a.z[i, j] != a.z[0, j] or a.y[i, j] != a.y[0, j]:
                a.dirty[j] = True
                break
