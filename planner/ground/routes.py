"""Ways of vehicles over the ground: may they be taken, and where do they go around.

Vehicles cut corners and swing out, so that a clear line of waypoints is not enough: what counts are the poses
that the vehicle model predicts, which are those that a simulated vehicle then takes.
"""

import math
from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from planner.ground.grid_ground import GridGround
from planner.plan import Ground, Over, Predictions, Trajectory, VehicleModel, never
from planner.vehicles.prediction import measure_times
from planner.vehicles.route import routed

SAME_YAW = 1e-9
CORNERS_S = (0.6, 0.2)  # seconds ahead of a corner at which to steer on; then only on arrival
ARRIVAL = 1e-6  # m: as `near` of a route, a corner is left only once the vehicle has arrived there


@dataclass(frozen=True, slots=True)
class Around:
    """Ways to w waypoints that go around what is in the way."""

    ways: (
        Predictions  # the vehicle's own where the straight way is clear, estimates along the route elsewhere
    )
    routes: tuple[FloatArray | None, ...]  # (r, 3) waypoints to take in turn; None: straight
    open: BoolArray  # (w,) whether there is a way


def around(
    ground: Ground,
    vehicle: VehicleModel,
    state: FloatArray,
    direct: Predictions,
    period: float,
    over: Over = never,
) -> Around:
    """Replace predicted straight ways that are not clear by estimates along the shortest ways.

    An estimate takes as long for the detour, and costs as much, as the vehicle does per metre on the best
    of its straight ways; it is good enough to choose by. `followed` then predicts the chosen one.

    Args:
        direct: the vehicle's predictions, with samples every `period` seconds.
        over: whether time is up; ways that were not found by then are not open.
    """
    start = vehicle.pose(state)[:3]
    ends = np.array([vehicle.pose(end)[:3] for end in direct.end_states]).reshape(-1, 3)
    here = bool(ground.clear(start[:, None])[0])
    straight = ways_clear(ground, direct.offsets, direct.measure_poses, ends)
    straight &= here
    detours = np.flatnonzero(~straight & ground.clear(np.ascontiguousarray(direct.waypoints.T)))
    goals = np.ascontiguousarray(direct.waypoints[detours].T)
    found = dict(zip(detours.tolist(), ground.paths(start, goals, over), strict=True))
    gaps = np.linalg.norm(direct.waypoints - start, axis=1)
    moving = (gaps > 0) & (direct.steps > 0)
    if not moving.any() or not any(route is not None for route in found.values()):
        return Around(direct, (None,) * gaps.size, straight)
    pace = float((direct.steps[moving] / gaps[moving]).min())  # control steps per metre
    cost = float((direct.control_costs[moving] / gaps[moving]).min())
    yaws = np.array([vehicle.pose(end)[3] for end in direct.end_states])
    heading = bool((np.abs(yaws - vehicle.pose(state)[3]) > SAME_YAW).any())
    steps, costs = direct.steps.copy(), direct.control_costs.copy()
    poses: list[FloatArray] = []
    routes: list[FloatArray | None] = []
    every = period / vehicle.control_period
    for w in range(gaps.size):
        way = found.get(w)
        rows = slice(direct.offsets[w], direct.offsets[w + 1])
        if way is None:
            poses.append(direct.measure_poses[rows])
            routes.append(None)
            continue
        legs = np.linalg.norm(np.diff(way, axis=1), axis=0)
        more = max(float(legs.sum()) - gaps[w], 0.0)
        steps[w] += math.ceil(more * pace)
        costs[w] += more * cost
        poses.append(_along(way, legs, math.ceil(steps[w] / every - 1e-9), every / max(steps[w], 1)))
        poses[-1][:, 3] = _headings(way, legs, poses[-1]) if heading else vehicle.pose(state)[3]
        routes.append(np.ascontiguousarray(way[:, 1:].T))
        straight[w] = True
    offsets = np.concatenate([[0], np.cumsum([len(some) for some in poses])]).astype(np.int64)
    ways = Predictions(
        direct.waypoints,
        steps,
        costs,
        offsets,
        measure_times(offsets, period),
        np.vstack(poses),
        direct.end_states,
    )
    return Around(ways, tuple(routes), straight)


def followed(
    ground: Ground,
    vehicle: VehicleModel,
    state: FloatArray,
    route: FloatArray,
    start_time: float,
    measure_period: float,
    over: Over = never,
) -> Trajectory | None:
    """The vehicle's trajectory along a route (r, 3), clear all along; None if it swings out too far.

    At first it steers on to the next corner early; if that brings it too near to something, later, and last
    only where it has come to the corner.
    """
    if len(route) == 1:
        made = vehicle.trajectory(state, route[0], start_time, measure_period)
        return made if trajectory_clear(ground, made) else None
    length = float(
        np.linalg.norm(np.diff(route, axis=0, prepend=vehicle.pose(state)[None, :3]), axis=1).sum()
    )
    speed = 0.0
    for seconds in (*CORNERS_S, 0.0):
        if over():
            break
        if seconds and speed == 0.0:
            way = vehicle.predict(state, route[-1:], measure_period)
            straight = float(np.linalg.norm(route[-1] - vehicle.pose(state)[:3]))
            speed = straight / max(int(way.steps[0]) * vehicle.control_period, 1e-9)
        near = max(seconds * speed, ARRIVAL)
        if near > length:
            continue
        made = routed(vehicle, state, route, start_time, measure_period, near=near)
        if trajectory_clear(ground, made):
            return made
    return None


def trajectory_to(
    ground: Ground,
    vehicle: VehicleModel,
    state: FloatArray,
    place: FloatArray,
    start_time: float,
    measure_period: float,
    over: Over = never,
) -> Trajectory | None:
    """The vehicle's way from a state to a place (3,): straight, or around; None where there is none.

    None, too, where time was `over` before one was found.
    """
    here = vehicle.pose(state)[:3]
    if ground.segments_clear(here[:, None], place[:, None])[0]:
        made = vehicle.trajectory(state, place, start_time, measure_period)
        if trajectory_clear(ground, made):
            return made
    way = ground.path(np.ascontiguousarray(here), np.ascontiguousarray(place), over)
    if way is None or way.shape[1] < 2:
        return None
    route = np.ascontiguousarray(way[:, 1:].T)
    return followed(ground, vehicle, state, route, start_time, measure_period, over)


@dataclass(frozen=True, slots=True)
class Lifted:
    """A ground that knows d coordinates, for points of three."""

    ground: Ground
    dimension: int

    def clear(self, points: FloatArray) -> BoolArray:
        return self.ground.clear(np.ascontiguousarray(points[: self.dimension]))

    def segments_clear(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        d = self.dimension
        return self.ground.segments_clear(np.ascontiguousarray(starts[:d]), np.ascontiguousarray(ends[:d]))

    def path(self, start: FloatArray, goal: FloatArray, over: Over = never) -> FloatArray | None:
        way = self.ground.path(np.array(start[: self.dimension]), np.array(goal[: self.dimension]), over)
        return self._lifted(way, start, goal)

    def paths(self, start: FloatArray, goals: FloatArray, over: Over = never) -> list[FloatArray | None]:
        d = self.dimension
        ways = self.ground.paths(np.array(start[:d]), np.ascontiguousarray(goals[:d]), over)
        return [self._lifted(way, start, goal) for way, goal in zip(ways, goals.T, strict=True)]

    def distances(
        self, goal: FloatArray, points: FloatArray, over: Over = never, within: float = np.inf
    ) -> FloatArray:
        d = self.dimension
        return self.ground.distances(np.array(goal[:d]), np.ascontiguousarray(points[:d]), over, within)

    def _lifted(self, way: FloatArray | None, start: FloatArray, goal: FloatArray) -> FloatArray | None:
        if way is None:
            return None
        lifted = np.repeat(goal[:, None], way.shape[1], axis=1)
        lifted[: self.dimension], lifted[:, 0] = way, start
        return lifted


def lifted(ground: Ground, dimension: int) -> Ground:
    """The ground for points of three coordinates, in a mission of `dimension`; a GridGround takes them."""
    return ground if isinstance(ground, GridGround) or dimension == 3 else Lifted(ground, dimension)


def ways_clear(ground: Ground, offsets: IntArray, poses: FloatArray, ends: FloatArray) -> BoolArray:
    """(w,) whether predicted ways are clear from begin to end.

    Args:
        offsets: (w + 1,) way i has the samples offsets[i]:offsets[i + 1].
        poses: (total, 4) samples of the ways.
        ends: (w, 3) where they end.
    """
    ways = offsets.size - 1
    if ways == 0:
        return np.zeros(0, dtype=np.bool_)
    counts = np.diff(offsets) + 1
    way = np.repeat(np.arange(ways), counts)
    last = np.cumsum(counts) - 1
    points = np.empty((3, way.size))
    own = np.ones(way.size, dtype=np.bool_)
    own[last] = False
    points[:, own], points[:, last] = poses[:, :3].T, ends.T
    out = ground.clear(np.ascontiguousarray(points[:, last]))
    inner = np.flatnonzero(own)
    good = ground.segments_clear(
        np.ascontiguousarray(points[:, inner]), np.ascontiguousarray(points[:, inner + 1])
    )
    np.logical_and.at(out, way[inner], good)
    return out


def trajectory_clear(ground: Ground, trajectory: Trajectory) -> bool:
    """Whether one vehicle's predicted trajectory may be taken.

    One that begins too near to something may do so until it is in the clear, but no farther than the ground's
    reach and through nothing solid; what may begin there is for `Ground.path` to say.
    """
    poses = trajectory.poses
    points = np.ascontiguousarray(poses[:, :3].T)
    if len(poses) > 1 and ground.segments_clear(points[:, :-1].copy(), points[:, 1:].copy()).all():
        return True
    clear = ground.clear(points)
    first = int(np.argmax(clear)) if clear.any() else len(poses)
    if first == len(poses):
        return False
    if first > 0:
        if not isinstance(ground, GridGround):
            return False
        share = np.linspace(0.0, 1.0, 8, endpoint=False)[:, None]
        steps = poses[1 : first + 1, None, :3] - poses[:first, None, :3]
        leaving = (poses[:first, None, :3] + share * steps).reshape(-1, 3).T
        gone = np.linalg.norm(leaving - poses[:1, :3].T, axis=0)
        if ground.solid(np.ascontiguousarray(leaving)).any() or (gone > 2.0 * ground.reach).any():
            return False
    rest = np.ascontiguousarray(poses[first:, :3].T)
    straight = ground.segments_clear(np.ascontiguousarray(rest[:, :-1]), np.ascontiguousarray(rest[:, 1:]))
    return bool(clear[-1]) and bool(straight.all())


def stuck(ground: Ground, place: FloatArray) -> str:
    """Why a robot at place (3,) cannot go anywhere at all; empty if it can."""
    if ground.clear(place[:, None])[0]:
        return ""
    if not isinstance(ground, GridGround):
        return "holds: it stands where robots may not be"
    if ground.solid(place[:, None])[0]:
        return "holds: it stands in an obstacle, in a keep-out zone or beyond the fence"
    if ground.way_out(place) is None:
        return "holds: it stands too near to an obstacle or a fence, and no clear place is within reach"
    return ""


def _along(way: FloatArray, legs: FloatArray, samples: int, share: float) -> FloatArray:
    """Poses (samples, 4) along a way (3, k), each `share` of it after the one before, without yaw."""
    begun = np.concatenate([[0.0], np.cumsum(legs)])
    at = np.minimum(np.arange(samples) * share, 1.0) * begun[-1]
    poses = np.zeros((samples, 4))
    for axis in range(3):
        poses[:, axis] = np.interp(at, begun, way[axis])
    return poses


def _headings(way: FloatArray, legs: FloatArray, poses: FloatArray) -> FloatArray:
    """The yaw (n,) of the leg of a way (3, k) that each of poses (n, 4), evenly along it, is on."""
    begun = np.cumsum(legs)
    at = np.linspace(0.0, begun[-1], len(poses), endpoint=False)
    leg = np.minimum(np.searchsorted(begun, at, side="right"), legs.size - 1)
    step = np.diff(way, axis=1)
    yaw: FloatArray = np.arctan2(step[1, leg], step[0, leg])
    return yaw
