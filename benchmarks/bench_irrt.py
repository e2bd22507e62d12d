"""How fast the information-rich tree grows: Ponda et al. (2012), Algorithm 1, with five targets."""

from typing import Any

import numpy as np

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from planner.irrt.kinematics import ON_THE_SPOT, Kinematics
from planner.irrt.targets import Targets
from planner.irrt.tree import Bounds, Edges, Tree

NODES = 5000
SIDE = 100.0


def grown(sensor: RangeBearing, targets: Targets, root: FloatArray) -> Tree:
    """A tree from its root to NODES nodes, each valued as it comes."""
    tree = Tree(
        np.array([10.0, 10.0, 0.0, 0.0]),
        NODES,
        Edges(looks=2, each=1, seconds=1.0),
        Kinematics(ON_THE_SPOT, 2.0, 1.5, True, 0.0),
    )
    low, high = np.zeros(3), np.array([SIDE, SIDE, 0.0])
    bounds = Bounds(low, high, None, 200.0)
    rng = np.random.default_rng(1)
    tree.value(sensor, targets, root, lambda: False)
    while not tree.full:
        tree.grow(sensor, targets, bounds, 0.5, 1.0, rng)
    return tree


def test_irrt_nodes(benchmark: Any) -> None:
    """Nodes added and scored per second: a unicycle, range and bearing, two looks on each edge."""
    area = Area(np.zeros(2), np.full(2, SIDE))
    config = RangeBearing.Config(period_s=1.0, range_sigma_m=1.0, bearing_sigma_deg=2.0, reach_m=[20.0, 20.0])
    sensor = RangeBearing.of(config, area)
    rng = np.random.default_rng(2)
    targets = Targets(
        rng.uniform(10, 90, (2, 5)), np.tile(9.0 * np.eye(2), (5, 1, 1)), np.full(5, 0.2), 5, np.zeros((2, 5))
    )
    root = np.linalg.inv(targets.covariances)
    tree = benchmark.pedantic(grown, args=(sensor, targets, root), rounds=5, warmup_rounds=1)
    assert tree.count == NODES
    assert tree.cost[: tree.count].min() < tree.cost[0]
    benchmark.extra_info.update(
        value=NODES / benchmark.stats.stats.median,
        asked=20_000.0,
        unit="nodes/s",
        better="more",
        peers={},
        note="from one root to 5,000 nodes",
    )
