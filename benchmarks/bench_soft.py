"""How long one statement of an operator takes."""

from typing import Any

import numpy as np

from estimator.filter import Area
from estimator.gaussian.components import Components
from estimator.soft.config import MixturesConfig, TargetTable
from estimator.soft.mixtures import Mixtures, MixturesState
from estimator.soft.models import ranges
from estimator.soft.statement import SoftObservation

AREA = Area(np.full(2, -6.0), np.full(2, 6.0))
TARGETS, COMPONENTS = 5, 15
MODEL = ranges(np.zeros(2), 2.0, 4.0, 4.0)


def scene() -> tuple[Mixtures, MixturesState]:
    """Five targets of fifteen components each, standard deviation 1 m, all over the area (section IV)."""
    rng = np.random.default_rng(0)
    table = [TargetTable(name=f"cone {i + 1}") for i in range(TARGETS)]
    filter = Mixtures(MixturesConfig(targets=table, components=COMPONENTS))
    state = filter.init(AREA, rng)
    mixtures = [
        Components(
            rng.dirichlet(np.ones(COMPONENTS)),
            rng.uniform(-5.0, 5.0, (COMPONENTS, 2)),
            np.tile(np.eye(2), (COMPONENTS, 1, 1)),
        )
        for _ in range(TARGETS)
    ]
    names = ("dimension", "names", "labels", "kinds", "radius", "clusters")
    fields = {name: getattr(state, name) for name in names}
    return filter, MixturesState(mixtures=tuple(mixtures), **fields)


def run(benchmark: Any, relation: str, positive: bool, asked: float | None, note: str) -> None:
    filter, state = scene()
    told = SoftObservation.of(MODEL, relation, positive=positive)
    assert len(MODEL.softmax.weights) == 17
    rng = np.random.default_rng(1)
    benchmark.extra_info.update(unit="ms", note=note)
    if asked is not None:
        benchmark.extra_info["asked"] = asked
    after = filter.observe(state, told, rng)
    assert all(m.count <= COMPONENTS for m in after.mixtures)
    benchmark(filter.observe, state, told, rng)


def test_soft_observation(benchmark: Any) -> None:
    run(benchmark, "around", True, 5.0, '"something is around the robot", 8 of 17 sub-classes, 64 samples')


def test_soft_observation_negative(benchmark: Any) -> None:
    run(benchmark, "near", False, None, '"nothing is near the robot", 16 of 17 sub-classes, 64 samples')
