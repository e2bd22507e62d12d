import numpy as np
import pytest

from estimator.exploration import Exploration
from planner.maasi.trigger import worth_measuring
from tests.planner.problems import NumpySensor, interpolated


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_rule_is_refinement_plus_weighted_exploration_above_the_threshold(seed, dimension):
    rng = np.random.default_rng(seed)
    low, high = np.zeros(dimension), np.full(dimension, 20.0)
    exploration = Exploration(rng.uniform(0, 1, (4, 5, 6)[:dimension]), low, high)
    sensor = NumpySensor(dimension)
    clusters, pose = rng.uniform(0, 20, (dimension, 3)), rng.uniform(0, 20, 4)
    seen = sensor.detection(clusters, pose[None]).sum()
    value = seen + 2.5 * interpolated(exploration.values, low, high, pose[:dimension])
    assert worth_measuring(sensor, clusters, exploration, pose, 2.5, value - 1e-6)
    assert not worth_measuring(sensor, clusters, exploration, pose, 2.5, value + 1e-6)


def test_without_clusters_only_exploration_counts():
    exploration = Exploration(np.ones((3, 3)), np.zeros(2), np.ones(2))
    nothing = np.zeros((2, 0))
    assert worth_measuring(NumpySensor(2), nothing, exploration, np.zeros(4), 1.0, 0.5)
    assert not worth_measuring(NumpySensor(2), nothing, exploration, np.zeros(4), 0.4, 0.5)
