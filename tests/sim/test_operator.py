"""What an operator says reaches the fusion once, whatever the network does, and leaves the same bits."""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
import pytest

from agents.fusion.fusion import Fusion, FusionSetup
from agents.ledger.ledger import Ledger
from agents.machine import Heard, Publish
from agents.mission.mission import Mission, StatementTable
from agents.mission.mission_file import WrongMissionError, dumps, load
from agents.operator.statements import said
from agents.team import Team
from agents.wire.messages import (
    EventMessage,
    LedgerEntry,
    MeasurementSetMessage,
    PosteriorMessage,
    SoftObservationMessage,
)
from agents.wire.topics import SOFT_OBSERVATION
from sim.engine.engine import Engine
from sim.network.network import NetworkConditions


@pytest.fixture(scope="module")
def mission() -> Mission:
    return msgspec.structs.replace(load("operator"), duration_s=45.0, stop_when_all_found=False)


@pytest.fixture(scope="module")
def spoken(mission: Mission) -> Engine:
    """The mission's run with seed 1, which several tests look at."""
    engine = Engine(Team.of(mission), 1)
    engine.run()
    return engine


def fusion_of(mission: Mission, seed: int = 0) -> Fusion:
    team = Team.of(mission)
    return Fusion(FusionSetup(mission, "fusion", "b0", team.search(), team.sensor_models), seed)


def statement(sequence: int = 0, time: float = 1.0, **changes: Any) -> SoftObservationMessage:
    head = {"team": "searchparty", "sender": "ann", "boot": "b0", "sequence": sequence, "time": time}
    table = StatementTable(at_s=0.0, relation="near", at=[[165.0, 150.0]], radius_m=20.0)
    return SoftObservationMessage(**{**head, **said(table), **changes})  # type: ignore[arg-type]


def measured(sequence: int, time: float) -> MeasurementSetMessage:
    return MeasurementSetMessage(
        team="searchparty",
        sender="r1",
        boot="b0",
        sequence=sequence,
        time=time,
        pose=np.array([10.0 + 8.0 * sequence, 10.0, 12.0, 0.0]),
        measurements=np.zeros((0, 2)),
    )


def step(
    fusion: Fusion, now: float, *entries: LedgerEntry
) -> tuple[list[EventMessage], PosteriorMessage | None]:
    topic = SOFT_OBSERVATION
    actions = fusion.step(now, [Heard(topic, entry) for entry in entries])
    said = [a.message for a in actions if isinstance(a, Publish)]
    events = [m for m in said if isinstance(m, EventMessage) and m.about]
    posteriors = [m for m in said if isinstance(m, PosteriorMessage)]
    return events, posteriors[-1] if posteriors else None


def same(one: Fusion, other: Fusion) -> None:
    a, b = one.search_state, other.search_state
    np.testing.assert_array_equal(a.found, b.found)
    np.testing.assert_array_equal(a.clusters.means, b.clusters.means)
    for x, y in zip(a.filter_state.mixtures, b.filter_state.mixtures, strict=True):
        np.testing.assert_array_equal(x.means, y.means)
        np.testing.assert_array_equal(x.weights, y.weights)


def test_scripted_statements_are_applied_and_said_in_words(mission: Mission, spoken: Engine) -> None:
    fusion = spoken.fusion.fusion
    assert fusion.counters["applied_soft_observations"] == len(mission.statements)
    text = "\n".join(spoken.events)
    assert "operator says: something is near (265, 45), within 20 m" in text
    assert "operator says: nothing is inside the region (0, 0), (120, 0), (120, 120), (0, 120)" in text


def test_statements_help_to_find_the_targets(mission: Mission, spoken: Engine) -> None:
    silent = Engine(Team.of(msgspec.structs.replace(mission, statements=[])), 1).run()
    assert spoken.scoreboard.summary()["targets_found"] > silent.summary()["targets_found"]


def test_same_mission_and_seed_give_the_same_log_with_statements_too(
    mission: Mission, spoken: Engine
) -> None:
    again = Engine(Team.of(mission), 1)
    again.run()
    assert again.log_hash == spoken.log_hash


@pytest.mark.parametrize("seed", [2])
def test_a_bad_network_costs_no_statement_and_a_replay_gives_the_same_bits(
    mission: Mission, seed: int
) -> None:
    bad = NetworkConditions(delay_s=0.05, jitter_s=0.3, loss=0.3, duplication=0.3)
    mission = msgspec.structs.replace(mission, duration_s=80.0)  # time to offer the last one again
    team = Team.of(mission)
    with Ledger() as ledger:
        engine = Engine(team, seed, bad, ledger=ledger)
        engine.run()
        entries = list(ledger.replay(mission.team))
        setup = FusionSetup(mission, "fusion", "b0", team.search(), team.sensor_models, ledger)
        again = Fusion(setup, seed)
        again.restore()
    fusion = engine.fusion.fusion
    stored = [e for e in entries if isinstance(e, SoftObservationMessage)]
    assert len(stored) == len(mission.statements) == fusion.counters["applied_soft_observations"]
    same(fusion, again)


def test_a_late_statement_is_put_in_its_place_among_the_sets(mission: Mission) -> None:
    sets = [measured(k, 1.0 + k) for k in range(4)]
    late, prompt = fusion_of(mission), fusion_of(mission)
    for entry in (*sets, statement(time=2.5)):
        step(late, 10.0, entry)
    for entry in sorted((*sets, statement(time=2.5)), key=lambda e: e.time):
        step(prompt, 10.0, entry)
    assert late.counters["late_soft_observations"] == 1
    same(late, prompt)


def test_a_statement_is_applied_once_and_covered_by_the_watermark(mission: Mission) -> None:
    fusion = fusion_of(mission)
    events, posterior = step(fusion, 2.0, statement())
    assert posterior is not None
    assert posterior.watermark["ann/b0"].upto == 0
    assert posterior.applied == 0  # measurement sets
    assert [(e.level, e.about) for e in events] == [("info", "ann/b0/0")]
    before = fusion.search_state
    events, _ = step(fusion, 3.0, statement())
    assert fusion.search_state is before
    assert not events
    assert fusion.counters["duplicate_soft_observations"] == 1


@pytest.mark.parametrize(
    ("changes", "reason", "words"),
    [
        ({"sender": "r1"}, "no_operator", "no operator's name"),
        ({"time": 50.0}, "from_the_future", "s ahead"),
        ({"target": "cone 3"}, "statement", "expected one of those not found yet"),
        (
            {
                "relation": "inside",
                "points": np.array([[0, 0], [9, 9], [9, 0], [0, 9.0]]),
                "inner": 0,
                "outer": 0,
            },
            "statement",
            "corners",
        ),
    ],
)
def test_what_is_refused_is_counted_by_reason_and_said_once(
    mission: Mission, changes: dict[str, Any], reason: str, words: str
) -> None:
    fusion = fusion_of(mission)
    before = fusion.search_state
    events: list[EventMessage] = []
    for _ in range(3):
        events += step(fusion, 2.0, statement(**changes))[0]
    assert fusion.counters[f"rejected.{reason}"] == 3
    assert fusion.search_state is before
    assert [e.level for e in events] == ["warning"]
    assert words in events[0].text
    assert f"{changes.get('sender', 'ann')}/b0" not in fusion.estimate.applied.watermarks()


def test_a_filter_that_takes_none_refuses_with_words(mission: Mission) -> None:
    fusion = fusion_of(msgspec.structs.replace(mission, filter={"kind": "lmb"}, statements=[]))
    events, _ = step(fusion, 2.0, statement())
    assert fusion.counters["rejected.no_soft_observations"] == 1
    assert "takes no soft observations" in events[0].text


@pytest.mark.parametrize("kind", ["mixtures", "smc_phd"])
@pytest.mark.parametrize("seed", range(3))
def test_no_statement_that_the_codec_lets_through_spoils_the_estimate(
    mission: Mission, kind: str, seed: int
) -> None:
    """Far away, huge, tiny, steep, flat: the posterior stays finite and the process alive."""
    rng = np.random.default_rng(seed)
    table = mission.filter if kind == "mixtures" else {"kind": kind, "particles": 500}
    fusion = fusion_of(msgspec.structs.replace(mission, filter=table))
    sizes: Sequence[float] = (1e-6, 1.0, 100.0, 1e4, 1e7)
    for k in range(25):
        relation = rng.choice(["near", "far", "around", "inside", "outside", "in_front", "left", "behind"])
        count = 1 if relation in ("near", "far", "around") else int(rng.integers(1, 3))
        count = int(rng.integers(3, 9)) if relation in ("inside", "outside") else count
        points = np.clip(rng.normal(size=(count, 2)) * rng.choice(sizes) + 100.0, -1e7, 1e7)
        distance = relation in ("near", "far", "around")
        inner = float(rng.choice(sizes)) * 0.5 if distance else 0.0
        message = statement(
            k,
            1.0,
            relation=str(relation),
            points=points,
            inner=inner,
            outer=2.0 * inner,
            slope=float(rng.choice([1e-6, 0.1, 1.0, 1000.0])),
            positive=bool(rng.integers(2)),
        )
        _, posterior = step(fusion, 2.0, message, measured(k, 1.0 + 0.01 * k))
        assert posterior is not None
        assert np.isfinite(posterior.expected_cardinality)
        for array in (posterior.means, posterior.covariances, posterior.found):
            assert np.isfinite(array).all()
        points, weights = fusion._search.thinned(fusion.search_state, 200)
        assert np.isfinite(points).all()
        assert np.isfinite(weights).all()


def test_statements_are_resolved_into_the_mission_and_mistakes_in_them_named(
    mission: Mission, tmp_path: Any
) -> None:
    path = tmp_path / "operator.toml"
    path.write_text(dumps(mission))
    assert load(path).statements == mission.statements
    text = path.read_text()
    path.write_text(text.replace('relation = "near"', 'relation = "inside"', 1))
    with pytest.raises(WrongMissionError, match=r"statements\[0\].*3 to 64"):
        load(path)
    path.write_text(text.replace('kind = "mixtures"', 'kind = "lmb"', 1))
    with pytest.raises(WrongMissionError, match=r"takes soft observations: .*mixtures"):
        load(path)
