"""Action sets at several length scales, Dames & Kumar 2015 (see `entropy`), Algorithm 1 and section III-A.

An action is T poses, evenly spaced along a shortest way to a goal, where the robot would measure. Goals of
a length scale are places at that distance from the robot: of the way, where there is a ground with
obstacles, else of the straight line. Algorithm 1 goes round them, each time to the place nearest to the goals
so far, and drops what is within R of a new goal; the paper gives no number for R, here it is a share of the
length, so that all scales have about as many actions. It begins straight ahead of the robot.

A robot is taken to look along its way if its vehicle steers that way, else to keep its yaw.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.filter import Area
from estimator.kernels import kernel
from planner.plan import Ground, Over, VehicleModel, never

RING = 48  # places at a length scale in the open, among which goals are chosen
SPHERE = 160  # of them in 3D
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
TURNED = 0.5  # rad, by which a vehicle must turn towards its way to be one that looks along it


@dataclass(frozen=True, slots=True)
class ActionSet:
    """The a actions of one robot, of all length scales, the shortest first."""

    lengths: FloatArray  # (a,) metres, the action's length scale
    poses: FloatArray  # (a, T, 4) where it would measure
    corners: tuple[FloatArray, ...]  # of each way (d, k), start and goal among them

    @property
    def scales(self) -> list[tuple[float, IntArray]]:
        """Each length in metres and the numbers of its actions."""
        return [(float(length), np.flatnonzero(self.lengths == length)) for length in np.unique(self.lengths)]


@dataclass(frozen=True, slots=True)
class Scales:
    """Which length scales there are and what their actions are like."""

    first: float  # metres
    growth: float  # from one scale to the next
    most: int  # scales
    steps: int  # T
    spread: float  # R in lengths


class Lattice:
    """Places all over the area, of which those that the ground leaves free may be goals."""

    def __init__(self, area: Area, ground: Ground, spacing: float) -> None:
        counts = np.maximum(1, np.round((area.high - area.low) / spacing)).astype(np.int64)
        axes = [
            low + (high - low) * (np.arange(n) + 0.5) / n
            for low, high, n in zip(area.low, area.high, counts, strict=True)
        ]
        points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])
        self.points = np.ascontiguousarray(points[:, ground.clear(points)])
        self.spacing = float(((area.high - area.low) / counts).max())


def action_set(
    pose: FloatArray,
    area: Area,
    scales: Scales,
    *,
    turns: bool,
    ground: Ground | None = None,
    lattice: Lattice | None = None,
    over: Over = never,
) -> ActionSet:
    """The actions of all length scales, until one has no place left in the area or the ground.

    Args:
        pose: (4,) of the robot.
        area: goals lie in it.
        scales: their lengths.
        turns: whether the robot looks along its way.
        ground: None: the area is open.
        lattice: of the ground, needed with one.
        over: whether time is up: then there are only those of the scales that are near.
    """
    d = area.dimension
    here = np.ascontiguousarray(pose[:d])
    lengths = np.array([scales.first * scales.growth**k for k in range(scales.most)])
    if ground is None or lattice is None:
        rings = [_ring(pose, area, length) for length in lengths]
        places = np.hstack(rings)
        metres, slack = np.repeat(lengths, [ring.shape[1] for ring in rings]), 1e-9
    else:
        slack = 0.71 * lattice.spacing
        longest = float(lengths[-1]) + slack
        metres = ground.distances(here, lattice.points, over, longest)
        reached = np.flatnonzero(metres <= longest)
        reached = reached[np.argsort(_turn_to(lattice.points[:, reached], pose), kind="stable")]
        places, metres = lattice.points[:, reached], metres[reached]
    farthest = float(np.linalg.norm(area.high - area.low))
    goals, of = _goals(np.ascontiguousarray(places), metres, lengths, slack, scales.spread, farthest)
    if ground is None:
        ways: list[FloatArray | None] = [np.stack([here, places[:, goal]], axis=1) for goal in goals]
    else:
        ways = ground.paths(here, np.ascontiguousarray(places[:, goals]), over)
    kept = [n for n, way in enumerate(ways) if way is not None and way.shape[1] > 1]
    corners = tuple(way for way in ways if way is not None and way.shape[1] > 1)
    poses = np.empty((len(kept), scales.steps, 4))
    if corners:
        ends = np.cumsum(np.array([0, *(way.shape[1] for way in corners)], dtype=np.int64))
        _poses(np.hstack(corners), ends, pose, turns, poses)
    return ActionSet(lengths[of[kept]], poses, corners)


def evenly(corners: FloatArray, steps: int, pose: FloatArray, turns: bool) -> FloatArray:
    """Poses (steps, 4) evenly spaced along a way (d, k), the last at its end; elsewise as pose (4,).

    A robot that turns has its yaw along the way where it arrives from, unless that goes straight up or down.
    """
    out = np.empty((1, steps, 4))
    _poses(np.ascontiguousarray(corners), np.array([0, corners.shape[1]]), pose, turns, out)
    poses: FloatArray = out[0]
    return poses


def part(corners: FloatArray, share: float) -> FloatArray:
    """The first `share` of a way (d, k), by length: its corners, and where it ends."""
    return _part(np.ascontiguousarray(corners), share)


def looks_along(vehicle: VehicleModel) -> bool:
    """Whether a vehicle turns towards where it goes: asked of its own model, on a way to its left."""
    state = vehicle.initial_state(np.zeros(4))
    way = vehicle.predict(state, np.array([[0.0, 20.0, 0.0]]), 1.0)
    return abs(float(vehicle.pose(way.end_states[0])[3])) > TURNED


def _ring(pose: FloatArray, area: Area, length: float) -> FloatArray:
    """Places (d, n) at a distance in the area, those straight ahead first."""
    d = area.dimension
    if d == 2:
        angles = pose[3] + 2.0 * np.pi * np.arange(RING) / RING
        offsets = np.stack([np.cos(angles), np.sin(angles)])
    else:
        up = 1.0 - 2.0 * (np.arange(SPHERE) + 0.5) / SPHERE
        angles = GOLDEN * np.arange(SPHERE)
        flat = np.sqrt(1.0 - up**2)
        offsets = np.stack([flat * np.cos(angles), flat * np.sin(angles), up])
    places = pose[:d, None] + length * offsets
    inside = ((places >= area.low[:, None]) & (places <= area.high[:, None])).all(axis=0)
    inside &= area.is_free(places) if inside.any() else inside
    places = np.ascontiguousarray(places[:, inside])
    return places if d == 2 else places[:, np.argsort(_turn_to(places, pose), kind="stable")]


def _turn_to(places: FloatArray, pose: FloatArray) -> FloatArray:
    """(n,) rad by which places (d, n) are off the robot's yaw."""
    off = np.arctan2(places[1] - pose[1], places[0] - pose[0]) - pose[3]
    return np.asarray(np.abs(np.angle(np.exp(1j * off))))


@kernel
def _goals(
    places: FloatArray,
    metres: FloatArray,
    lengths: FloatArray,
    slack: float,
    spread: float,
    farthest: float,
) -> tuple[IntArray, IntArray]:
    """Columns of places (d, n) that are goals, and the number of the length scale of each: Algorithm 1.

    Places within `slack` of a scale's length are its P of step 2; steps 3 and 5-10 choose among them.
    """
    d, n = places.shape
    left, nearest = np.empty(n, np.bool_), np.empty(n)
    chosen, of = np.empty(lengths.size * n, np.int64), np.empty(lengths.size * n, np.int64)
    count = 0
    for s in range(lengths.size):
        goal, before = -1, count
        for i in range(n):
            left[i] = abs(metres[i] - lengths[s]) <= slack
            nearest[i] = np.inf  # to any goal so far
            if left[i] and goal < 0:
                goal = i
        radius = spread * lengths[s]
        while goal >= 0:
            chosen[count], of[count] = goal, s
            count += 1
            left[goal] = False
            following = -1
            for i in range(n):
                if left[i]:
                    square = 0.0
                    for axis in range(d):
                        square += (places[axis, i] - places[axis, goal]) ** 2
                    nearest[i] = min(nearest[i], square)
                    left[i] = square >= radius * radius
                if left[i] and (following < 0 or nearest[i] < nearest[following]):
                    following = i
            goal = following
        if count == before and (count > 0 or lengths[s] > farthest):
            break  # the area has nothing that far
    return chosen[:count].copy(), of[:count].copy()


@kernel
def _poses(corners: FloatArray, ends: IntArray, pose: FloatArray, turns: bool, out: FloatArray) -> None:
    """Poses `out` (a, T, 4) evenly spaced along ways (d, k), the last at its end.

    Way i has the corners ends[i]:ends[i + 1].
    """
    d, steps = corners.shape[0], out.shape[1]
    along = np.zeros(corners.shape[1])
    for i in range(len(out)):
        first, last = ends[i], ends[i + 1] - 1
        along[first] = 0.0
        for c in range(first + 1, last + 1):
            square = 0.0
            for axis in range(d):
                square += (corners[axis, c] - corners[axis, c - 1]) ** 2
            along[c] = along[c - 1] + np.sqrt(square)
        leg = first + 1
        for t in range(steps):
            at = along[last] * (t + 1) / steps
            while leg < last and along[leg] < at * (1.0 - 1e-12):
                leg += 1
            length = along[leg] - along[leg - 1]
            share = min(1.0, (at - along[leg - 1]) / length) if length > 0.0 else 1.0
            out[i, t] = pose
            for axis in range(d):
                step = corners[axis, leg] - corners[axis, leg - 1]
                out[i, t, axis] = corners[axis, leg - 1] + share * step
            east, north = corners[0, leg] - corners[0, leg - 1], corners[1, leg] - corners[1, leg - 1]
            if turns and (east != 0.0 or north != 0.0):
                out[i, t, 3] = np.arctan2(north, east)


@kernel
def _part(corners: FloatArray, share: float) -> FloatArray:
    d, k = corners.shape
    legs = np.sqrt(((corners[:, 1:] - corners[:, :-1]) ** 2).sum(axis=0))
    end, out, count = share * legs.sum(), np.empty((d, k + 1)), 0
    along = 0.0
    for c in range(k):
        if c > 0:
            along += legs[c - 1]
        if c > 0 and along >= end - 1e-9:  # a millionth of a millimetre is no leg
            before = along - legs[c - 1]
            rest = min(1.0, (end - before) / legs[c - 1]) if legs[c - 1] > 0.0 else 1.0
            out[:, count] = corners[:, c - 1] + rest * (corners[:, c] - corners[:, c - 1])
            count += 1
            break
        out[:, count] = corners[:, c]
        count += 1
    return out[:, :count].copy()
