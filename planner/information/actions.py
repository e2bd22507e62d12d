"""Action sets at several length scales, Dames & Kumar 2015 (see `entropy`), Algorithm 1 and section III-A.

An action is T poses, evenly spaced along a shortest way to a goal, where the robot would measure. Goals of
a length scale are places at that distance from the robot: of the way, where there is a ground with
obstacles, else of the straight line. Algorithm 1 goes round them, each time to the place nearest to the goals
so far, and drops what is within R of a new goal; the paper gives no number for R, here it is a share of the
length, so that all scales have about as many actions. It begins straight ahead of the robot.

A robot is taken to look along its way if its vehicle steers that way, else to keep its yaw.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, cast, runtime_checkable

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.filter import Area
from estimator.kernels import kernel
from planner.plan import Ground, VehicleModel

RING = 48  # places at a length scale in the open, among which goals are chosen
SPHERE = 160  # of them in 3D
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
TURNED = 0.5  # rad, by which a vehicle must turn towards its way to be one that looks along it


@runtime_checkable
class ManyPaths(Protocol):
    """A ground that finds the ways from one place to several at once."""

    def paths(self, start: FloatArray, goals: FloatArray) -> list[FloatArray | None]:
        """`Ground.path` from start (d,) to goals (d, n)."""


@dataclass(frozen=True, slots=True)
class ActionSet:
    """The a actions of one robot at one length scale."""

    length: float  # metres
    poses: FloatArray  # (a, T, 4) where it would measure
    corners: tuple[FloatArray, ...]  # of each way (d, k), start and goal among them


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
        self.many = isinstance(ground, ManyPaths)
        self.spacing = float(((area.high - area.low) / counts).max())


def action_sets(
    pose: FloatArray,
    area: Area,
    scales: Scales,
    *,
    turns: bool,
    ground: Ground | None = None,
    lattice: Lattice | None = None,
) -> Iterator[ActionSet]:
    """The actions of each length scale in turn, until one has no place left in the area or the ground.

    Args:
        pose: (4,) of the robot.
        area: goals lie in it.
        scales: their lengths.
        turns: whether the robot looks along its way.
        ground: None: the area is open.
        lattice: of the ground, needed with one.
    """
    d = area.dimension
    here = np.ascontiguousarray(pose[:d])
    metres = None if ground is None or lattice is None else ground.distances(here, lattice.points)
    length, had = scales.first, False
    for _ in range(scales.most):
        if ground is None or lattice is None or metres is None:
            places = _ring(pose, area, length)
            goals = places[:, _spread(places, scales.spread * length)]
            ways = [np.stack([here, goal], axis=1) for goal in goals.T]
        else:
            near = np.flatnonzero(np.abs(metres - length) <= 0.71 * lattice.spacing)
            near = near[np.argsort(_turn_to(lattice.points[:, near], pose), kind="stable")]
            places = np.ascontiguousarray(lattice.points[:, near])
            goals = np.ascontiguousarray(places[:, _spread(places, scales.spread * length)])
            ways = [
                way
                for way in _paths(ground, here, goals, lattice.many)
                if way is not None and way.shape[1] > 1
            ]
        if ways:
            had = True
            poses = np.stack([evenly(way, scales.steps, pose, turns) for way in ways])
            yield ActionSet(length, poses, tuple(ways))
        elif had or length > float(np.linalg.norm(area.high - area.low)):
            return  # the area has nothing that far
        length *= scales.growth


def evenly(corners: FloatArray, steps: int, pose: FloatArray, turns: bool) -> FloatArray:
    """Poses (steps, 4) evenly spaced along a way (d, k), the last at its end; elsewise as pose (4,).

    A robot that turns has its yaw along the way where it arrives from, unless that goes straight up or down.
    """
    return _poses(np.ascontiguousarray(corners), steps, pose, turns)


def part(corners: FloatArray, share: float) -> FloatArray:
    """The first `share` of a way (d, k), by length: its corners, and where it ends."""
    legs = np.linalg.norm(np.diff(corners, axis=1), axis=0)
    along = np.append(0.0, np.cumsum(legs))
    end = share * along[-1]
    kept = corners[:, along < end - 1e-9]
    last = np.stack([np.interp(end, along, row) for row in corners])[:, None]
    return np.hstack([kept, last])


def looks_along(vehicle: VehicleModel) -> bool:
    """Whether a vehicle turns towards where it goes: asked of its own model, on a way to its left."""
    state = vehicle.initial_state(np.zeros(4))
    way = vehicle.predict(state, np.array([[0.0, 20.0, 0.0]]), 1.0)
    return abs(float(vehicle.pose(way.end_states[0])[3])) > TURNED


def _paths(ground: Ground, here: FloatArray, goals: FloatArray, many: bool) -> list[FloatArray | None]:
    if many:
        return cast(ManyPaths, ground).paths(here, goals)
    return [ground.path(here, np.array(goal)) for goal in goals.T]


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
def _spread(places: FloatArray, radius: float) -> IntArray:
    """Columns of places (d, n): the goals of Algorithm 1, steps 3 and 5-10."""
    d, n = places.shape
    left = np.ones(n, dtype=np.bool_)
    nearest = np.full(n, np.inf)  # to any goal so far
    chosen = np.empty(n, dtype=np.int64)
    count, goal = 0, 0
    while goal >= 0 and n > 0:
        chosen[count] = goal
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
    return chosen[:count]


@kernel
def _poses(corners: FloatArray, steps: int, pose: FloatArray, turns: bool) -> FloatArray:
    """Poses (steps, 4) evenly spaced along a way (d, k), the last at its end."""
    d, k = corners.shape
    along = np.zeros(k)
    for c in range(1, k):
        square = 0.0
        for axis in range(d):
            square += (corners[axis, c] - corners[axis, c - 1]) ** 2
        along[c] = along[c - 1] + np.sqrt(square)
    out = np.empty((steps, 4))
    leg = 1
    for t in range(steps):
        at = along[k - 1] * (t + 1) / steps
        while leg < k - 1 and along[leg] < at * (1.0 - 1e-12):
            leg += 1
        length = along[leg] - along[leg - 1]
        share = min(1.0, (at - along[leg - 1]) / length) if length > 0.0 else 1.0
        out[t] = pose
        for axis in range(d):
            out[t, axis] = corners[axis, leg - 1] + share * (corners[axis, leg] - corners[axis, leg - 1])
        east, north = corners[0, leg] - corners[0, leg - 1], corners[1, leg] - corners[1, leg - 1]
        if turns and (east != 0.0 or north != 0.0):
            out[t, 3] = np.arctan2(north, east)
    return out
