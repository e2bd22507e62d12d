"""Robots that hear no fusion find targets by what they and their peers measure, and count nothing twice."""

from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agents.machine import Action, Publish, Reckon, Stamp
from agents.mission.mission_file import load
from agents.robot.alone import MOST, Alone, AloneSetup
from agents.robot.belief import Belief
from agents.team import Team
from agents.wire.messages import BeliefMessage, EventMessage, LedgerEntry, PosteriorMessage, StateMessage
from agents.wire.topics import SET
from sim.engine.engine import Engine
from tests.agents.fusion.test_watermark import measurement_set
from tests.agents.ledger_story import SEED, Stage, story, team
from tests.agents.swarm.test_swarm import write_mission

AFTER_S = 5.0


class Cast:
    """A robot's own estimate, its belief, and a driver that does its work at once."""

    def __init__(self, robot: str = "r1") -> None:
        the_team = team()
        mission = the_team.mission
        setup = AloneSetup(mission, the_team.search(), the_team.sensor_models, SEED, "one")
        self.alone = Alone(setup, robot, 0.0)
        self.belief = Belief(
            robot, the_team.area, tuple(mission.exploration.points), the_team.sensor_models, {}
        )
        self.stamp = Stamp(mission.team, robot, "b")

    def step(self, now: float) -> list[Action]:
        actions = self.alone.step(now, self.stamp, self.belief)
        for action in actions:
            if isinstance(action, Reckon):
                action.work()
                self.alone.reckoned(action.number)
        return actions

    def run(self, begin: float, end: float) -> list[Action]:
        now, actions = begin, []
        while now <= end:
            actions += self.step(now)
            now = max(now + 0.05, min(self.alone.next_wake(), now + 1.0))
        return actions

    def hear(self, entries: Sequence[LedgerEntry]) -> None:
        for entry in entries:
            self.alone.hear(entry)


def fused(entries: Sequence[LedgerEntry]) -> tuple[Stage, PosteriorMessage, StateMessage]:
    stage = Stage(team())
    stage.hear(entries)
    return stage, stage.fusion._posterior(), stage.fusion._state()


def test_from_the_shared_state_it_comes_to_the_bits_that_the_fusion_would_have_come_to() -> None:
    entries = story()
    half = len(entries) // 2
    _, posterior, state = fused(entries[:half])
    whole, _, _ = fused(entries)
    cast = Cast()
    cast.hear(entries[: half // 2])  # all of which the state holds
    cast.alone.hear_posterior(10.0, posterior)
    cast.alone.hear_state(state)
    cast.hear([*entries[half - 10 :], *entries[half:]])  # some are in the state, all the rest come twice
    cast.run(10.0, 30.0)
    believed = cast.belief.posterior
    assert isinstance(believed, BeliefMessage)
    assert believed.applied == len(entries)
    np.testing.assert_array_equal(believed.found, whole.fusion.search_state.found)
    np.testing.assert_array_equal(believed.means, whole.fusion.search_state.clusters.means)


def test_without_a_shared_state_it_goes_by_what_it_heard_from_the_beginning() -> None:
    whole, _, _ = fused(story())
    cast = Cast()
    cast.hear(story())
    cast.run(0.0, 10.0)
    assert cast.belief.posterior is not None
    np.testing.assert_array_equal(cast.belief.posterior.found, whole.fusion.search_state.found)


def test_a_state_of_other_code_is_not_believed() -> None:
    _, _, state = fused(story()[:30])
    cast = Cast()
    cast.alone.hear_state(msgspec.structs.replace(state, state=b"x" * 200))
    cast.hear(story()[30:60])
    cast.run(0.0, 10.0)
    assert cast.belief.posterior is not None
    assert cast.belief.posterior.applied == 30


def test_it_filters_only_while_no_fusion_is_heard_and_says_so() -> None:
    entries = story()
    _, posterior, _ = fused(entries)
    cast = Cast()
    for second in range(20):
        cast.alone.hear_posterior(float(second), posterior)
        cast.hear([entries[second]])
        assert cast.step(float(second)) == []
    assert not cast.alone.alone
    actions = cast.run(19.0, 19.0 + AFTER_S - 0.1)
    assert actions == []
    actions = cast.run(19.0 + AFTER_S, 40.0)
    said = [a.message for a in actions if isinstance(a, Publish)]
    words = [m.text for m in said if isinstance(m, EventMessage)]
    assert words == ["r1 hears no fusion: it goes on with the sets that it knows"]
    assert sum(isinstance(m, BeliefMessage) for m in said) >= 10
    assert not any(isinstance(m, PosteriorMessage) for m in said)
    cast.alone.hear_posterior(41.0, posterior)  # holds more than the robot does
    (back,) = cast.step(41.0)
    assert isinstance(back, Publish)
    assert isinstance(back.message, EventMessage)
    assert back.message.text == "r1 hears a fusion again"
    assert not cast.alone.alone
    cast.belief.hear_posterior(posterior, 41.0)
    assert cast.belief.posterior is posterior


def test_a_fusion_that_is_back_with_less_is_believed_only_when_it_has_caught_up_or_stayed() -> None:
    entries = story()
    _, behind, _ = fused(entries[:20])
    cast = Cast()
    cast.hear(entries)
    cast.run(AFTER_S, 10.0)
    for now in np.arange(10.0, 10.0 + AFTER_S, 0.5):
        cast.alone.hear_posterior(float(now), behind)
        cast.belief.hear_posterior(behind, float(now))
        cast.step(float(now))
        assert cast.alone.alone
        assert cast.belief.posterior is not None
        assert cast.belief.posterior.applied == len(entries)
    cast.alone.hear_posterior(10.0 + AFTER_S, behind)
    cast.belief.hear_posterior(behind, 10.0 + AFTER_S)
    cast.step(10.0 + AFTER_S)
    assert not cast.alone.alone
    assert cast.belief.posterior is behind


def test_what_it_keeps_is_bounded() -> None:
    cast = Cast()
    for sequence in range(MOST + 50):
        cast.alone.hear(measurement_set(sequence))
    assert len(cast.alone._kept) == MOST


def test_sets_of_nobody_in_the_mission_or_of_another_size_are_not_applied() -> None:
    cast = Cast()
    cast.hear([measurement_set(0, robot="stranger")])
    entry = story()[0]
    cast.hear([msgspec.structs.replace(entry, measurements=np.zeros((1, 3)))])
    cast.run(AFTER_S, 7.0)
    assert cast.belief.posterior is not None
    assert cast.belief.posterior.applied == 0


@pytest.fixture(scope="module")
def the_team(tmp_path_factory: pytest.TempPathFactory) -> Team:
    return Team.of(load(write_mission(tmp_path_factory.mktemp("mission"), duration=120)))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_team_whose_fusion_is_killed_for_good_finds_every_target(the_team: Team, seed: int) -> None:
    engine = Engine(the_team, seed)
    engine.after(3.0, engine.fusion.kill)
    summary = engine.run().summary()
    before = [e for e in engine.events if "targets found" in e and float(e.split()[0]) < 3.0]
    assert len(before) < 4, "all were found before the fusion died: the test shows nothing"
    assert summary["all_found"], f"seed {seed}"
    assert summary["false_found"] == 0
    assert summary["estimate_of"].startswith("r")
    assert engine.robots[0].robot.state.endswith("alone")


def test_a_fusion_that_comes_back_has_every_set_once_and_the_robots_drop_their_own_estimates(
    the_team: Team,
) -> None:
    mission = msgspec.structs.replace(the_team.mission, stop_when_all_found=False, duration_s=45.0)
    engine = Engine(Team.of(mission), 4)
    engine.after(5.0, engine.fusion.kill)
    engine.after(25.0, engine.fusion.start)
    engine.after(25.0, engine.fusion.wake)
    engine.run()
    text = "\n".join(engine.events)
    assert text.count("hears no fusion") == text.count("hears a fusion again") == 3
    assert not any(node.robot.alone.alone for node in engine.robots if node.robot.alone)
    fusion = engine.fusion.fusion
    taken = sum(node.robot.stamp.sent(SET) for node in engine.robots)
    waiting = sum(len(node.robot.unacknowledged) for node in engine.robots)
    assert taken - fusion.estimate.sets <= waiting <= 12  # of the last moments
