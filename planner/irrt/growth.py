"""The tree's numeric kernels: which node to extend, how a vehicle goes from there, what is kept.

Ponda et al. (2012), Algorithm 1. The prediction is closed-loop: the vehicle turns towards the sample as fast
as it can, so a way in the tree is one that the vehicle's own waypoint controller takes, up to accelerations.
"""

import math

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel
from planner.irrt.kinematics import FORWARD, FREE

SUBSTEPS = 4  # of the prediction between two looks
EXPLORE, OPTIMISE, INFORM = 0, 1, 2  # heuristics by which the node to extend is chosen


@kernel
def _nearest(
    sample: FloatArray,
    heuristic: int,
    count: int,
    poses: FloatArray,
    times: FloatArray,
    cost: FloatArray,
    speed: float,
    latest: float,
    worth: float,
) -> int:
    """The node to extend towards a sample (3,); -1 if all end too late.

    By distance, by the time of the way over the node, or by that time less what is known on arrival.
    """
    best, chosen = np.inf, -1
    for i in range(count):
        dx, dy, dz = sample[0] - poses[i, 0], sample[1] - poses[i, 1], sample[2] - poses[i, 2]
        key = math.sqrt(dx * dx + dy * dy + dz * dz) / speed
        if heuristic != EXPLORE:
            key += times[i]
        if heuristic == INFORM:
            key += worth * cost[i]
        if key < best and times[i] <= latest:
            best, chosen = key, i
    return chosen


@kernel
def _move(pose: FloatArray, sample: FloatArray, seconds: float, model: FloatArray, straight: bool) -> None:
    """A pose (4,) `seconds` later, in place. Model: mode, speed, turn rate, heads, climb."""
    mode, speed, turn, heads, climb = model[0], model[1], model[2], model[3], model[4]
    dx, dy, dz = sample[0] - pose[0], sample[1] - pose[1], sample[2] - pose[2]
    level = math.sqrt(dx * dx + dy * dy)
    step = speed * seconds
    if mode == FREE:
        if straight or (level == 0.0 and dz == 0.0):
            return
        if not climb > 0.0:
            dz = 0.0
        whole = max(math.sqrt(level * level + dz * dz), 1e-12)
        step = min(step, whole)
        pose[0] += step * dx / whole
        pose[1] += step * dy / whole
        pose[2] += step * dz / whole
        if heads > 0.0 and level > 1e-9:
            pose[3] = math.atan2(dy, dx)
        return
    off = 0.0
    if not straight and level > 1e-9:
        off = math.atan2(dy, dx) - pose[3]
        off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
    turned = min(max(off, -turn * seconds), turn * seconds)
    rest = abs(off - turned)
    middle = pose[3] + 0.5 * turned
    pose[3] += turned
    if abs(pose[3]) > math.pi:
        pose[3] -= math.copysign(2.0 * math.pi, pose[3])
    ahead = step if mode == FORWARD else step * max(math.cos(rest + 0.5 * abs(turned)), 0.0)
    pose[0] += ahead * math.cos(middle)
    pose[1] += ahead * math.sin(middle)
    pose[2] += min(max(dz, -climb * ahead), climb * ahead)


@kernel
def extended(
    samples: FloatArray,
    heuristics: IntArray,
    count: int,
    poses: FloatArray,
    times: FloatArray,
    cost: FloatArray,
    model: FloatArray,
    chain: int,
    looks: int,
    seconds: float,
    horizon: float,
    worth: float,
    low: FloatArray,
    high: FloatArray,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Ways from the tree towards samples (b, 3), as chains of edges (Algorithm 1, lines 2-9).

    Args:
        samples, heuristics: where to, and how the node to start from is chosen (b,).
        count, poses, times, cost: the nodes there are.
        model: of the vehicle, see `_move`.
        chain: edges towards one sample, at most.
        looks, seconds: of an edge, and between them.
        horizon: seconds after the root at which a way ends.
        worth: seconds that a unit of information cost is worth.
        low, high: (3,) where the ways may be.

    Returns:
        First nodes (b,), numbers of edges (b,) inside the bounds, looks (b, chain, looks, 4); the last look
        of an edge is its end.
    """
    b = samples.shape[0]
    starts = np.empty(b, dtype=np.int64)
    edges = np.zeros(b, dtype=np.int64)
    out = np.empty((b, chain, looks, 4))
    latest = horizon - looks * seconds + 1e-9
    small = seconds / SUBSTEPS
    pose = np.empty(4)
    for i in range(b):
        starts[i] = _nearest(samples[i], heuristics[i], count, poses, times, cost, model[1], latest, worth)
        if starts[i] < 0:
            continue
        pose[:] = poses[starts[i]]
        time, inside, straight = times[starts[i]], True, False
        while edges[i] < chain and time <= latest and inside and not straight:
            for k in range(looks):
                for _ in range(SUBSTEPS):
                    _move(pose, samples[i], small, model, straight)
                    gap = 0.0
                    for c in range(2):
                        gap += (samples[i, c] - pose[c]) ** 2
                    straight = straight or gap <= (model[1] * small) ** 2
                for c in range(4):
                    out[i, edges[i], k, c] = pose[c]
                for c in range(3):
                    inside = inside and low[c] <= pose[c] <= high[c]
            time += looks * seconds
            edges[i] += 1 if inside else 0
    return starts, edges, out


@kernel
def adopt(
    starts: IntArray,
    edges: IntArray,
    ways: FloatArray,
    free: BoolArray,
    count: int,
    seconds: float,
    parents: IntArray,
    poses: FloatArray,
    times: FloatArray,
    looks: FloatArray,
) -> int:
    """Add the free beginning of every chain to the tree's arrays, as far as there is room; the new count."""
    for i in range(starts.size):
        parent = starts[i]
        for e in range(edges[i]):
            if count == parents.size or not free[i, e]:
                break
            parents[count] = parent
            times[count] = times[parent] + ways.shape[2] * seconds
            for k in range(ways.shape[2]):
                for c in range(4):
                    looks[count, k, c] = ways[i, e, k, c]
            for c in range(4):
                poses[count, c] = ways[i, e, ways.shape[2] - 1, c]
            parent = count
            count += 1
    return count


@kernel
def subtree(root: int, count: int, parents: IntArray) -> tuple[IntArray, IntArray]:
    """The nodes of the subtree at `root`, in order, and the numbers of their parents within it."""
    renumbered = np.full(count, -1, dtype=np.int64)
    kept = np.empty(count, dtype=np.int64)
    above = np.empty(count, dtype=np.int64)
    renumbered[root] = 0
    kept[0], above[0] = root, -1
    k = 1
    for i in range(root + 1, count):
        if parents[i] >= 0 and renumbered[parents[i]] >= 0:
            renumbered[i] = k
            kept[k], above[k] = i, renumbered[parents[i]]
            k += 1
    return kept[:k].copy(), above[:k].copy()
