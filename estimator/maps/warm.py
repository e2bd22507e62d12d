"""A small call of every kernel of maps, for `estimator.warm`."""

import numpy as np

from estimator.filter import Area
from estimator.grid import nodes
from estimator.maps.line_of_sight import LineOfSight
from estimator.maps.occupancy import OCCUPIED, OccupancyMap
from estimator.maps.sight import Sight
from estimator.sensor import SensorModel


def run(sensor: SensorModel, area: Area) -> None:
    """Rays from a place in the area, to a grid's shared nodes and to points of one's own."""
    cells = np.zeros((8, 8), np.uint8)
    cells[3, 2:5] = OCCUPIED
    low, high = area.low, area.high
    made = OccupancyMap(cells, float((high - low)[:2].max()) / 8, np.append(low[:2], 0.0))
    pose = np.append(0.4 * low[:2] + 0.6 * high[:2], [0.0, 0.5])
    made.reachable_from(pose[:2, None])
    walled = LineOfSight(sensor, Sight.of(made))
    shared = nodes((5,) * area.dimension, low, high)
    walled.detection(shared, pose[None])
    walled.look(shared.copy(), pose, np.zeros((0, sensor.measurement_size)))
    walled.sample(shared, pose, np.random.default_rng(0))
    walled.outline(pose)
