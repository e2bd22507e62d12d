"""The fault campaign: 200 random schedules, and a few made by hand."""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from agents.invariants import RunHistory, check
from agents.mission.mission import Mission
from agents.mission.mission_file import load
from sim.campaign import campaign_command
from sim.campaign.campaign import run, schedule_of, trial
from sim.campaign.campaign_command import repeat_command
from sim.campaign.draws import cast_of
from sim.campaign.faults import (
    AnyFault,
    Clock,
    Cut,
    DiskFull,
    Join,
    Kill,
    RouterDown,
    Schedule,
    Slow,
    Stop,
    Weather,
)

SEEDS, BLOCK = 200, 10
ALL = ("r1", "r2", "r3", "fusion", "watch")


@pytest.fixture(scope="module")
def mission() -> Mission:
    return load("campaign")


@pytest.mark.parametrize("first", range(0, SEEDS, BLOCK))
def test_whatever_goes_wrong_every_invariant_holds(mission: Mission, first: int) -> None:
    looked_at: Counter[str] = Counter()
    for seed in range(first, first + BLOCK):
        report = trial(mission, seed).report
        assert not report.violations, f"{report.violations[0]}\nrepeat: {repeat_command('campaign', seed)}"
        looked_at += report.counts
    # Nothing holds for want of cases.
    assert looked_at["sets in time"] > 30 * BLOCK
    assert looked_at["posteriors replayed"] >= BLOCK
    assert looked_at["starts of processes"] > 5 * BLOCK
    assert looked_at["runs repeated"] == 1


def test_the_schedules_of_these_seeds_hold_every_kind_of_fault(mission: Mission) -> None:
    faults = [fault for seed in range(SEEDS) for fault in schedule_of(mission, seed).faults]
    kinds = Counter(type(fault).__name__ for fault in faults)
    assert {"Weather", "Cut", "RouterDown", "Kill", "Stop", "Slow", "DiskFull", "Clock", "Join"} == set(kinds)
    assert min(kinds.values()) >= 10, kinds
    weather = [fault.conditions for fault in faults if isinstance(fault, Weather)]
    assert max(c.loss for c in weather) > 0.5
    assert any(c.loss > 0.3 and c.burst > 2 for c in weather)
    assert any(c.datagrams and c.duplication for c in weather)
    assert any(c.late and c.late_s > mission.fusion.rollback_s for c in weather)
    assert any(c.corruption for c in weather)
    kills = [fault for fault in faults if isinstance(fault, Kill)]
    assert {fault.who for fault in kills} == {*ALL, "fusion-2", "fusion-3"}
    assert any(fault.point for fault in kills)
    cuts = [fault for fault in faults if isinstance(fault, Cut)]
    assert sum(fault.one_way for fault in cuts) > 5
    assert sum(len(fault.from_) == 1 and len(fault.to) > 3 for fault in cuts) > 20  # most of these wander
    stopped = {fault.who for fault in faults if isinstance(fault, Stop)}
    assert stopped >= set(ALL)
    assert {"fusion", "watch"} <= {fault.who for fault in faults if isinstance(fault, Slow)}
    clocks = [fault for fault in faults if isinstance(fault, Clock)]
    assert min(c.offset for c in clocks) < -4.0 < 4.0 < max(c.offset for c in clocks)
    assert max(abs(c.offset) for c in clocks) > mission.clock.correct_up_to_s  # refused
    assert max(abs(c.drift) for c in clocks) > 100e-6
    assert any(c.at > 0.0 for c in clocks)  # set in mid-mission
    joins = [fault.who for fault in faults if isinstance(fault, Join)]
    assert sum(len(who) == 64 for who in joins) == 2
    assert sum(all(name.startswith("fusion") for name in who) for who in joins) >= 3  # none to begin with


def test_the_teams_of_these_seeds_have_one_or_several_fusions_and_some_lose_all_for_good(
    mission: Mission,
) -> None:
    casts = {seed: cast_of(mission, seed) for seed in range(SEEDS)}
    assert {cast.fusion.replicas for cast in casts.values()} == {1, 2, 3}
    for_good = [
        seed
        for seed, cast in casts.items()
        if set(cast.fusions())
        <= {f.who for f in schedule_of(mission, seed).faults if isinstance(f, Kill) and f.back_after is None}
    ]
    assert len(for_good) >= 10


def held(
    mission: Mission, *faults: AnyFault, seed: int = 1, calm_at: float = 10.0
) -> tuple[RunHistory, Counter[str]]:
    _, history = run(mission, Schedule(seed=seed, faults=faults, calm_at=calm_at), seed)
    report = check(history)
    assert not report.violations, report.violations[0]
    return history, report.counts


def test_a_schedule_is_its_seed_s_alone(mission: Mission) -> None:
    assert schedule_of(mission, 5) == schedule_of(mission, 5)
    assert schedule_of(mission, 5) != schedule_of(mission, 6)


def test_a_fusion_killed_between_storing_and_telling_loses_nothing(mission: Mission) -> None:
    for point in ("before store", "after store", "after posterior"):
        kill = Kill(at=3.0, who="fusion", back_after=2.0, point=point)
        history, counts = held(mission, kill)
        boots = [fact.boot for fact in history.facts if fact.what == "up" and fact.who == "fusion"]
        assert boots == ["b0", "b1"]
        assert not any(reason.startswith("sets not applied") for reason in counts)


def test_a_robot_killed_between_measuring_and_sending_brings_the_set_when_it_is_back(
    mission: Mission,
) -> None:
    history, counts = held(mission, Kill(at=3.0, who="r2", back_after=3.0, point="before set"))
    sent = [
        s for s in history.said if s.topic == "set" and s.message.sender == "r2" and s.message.boot == "b0"
    ]
    assert sent[-1].at > 5.0  # by its next boot
    assert sent[-1].message.time < 4.5
    assert not any(reason.startswith("sets not applied") for reason in counts)


@pytest.mark.parametrize("offset", [-3.0, 3.0])
def test_a_clock_that_is_off_is_corrected_before_the_robot_measures(mission: Mission, offset: float) -> None:
    history, _ = held(mission, Clock(at=0.0, who="r1", offset=offset, drift=50e-6))
    errors = [s.message.time - s.at for s in history.said if s.topic == "set" and s.message.sender == "r1"]
    assert len(errors) > 15
    assert max(map(abs, errors)) < 0.02


def test_a_full_disk_stops_the_fusion_and_costs_no_set(mission: Mission) -> None:
    history, counts = held(mission, DiskFull(at=3.0, until=6.0, who="fusion"))
    assert sum(fact.what == "up" and fact.who == "fusion" for fact in history.facts) > 2
    assert not any(reason.startswith("sets not applied") for reason in counts)


def test_a_frozen_a_slow_and_a_dead_viewer_change_nothing_for_the_others(mission: Mission) -> None:
    """The same words at the same times as with a viewer that is well."""
    logs = []
    for faults in (
        (),
        (Stop(at=2.0, until=9.0, who="watch"),),
        (Slow(at=2.0, until=9.0, who="watch", every_s=2.0),),
    ):
        history, _ = held(mission, *faults)
        logs.append([(s.at, s.topic, s.message.sender, s.message.sequence) for s in history.said])
    assert logs[0] == logs[1] == logs[2]
    held(mission, Kill(at=2.0, who="watch"))


def test_a_router_that_dies_costs_no_set(mission: Mission) -> None:
    _, counts = held(mission, RouterDown(at=3.0, until=8.0))
    assert not any(reason.startswith("sets not applied") for reason in counts)


def test_sets_beyond_the_rollback_window_are_put_in_their_place(mission: Mission) -> None:
    """r1 is cut off three times as long as the window."""
    others = tuple(name for name in ALL if name != "r1")
    _, counts = held(mission, Cut(at=2.0, until=5.5, from_=("r1",), to=others))
    assert counts["posteriors of sets out of order"] == 1


def test_sixty_four_robots_that_join_at_once_are_heard(mission: Mission) -> None:
    first = mission.robots[0]
    robots = [
        msgspec.structs.replace(first, id=f"r{i + 1}", start=[5 + 40 * (i % 8), 5 + 40 * (i // 8), 5.0])
        for i in range(65)
    ]
    area = msgspec.structs.replace(mission.area, max=[300, 400])
    planner = {"kind": "maasi", "candidates": {"low": [15, 15], "high": [285, 385], "points": [3, 3]}}
    many = msgspec.structs.replace(mission, robots=robots, area=area, planner=planner, duration_s=2.5)
    history, counts = held(many, Join(at=1.0, who=tuple(r.id for r in robots[1:])), calm_at=1.0)
    assert counts["starts of processes"] == 67
    assert {s.message.sender for s in history.said if s.topic == "pose"} == {r.id for r in robots}
    # Looks begin one robot after the other, or all would wait for all.
    assert len({s.message.sender for s in history.said if s.topic == "set"}) > 5


def test_a_kept_run_is_checked_again_from_its_directory(mission: Mission, tmp_path: Path) -> None:
    made = trial(mission, 4, keep=True)
    assert made.history is not None
    campaign_command._keep(made, mission, tmp_path)
    again = check(RunHistory.read(tmp_path / "seed-4"))
    assert not again.violations
    assert again.counts["sets in time"] == made.report.counts["sets in time"]


def test_the_command_prints_a_failing_seed_with_what_repeats_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    import typer

    from agents.fusion.watermark import Applied

    monkeypatch.setattr(Applied, "__contains__", lambda self, message: False)  # sets count twice
    app = typer.Typer()
    app.command()(campaign_command.campaign)
    bad = next(
        seed
        for seed in range(100)
        if any(
            isinstance(f, Weather) and f.conditions.datagrams and f.conditions.duplication > 0.1
            for f in schedule_of(load("campaign"), seed).faults
        )
        and not any(isinstance(f, Kill | Join | Stop) for f in schedule_of(load("campaign"), seed).faults)
    )
    found = tmp_path / "found.json"
    ended = CliRunner().invoke(app, ["--seeds", str(bad), "--jobs", "1", "--json", str(found)])
    assert ended.exit_code == 1
    told = json.loads(found.read_text())
    record = told["failed"][0]
    (each,) = told["each"]
    assert each["seed"] == bad
    assert each["broken"] == record["broken"]
    assert each["counts"]["sets in time"] > 10
    assert each["measured"]["separation_m"] > 0.0
    assert len(each["log"]) == 64
    assert record["seed"] == bad
    assert "none twice" in record["broken"]
    assert record["repeat"] == f"searchparty campaign --seed {bad} --verbose"


def test_the_command_ends_well_when_all_holds() -> None:
    command = [sys.executable, "-m", "agents.cli", "campaign", "--seeds", "1,2", "--jobs", "1"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "2 of 2 seeds hold" in ended.stdout
