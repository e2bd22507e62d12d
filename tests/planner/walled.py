"""The contract's problems on a ground with walls, a zone to keep out of and a fence."""

import dataclasses
from functools import cache
from typing import Any

import numpy as np

from planner.ground.build import GroundPlan, built
from planner.ground.grid_ground import GridGround
from planner.ground.shapes import Shape
from planner.plan import Intensity, PlannerSetup, PlanProblem, Trajectory
from tests.planner import contract

RADIUS, ROOM, REACH = 0.3, 0.2, 0.25  # metres; REACH: cells near a wall are blocked before the wall is
HOUSE = np.array([[20, 10], [32, 10], [32, 20], [26, 20], [26, 30], [20, 30]], np.float64)
WALL = np.array([[38, 46], [52, 46], [52, 48], [38, 48]], np.float64)
YARD = [
    np.array([[4, 44], [16, 44], [16, 56], [4, 56]], np.float64),
    np.array([[6, 46], [14, 46], [14, 54], [6, 54]], np.float64),  # closed all around
]
FENCE = np.array([[-2, -2], [62, -2], [62, 50], [52, 62], [-2, 62]], np.float64)
IN_THE_HOUSE, BY_THE_HOUSE, IN_THE_YARD, IN_THE_POND = (23.0, 20.0), (19.6, 20.0), (10.0, 50.0), (44.0, 14.0)
SETUPS = ("ground_2d", "drones_2d", "drones_3d")


def shapes(flies: bool) -> tuple[list[Shape], list[Shape], Shape]:
    """Obstacles, zones to keep out of, and the fence. Those who fly may pass over the wall."""
    high = (-np.inf, np.inf)
    wall = Shape.polygon([WALL], (-1.0, 20.0) if flies else high)
    solid = [Shape.polygon([HOUSE]), Shape.polygon(YARD), wall]
    return solid, [Shape.disc(*IN_THE_POND, 5.0)], Shape.polygon([FENCE])


@cache
def ground(name: str) -> GridGround:
    flies = name.endswith("3d")
    solid, out, fence = shapes(flies)
    plan = GroundPlan(
        obstacles=tuple(solid),
        keep_out=tuple(out),
        fences=(fence,),
        radius=RADIUS,
        room=ROOM,
        resolution=0.5 if flies else 0.25,
        layer=5.0 if flies else None,
    )
    start = np.array([[12.0], [18.0], [8.0 if flies else 0.0]])
    return built(plan, contract.team(name).area, start)


def team(name: str, robots: str = "abc") -> PlannerSetup:
    return dataclasses.replace(contract.team(name, robots), ground=ground(name))


def believing(problem: PlanProblem, place: tuple[float, float]) -> PlanProblem:
    """All is explored, and one target is believed at a place."""
    d, e = problem.area.dimension, problem.exploration
    mean = np.array([*place, 8.0][:d])[:, None]
    some = Intensity(np.repeat(mean, 5, axis=1), np.full(5, 0.2), mean, 4.0 * np.eye(d)[None], np.ones(1))
    gone = dataclasses.replace(e, values=np.zeros_like(e.values))
    return dataclasses.replace(problem, clusters=mean, intensity=some, exploration=gone, others=())


def standing_at(problem: PlanProblem, setup: PlannerSetup, place: tuple[float, float]) -> PlanProblem:
    z = 8.0 if problem.area.dimension == 3 else 0.0
    return dataclasses.replace(problem, state=contract.state(setup, "a", *place, z), others=())


def check_clear(way: Trajectory, flies: bool, leaving: float = 0.0) -> None:
    """That no point of a way, densely sampled, is nearer to anything than a robot's radius.

    Against the shapes themselves, not the grid that was made of them.

    Args:
        way: of the robot.
        flies: whether the wall ends above.
        leaving: metres from its start within which it may still be nearer.
    """
    dense = np.linspace(way.start_time, way.end_time, 3000)
    points = np.stack([np.interp(dense, way.times, way.poses[:, axis]) for axis in range(3)])
    points = points[:, np.linalg.norm(points - points[:, :1], axis=0) >= leaving]
    solid, out, fence = shapes(flies)
    if not points.shape[1]:
        return
    for shape in (*solid, *out):
        assert distances(shape, points) >= RADIUS - 1e-6, shape
    assert -fence.distances(points).max() >= RADIUS - 1e-6


def distances(shape: Shape, points: Any) -> float:
    """The least distance in metres of points (3, n) to a shape; from above, of those at its altitude."""
    level = (points[2] >= shape.altitude[0]) & (points[2] <= shape.altitude[1])
    return float(shape.distances(points[:, level]).min()) if level.any() else np.inf
