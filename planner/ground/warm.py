"""A small call of every kernel of the ground, for `planner.warm`."""

import numpy as np

from estimator.filter import Area
from planner.ground.build import GroundPlan, built
from planner.ground.shapes import Shape


def run() -> None:
    """Ways, distances and checks around a box and a disc, on one layer and on several."""
    corners = np.array([[4.0, 2.0], [6.0, 2.0], [6.0, 8.0], [4.0, 8.0]])
    for dimension, altitude in ((2, (-np.inf, np.inf)), (3, (0.0, 4.0))):
        area = Area(np.zeros(dimension), np.full(dimension, 10.0))
        obstacles = (Shape.polygon([corners], altitude), Shape.disc(8.0, 8.0, 0.5, altitude))
        plan = GroundPlan(obstacles=obstacles, radius=0.2, room=0.3, resolution=0.5)
        start, goal = np.array([1.0, 5.0, 1.0]), np.array([9.0, 5.0, 1.0])
        ground = built(plan, area, start[:, None])
        ground.path(start, goal)
        ground.paths(start, goal[:, None])
        ground.distances(goal, start[:, None])
        ground.path(start[:2].copy(), goal[:2].copy())
        ground.path(np.array([3.7, 5.0, 1.0]), goal)
        ground.path(np.array([5.0, 5.0, 1.0])[:dimension], goal[:dimension])  # out of a wall
