import os
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agents.fusion.fusion import Fusion, FusionSetup
from agents.ledger.ledger import Ledger
from agents.machine import Heard
from agents.mission.mission import Mission
from agents.mission.mission_file import load
from agents.team import Team
from agents.wire.topics import SET
from sim.engine.engine import Engine
from sim.network.network import NetworkConditions
from tests.agents.swarm.test_swarm import write_mission


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Mission:
    return load(write_mission(tmp_path_factory.mktemp("mission"), duration=90))


@pytest.mark.parametrize("seed", range(3))
def test_a_team_in_virtual_time_finds_every_target(mission: Mission, seed: int) -> None:
    summary = Engine(Team.of(mission), seed).run().summary()
    assert summary["all_found"], f"repeat with: searchparty simulate ... --seeds {seed}"
    assert summary["false_found"] == 0
    assert summary["driver"] == "virtual"
    assert summary["messages"]["lost"] == 0
    # What was taken in the last milliseconds is still on its way.
    assert summary["messages"]["sets_not_applied"] <= summary["robots"]


def test_same_mission_and_seed_give_the_same_log_bit_for_bit(mission: Mission) -> None:
    first, second = Engine(Team.of(mission), 5), Engine(Team.of(mission), 5)
    first.run()
    second.run()
    assert first.log_hash == second.log_hash
    other = Engine(Team.of(mission), 6)
    other.run()
    assert other.log_hash != first.log_hash


def test_the_log_does_not_depend_on_the_process_that_makes_it(mission: Mission, tmp_path: Path) -> None:
    path = write_mission(tmp_path, duration=20)
    program = (
        "from agents.mission.mission_file import load; from agents.team import Team\n"
        "from sim.engine.engine import Engine\n"
        f"engine = Engine(Team.of(load({str(path)!r})), 5); engine.run(); print(engine.log_hash)"
    )
    hashes = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
            timeout=100,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(hashes) == 1


def test_a_replayed_ledger_gives_the_same_posterior_bit_for_bit(mission: Mission) -> None:
    team = Team.of(mission)
    with Ledger() as ledger:
        engine = Engine(team, 2, ledger=ledger)
        engine.run()
        again = Fusion(FusionSetup(mission, "fusion", "b0", team.search(), team.sensor_models, ledger), 2)
        again.restore()
    live, replayed = engine.fusion.fusion.search_state, again.search_state
    np.testing.assert_array_equal(live.found, replayed.found)
    np.testing.assert_array_equal(live.exploration.values, replayed.exploration.values)
    np.testing.assert_array_equal(live.clusters.means, replayed.clusters.means)


def test_lost_and_doubled_messages_cost_no_set_and_count_none_twice(mission: Mission) -> None:
    bad = NetworkConditions(delay_s=0.05, jitter_s=0.2, loss=0.3, duplication=0.2)
    engine = Engine(Team.of(mission), 1, bad)
    summary = engine.run().summary()
    fusion = engine.fusion.fusion
    assert summary["all_found"]
    assert fusion.counters["duplicate_sets"] > 0
    assert fusion.counters["late_sets"] > 0
    waiting = sum(len(node.robot.unacknowledged) for node in engine.robots)
    assert summary["measurement_sets"] - fusion.counters["applied_sets"] <= waiting


def test_late_sets_within_the_window_give_the_in_order_posterior(mission: Mission) -> None:
    """What the network did to the order leaves no trace: replaying the sets in order gives the same bits."""
    team = Team.of(mission)
    with Ledger() as ledger:
        engine = Engine(team, 3, NetworkConditions(delay_s=0.01, jitter_s=0.3), ledger=ledger)
        engine.run()
        sets = sorted(ledger.replay(mission.team), key=lambda s: (s.time, s.sender, s.sequence))
        again = Fusion(FusionSetup(mission, "fusion", "b0", team.search(), team.sensor_models), 3)
        for one in sets:
            again.step(one.time, [Heard(SET, one)])
    assert engine.fusion.fusion.counters["late_sets"] > 0
    np.testing.assert_array_equal(engine.fusion.fusion.search_state.found, again.search_state.found)


def test_a_joint_planner_plans_for_all_who_plan_at_the_same_time(mission: Mission) -> None:
    table = {**mission.planner, "kind": "maasi_joint"}
    engine = Engine(Team.of(msgspec.structs.replace(mission, planner=table, duration_s=60.0)), 0)
    summary = engine.run().summary()
    assert engine.planning.joint
    assert summary["targets_found"] >= 3


def test_event_triggered_measurements_are_fewer(mission: Mission) -> None:
    trigger = msgspec.structs.replace(mission.trigger, enabled=True, gamma=1.0, threshold=0.6)
    changed = msgspec.structs.replace(mission, trigger=trigger, stop_when_all_found=False, duration_s=30.0)
    plain = msgspec.structs.replace(mission, stop_when_all_found=False, duration_s=30.0)
    sets = [Engine(Team.of(m), 0).run().summary()["measurement_sets"] for m in (changed, plain)]
    assert sets[0] < 0.8 * sets[1]
