"""Fusion without a centre against the centre: `python -m benchmarks.averaging` prints the docs page's tables.

Four robots, each with a field of view of its own, patrol a quarter of the area each; the quarters overlap.
All run the same filter. Every few seconds they average with their neighbours, one round or more. Beside it:
one filter that gets every set (the centre), each robot alone, attention that does not age, and equal weights
everywhere, as if all had looked everywhere.
"""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import typer

from estimator.arrays import BoolArray, FloatArray
from estimator.averaging.attention import Attention
from estimator.averaging.belief import Belief, Size
from estimator.averaging.consensus import consensus, metropolis
from estimator.averaging.states import belief_of, state_with
from estimator.filter import Area
from estimator.gaussian.gm_phd import GmPhd
from estimator.metrics.gospa import gospa
from estimator.sensor import SensorModel
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.smc_phd import SmcPhd

SIDE, TARGETS, SECONDS, EVERY, CUT_OFF = 60.0, 16, 60, 3, 4.0
AREA = Area(np.zeros(2), np.full(2, SIDE))
GRID = (31, 31)
MEMORY = 0.1  # what a look counts after a fusion: Attention.aged
REACHES = (14.0, 17.0, 20.0, 23.0)  # m, of the four fields of view
FILTERS: Mapping[str, Any] = {
    "gm_phd": GmPhd(GmPhd.Config(expected_targets=10.0, grid_points=list(GRID))),
    "smc_phd": SmcPhd(SmcPhd.Config(expected_targets=10.0, grid_points=list(GRID), particles=4000)),
}


def sensors() -> list[SensorModel]:
    """One for each robot, of different reach."""
    return [
        RangeBearing.of(
            RangeBearing.Config(
                period_s=1.0,
                range_sigma_m=0.4,
                bearing_sigma_deg=1.5,
                field_of_view="sector",
                range_m=reach,
                angle_deg=200,
                gain=0.9,
                clutter=1.0,
            ),
            AREA,
        )
        for reach in REACHES
    ]


def links(kind: str) -> BoolArray:
    """Who hears whom: a line, a ring, or all."""
    out = np.zeros((4, 4), dtype=np.bool_)
    pairs = {"line": [(0, 1), (1, 2), (2, 3)], "ring": [(0, 1), (1, 2), (2, 3), (3, 0)]}
    for i, j in pairs.get(kind, [(a, b) for a in range(4) for b in range(a)]):
        out[i, j] = out[j, i] = True
    return out


def pose(robot: int, second: int) -> FloatArray:
    """On a circle in the robot's own quarter, looking outwards and onwards."""
    angle = 0.21 * second * (1 if robot % 2 else -1) + robot
    centre = np.array([[0.28, 0.28], [0.72, 0.28], [0.72, 0.72], [0.28, 0.72]])[robot] * SIDE
    place = centre + 9.0 * np.array([np.cos(angle), np.sin(angle)])
    return np.array([place[0], place[1], 0.0, angle + 0.5])


@dataclass(frozen=True, slots=True)
class Score:
    """What one way of fusing comes to, mean over robots and the second half of a run."""

    gospa: float  # m
    cardinality: float  # mean |expected - true|
    fusion_ms: float  # for one robot, one round


def play(name: str, seed: int, graph: str | None, rounds: int, memory: float | None = MEMORY) -> Score:
    """One run of four robots; without a graph, of one filter with all sets if rounds is 0, else alone."""
    filter, models = FILTERS[name], sensors()
    rng = np.random.default_rng(seed)
    truth = rng.uniform(3.0, SIDE - 3.0, (2, TARGETS))
    takes = [[models[r].sample(truth, pose(r, t), rng) for r in range(4)] for t in range(SECONDS)]
    central = graph is None and rounds == 0
    states = [filter.init(AREA, rng) for _ in range(1 if central else 4)]
    looks = [Attention.none(AREA, GRID) for _ in range(4)]
    weights = metropolis(links(graph)) if graph else np.eye(4)
    scores, counts, spent, fusions = [], [], 0.0, 0
    for t in range(SECONDS):
        for r in range(4):
            own = 0 if central else r
            states[own] = filter.update(states[own], models[r], pose(r, t), takes[t][r], rng)
            if graph and memory is not None:
                looks[r] = looks[r].after(models[r], pose(r, t))
        if graph and t % EVERY == EVERY - 1:
            began = time.perf_counter()
            size = Size(points=FILTERS["smc_phd"].config.particles)
            beliefs = [belief_of(s, a) for s, a in zip(states, looks, strict=True)]
            fused: list[Belief] = consensus(beliefs, weights, rounds, size)
            states = [state_with(s, b) for s, b in zip(states, fused, strict=True)]
            spent, fusions = spent + time.perf_counter() - began, fusions + 4 * rounds
            looks = [b.attention.aged(1.0 if memory is None else memory) for b in fused]
        if t >= SECONDS // 2 and t % EVERY == EVERY - 1:
            for k, state in enumerate(states):
                states[k], found = filter.clusters(state, rng)
                estimates = found.means[:, found.masses >= 0.5]
                scores.append(gospa(truth, estimates, c=CUT_OFF).total)
                counts.append(abs(filter.mass(state) - TARGETS))
    return Score(float(np.mean(scores)), float(np.mean(counts)), 1e3 * spent / max(fusions, 1))


def mean(name: str, seeds: int, graph: str | None, rounds: int, memory: float | None = MEMORY) -> Score:
    """Over seeds."""
    runs = [play(name, seed, graph, rounds, memory) for seed in range(seeds)]
    return Score(*(float(np.mean([getattr(r, key) for r in runs])) for key in Score.__slots__))


def rows(name: str, seeds: int) -> Iterator[str]:
    """The table of one filter."""
    play(name, 0, "ring", 1)  # kernels are compiled before anything is timed
    yield f"| {name} | rounds | GOSPA, m | cardinality error | ms per robot and round |"
    yield "| --- | --- | --- | --- | --- |"
    for label, rounds in (("one filter with all sets", 0), ("each robot alone", 1)):
        score = mean(name, seeds, None, rounds)
        yield f"| {label} | | {score.gospa:.2f} | {score.cardinality:.2f} | |"
    for graph in ("line", "ring", "complete"):
        for rounds in (1, 3, 6):
            if graph == "complete" and rounds > 1:
                continue
            score = mean(name, seeds, graph, rounds)
            cells = f"{score.gospa:.2f} | {score.cardinality:.2f} | {score.fusion_ms:.2f} |"
            yield f"| by place, {graph} | {rounds} | {cells}"
    for label, memory in (("by place, looks never age", 1.0), ("equal weights", None)):
        score = mean(name, seeds, "complete", 1, memory)
        yield f"| {label}, complete | 1 | {score.gospa:.2f} | {score.cardinality:.2f} | |"


def main(
    seeds: Annotated[int, typer.Option(help="How many seeds.")] = 5,
    filter: Annotated[str, typer.Option(help="gm_phd, smc_phd or both.")] = "both",
) -> None:
    """Print the tables."""
    for name in FILTERS if filter == "both" else [filter]:
        for row in rows(name, seeds):
            print(row, flush=True)
        print()


if __name__ == "__main__":
    typer.run(main)
