"""Whole robots that share tasks, in virtual time: the processes' own code, bids on the simulated network."""

import msgspec
import pytest

from agents.mission.mission import Mission
from agents.mission.mission_file import load
from agents.team import Team
from agents.wire.messages import BidMessage, Message, PlanMessage
from agents.wire.topics import Topic
from sim.engine.engine import Engine
from sim.network.network import NetworkConditions
from tests.agents.swarm.test_swarm import write_mission


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Mission:
    made = load(write_mission(tmp_path_factory.mktemp("mission"), duration=12))
    return msgspec.structs.replace(made, planner={"kind": "cbba"}, stop_when_all_found=False)


class Run:
    """An engine that remembers bids and plans."""

    def __init__(self, mission: Mission, seed: int, loss: float = 0.0) -> None:
        self.bids: list[BidMessage] = []
        self.plans: list[PlanMessage] = []
        self.engine = Engine(Team.of(mission), seed, NetworkConditions(loss=loss), record=self._record)

    def _record(self, topic: Topic, message: Message) -> None:
        if isinstance(message, BidMessage):
            self.bids.append(message)
        elif isinstance(message, PlanMessage):
            self.plans.append(message)


def test_robots_bid_for_ever_plan_for_their_own_tasks_and_tell_which(mission: Mission) -> None:
    run = Run(mission, 0)
    summary = run.engine.run().summary()
    robots = {robot.id for robot in mission.robots}
    assert {m.sender for m in run.bids if m.time > 11.0} == robots
    own = 0
    for plan in run.plans:
        path = [m.path for m in run.bids if m.sender == plan.sender and m.time <= plan.time]
        own += bool(path) and plan.task in {task for said in path[-20:] for task in said}
    assert own > 0.7 * len(run.plans)  # the others help, where all tasks are others'
    assert summary["tasks"]["held"] >= len(robots)
    assert summary["tasks"]["double_owned_max_s"] < 1.0


def test_the_same_seed_gives_the_same_bids_bit_for_bit(mission: Mission) -> None:
    short = msgspec.structs.replace(mission, duration_s=4.0)
    hashes = set()
    for _ in range(2):
        run = Run(short, 5, loss=0.2)
        run.engine.run()
        hashes.add(run.engine.log_hash)
        assert run.bids
    assert len(hashes) == 1


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_killed_robots_tasks_have_new_holders_within_two_seconds(mission: Mission, loss: float) -> None:
    run = Run(msgspec.structs.replace(mission, duration_s=8.0), 1, loss)
    dead = run.engine.robots[0]
    run.engine.after(5.0, dead.kill)
    summary = run.engine.run().summary()
    last = [m for m in run.bids if m.sender == dead.name]
    assert last[-1].time <= 5.0
    live = [m for m in run.bids if m.sender != dead.name]
    for task in last[-1].path:
        after = [m for m in live if m.time > 5.0 and task in m.tasks]
        if after:
            assert min(m.time for m in after if task in m.path) <= 7.0
    assert summary["tasks"]["taken_over"] >= 1
    assert summary["tasks"]["takeover_max_s"] <= 2.5  # from its last word, which may be half a second old
