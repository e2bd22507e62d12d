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
from typing import Protocol, runtime_checkable

import numpy as np

from estimator.arrays import BoolArray, FloatArray
from estimator.filter import Area
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
            ways = [way for way in _paths(ground, here, goals) if way is not None and way.shape[1] > 1]
        if ways:
            had = True
            spaced = [evenly(way, scales.steps) for way in ways]
            poses = np.stack([_poses(points, ahead, pose, turns) for points, ahead in spaced])
            yield ActionSet(length, poses, tuple(ways))
        elif had or length > float(np.linalg.norm(area.high - area.low)):
            return  # the area has nothing that far
        length *= scales.growth


def evenly(corners: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
    """`steps` evenly spaced points (d, steps) along a way (d, k), the last its end, and its directions there.

    The directions (d, steps) are those of arrival, not of unit length; 0 on a way without any.
    """
    legs = np.diff(corners, axis=1)
    along = np.append(0.0, np.cumsum(np.linalg.norm(legs, axis=0)))
    at = along[-1] * np.arange(1, steps + 1) / steps
    points = np.stack([np.interp(at, along, row) for row in corners])
    leg = np.clip(np.searchsorted(along, at * (1.0 - 1e-12)) - 1, 0, legs.shape[1] - 1)
    return points, legs[:, leg]


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


def _poses(points: FloatArray, ahead: FloatArray, pose: FloatArray, turns: bool) -> FloatArray:
    poses = np.tile(pose, (points.shape[1], 1))
    poses[:, : len(points)] = points.T
    if turns:
        moved = (ahead[0] != 0.0) | (ahead[1] != 0.0)
        poses[moved, 3] = np.arctan2(ahead[1], ahead[0])[moved]
    return poses


def _paths(ground: Ground, here: FloatArray, goals: FloatArray) -> list[FloatArray | None]:
    if isinstance(ground, ManyPaths):
        return ground.paths(here, goals)
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


def _spread(places: FloatArray, radius: float) -> list[int]:
    """Columns of places (d, n): the goals of Algorithm 1, steps 3 and 5-10."""
    if places.shape[1] == 0:
        return []
    left: BoolArray = np.ones(places.shape[1], dtype=np.bool_)
    nearest = np.linalg.norm(places - places[:, :1], axis=0)  # to any goal so far
    chosen = []
    while left.any():
        goal = int(np.argmin(np.where(left, nearest, np.inf)))
        chosen.append(goal)
        gaps = np.linalg.norm(places - places[:, goal : goal + 1], axis=0)
        nearest = np.minimum(nearest, gaps)
        left &= gaps >= radius
        left[goal] = False
    return chosen
