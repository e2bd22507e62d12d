"""Take away what keeps a team right, and a named invariant or test must fail: else it would guard nothing."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from agents.fusion import timeline
from agents.fusion.watermark import Applied
from agents.invariants import Report, check
from agents.invariants.crashes import SAFETY
from agents.invariants.sets import TWICE
from agents.mission.mission import Mission
from agents.mission.mission_file import load
from planner.allocation.cbba import AllocationState, Score
from planner.allocation.consensus import NOBODY, beats
from sim.campaign.campaign import run
from sim.campaign.faults import AnyFault, Kill, Schedule, Weather
from sim.engine import nodes
from sim.network.conditions import NetworkConditions
from tests.planner.allocation import teams, test_cbba

SEED = 3
TROUBLE = (
    Weather(
        at=0.5,
        until=7.0,
        conditions=NetworkConditions(
            delay_s=0.05, jitter_s=0.3, loss=0.3, duplication=0.5, late=0.3, late_s=0.5, datagrams=True
        ),
    ),
    Kill(at=3.2, who="r2", back_after=1.0),
)


@pytest.fixture(scope="module")
def mission() -> Mission:
    planner = {"kind": "maasi", "candidates": {"low": [15, 15], "high": [85, 85], "points": [3, 3]}}
    return msgspec.structs.replace(load("campaign"), duration_s=10.0, planner=planner)


def checked(mission: Mission, *faults: AnyFault) -> Report:
    _, history = run(mission, Schedule(seed=SEED, faults=faults, calm_at=8.0), SEED)
    return check(history)


def test_with_everything_in_place_every_invariant_holds(mission: Mission) -> None:
    report = checked(mission, *TROUBLE)
    assert not report.violations, report.violations[0]
    assert report.counts["posteriors of sets out of order"] == 1


def test_without_deduplication_none_twice_fails(mission: Mission, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Applied, "__contains__", lambda self, message: False)
    assert TWICE in checked(mission, *TROUBLE).broken


def test_without_boot_ids_crash_safety_fails(mission: Mission, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nodes, "boot_name", lambda number: "b0")
    assert SAFETY in checked(mission, *TROUBLE).broken


def test_without_the_rollback_window_none_twice_fails(
    mission: Mission, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(timeline, "bisect_right", lambda keys, key: len(keys))  # whatever comes goes last
    assert TWICE in checked(mission, *TROUBLE).broken


def keeping_the_tail(state: AllocationState, tasks: Sequence[str], score: Score) -> AllocationState:
    """`build_bundle` as it must not be: what was bid for after a lost task stays, at its old bid."""
    agents, bids = dict(state.winning_agents), dict(state.winning_bids)
    bundle = [task for task in state.bundle if agents.get(task) == state.robot]
    path = [task for task in state.path if task in bundle]
    ceiling = min([bids[task] for task in bundle], default=np.inf)
    left = [task for task in tasks if task not in bundle]
    rank = {robot: number for number, robot in enumerate(state.team)}
    while left and len(bundle) < state.capacity:
        gains, places = score.gains(path, left)
        worth = np.minimum(gains, ceiling)
        wins = [
            beats(y, rank[state.robot], bids.get(task, 0.0), rank.get(agents.get(task, ""), NOBODY))
            for task, y in zip(left, worth, strict=True)
        ]
        best = int(np.argmax(np.where(wins, gains, -np.inf)))
        if not wins[best] or worth[best] <= 0.0:
            break
        task, ceiling = left.pop(best), float(worth[best])
        bundle.append(task)
        path.insert(int(places[best]), task)
        bids[task], agents[task] = ceiling, state.robot
    return replace(state, bundle=tuple(bundle), path=tuple(path), winning_bids=bids, winning_agents=agents)


def test_without_the_tail_release_the_greedy_allocation_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(teams, "build_bundle", keeping_the_tail)

    def failures() -> Iterator[int]:
        for seed in range(6):
            try:
                test_cbba.test_any_connected_graph_agrees_on_the_greedy_allocation("random", seed)
            except AssertionError:
                yield seed

    assert list(failures())
