"""The posterior is a function of the set of entries: bit for bit, whatever died, split or came late."""

import random

import pytest

from agents.fusion.estimate import MARK_EVERY, MARKS, _least_missed
from agents.machine import Heard, Keep, Publish
from agents.wire.messages import LedgerMessage, Relayed, RelayMessage, StateMessage
from agents.wire.topics import LEDGER, RELAY, SET
from agents.wire.transport import Peer, PeerChange
from tests.agents.ledger_story import Stage, story, team

WINDOW_S = 5.0


@pytest.fixture(scope="module")
def in_order() -> Stage:
    stage = Stage(team())
    stage.hear(story())
    return stage


def test_the_story_is_long_enough_to_leave_marks_and_fill_more_than_the_window(in_order: Stage) -> None:
    entries = story()
    assert len(entries) > 100
    assert entries[-1].time - entries[0].time > 5 * WINDOW_S
    assert in_order.fusion.estimate.sets == len(entries)


@pytest.mark.parametrize("seed", range(4))
def test_any_order_of_arrival_gives_the_same_bits(in_order: Stage, seed: int) -> None:
    """Also far beyond the rollback window, doubled, and in batches."""
    entries = [*story(), *story()[::3]]
    draw = random.Random(seed)
    draw.shuffle(entries)
    stage = Stage(team())
    while entries:
        size = draw.choice([1, 1, 7, 40])
        batch, entries = entries[:size], entries[size:]
        stage.hear_together(batch)
    stage.settle()
    counters = stage.fusion.counters
    assert counters["late_sets"] > 20, f"seed {seed} shuffles nothing beyond the window"
    assert counters["duplicate_sets"] == len(story()[::3])
    assert stage.posterior() == in_order.posterior(), f"repeat with seed {seed}"
    assert stage.holds() == in_order.holds()


@pytest.mark.parametrize("seed", range(3))
def test_a_killed_fusion_goes_on_as_if_it_had_never_died(in_order: Stage, seed: int) -> None:
    draw = random.Random(seed)
    stage = Stage(team())
    entries = sorted(story(), key=lambda e: e.time + draw.expovariate(0.5))  # by network delays of 2 s
    deaths = set(draw.sample(range(len(entries)), 5))
    for i, entry in enumerate(entries):
        stage.hear([entry])
        if i in deaths:
            stage.begin()
    stage.settle()
    assert stage.posterior() == in_order.posterior(), f"repeat with seed {seed}"


def test_what_is_told_is_stored_first() -> None:
    """No watermark is said before the `Store` that it covers."""
    stage = Stage(team())
    for entry in story()[:20]:
        actions = stage.step(1e3, Heard(SET, entry))
        kinds = [type(a).__name__ + (a.topic.name if isinstance(a, Publish) else "") for a in actions]
        assert kinds.index("Store") < kinds.index("Publishposterior")


def test_late_sets_beyond_the_window_come_to_their_places_a_slice_at_a_time(in_order: Stage) -> None:
    """New sets meanwhile are applied at once: they do not wait for the late ones."""
    missing = [e for e in story() if e.sender == "r2" and 5.0 < e.time < 25.0]
    late = set(map(id, missing))
    entries = [e for e in story() if id(e) not in late]
    stage = Stage(team())
    stage.hear(entries[:-10])
    before = stage.fusion.estimate.sets
    stage.hear_together(missing)
    assert stage.fusion.estimate.settling
    assert stage.fusion.estimate.sets == before  # they are durable, and not yet told of
    assert stage.fusion.next_wake() == 0.0
    stage.step(1e3, Heard(SET, entries[-10]))
    assert stage.fusion.estimate.sets == before + 1
    stage.hear(entries[-9:])
    stage.settle()
    assert stage.fusion.estimate.sets == len(story())
    assert stage.posterior() == in_order.posterior()


def test_a_fusion_that_dies_while_late_sets_are_on_their_way_has_them_afterwards(in_order: Stage) -> None:
    missing = [e for e in story() if e.sender == "r1" and e.time < 20.0]
    late = set(map(id, missing))
    stage = Stage(team())
    stage.hear([e for e in story() if id(e) not in late])
    stage.hear_together(missing)
    assert stage.fusion.estimate.settling
    stage.begin()
    assert not stage.fusion.estimate.settling
    assert stage.posterior() == in_order.posterior()


def test_where_late_sets_expire_they_are_counted_with_a_reason_and_change_nothing() -> None:
    the_team = team(late_sets="expire")
    missing = [e for e in story() if e.sender == "r3" and 5.0 < e.time < 15.0]
    late = set(map(id, missing))
    entries = [e for e in story() if id(e) not in late]
    stage, without = Stage(the_team), Stage(the_team)
    without.hear(entries)
    stage.hear(entries)
    before = stage.posterior()
    stage.hear(missing)
    assert stage.fusion.search_state.sets == without.fusion.search_state.sets
    assert stage.fusion.counters["expired_sets"] == len(missing)
    assert {row.expired for row in stage.ledger.rows()} == {"", "late"}
    assert stage.posterior() != before  # it says how many expired
    stage.begin()  # and a restart changes nothing of it
    assert stage.fusion.counters["expired_sets"] == len(missing)
    assert stage.fusion.estimate.sets == len(entries)
    stage.hear(missing)  # they are acknowledged, so they count as duplicates from now on
    assert stage.fusion.counters["duplicate_sets"] == len(missing)


def exchange(now: float, *stages: Stage) -> None:
    """One round in which every fusion hears what the others tell, and what they send then."""
    told = [[m for m in stage.said if isinstance(m, LedgerMessage | RelayMessage)] for stage in stages]
    for stage in stages:
        stage.said.clear()
    for stage in stages:
        for i, messages in enumerate(told):
            if stages[i] is not stage:
                topics = [(LEDGER if isinstance(m, LedgerMessage) else RELAY, m) for m in messages]
                stage.step(now, *(Heard(topic, message) for topic, message in topics))
    for stage in stages:
        stage.settle(now)


def replicas(late_sets: str = "apply") -> tuple[Stage, Stage]:
    the_team = team(replicas=2, late_sets=late_sets)
    return Stage(the_team, name="fusion"), Stage(the_team, name="fusion-2")


@pytest.mark.parametrize("late_sets", ["apply", "expire"])
def test_two_halves_of_a_team_come_to_the_same_bits_after_the_partition(late_sets: str) -> None:
    """Each half has a fusion and none of the other's sets for 20 s; nobody offers any set again."""
    one, other = replicas(late_sets)
    for entry in story():
        split = 10.0 < entry.time < 30.0
        if not split or entry.sender == "r1":
            one.hear([entry], now=entry.time)
        if not split or entry.sender != "r1":
            other.hear([entry], now=entry.time)
    assert one.posterior() != other.posterior()
    for round_ in range(6):
        exchange(100.0 + round_, one, other)
    assert one.posterior() == other.posterior()
    assert one.holds() == other.holds()
    total = one.fusion.estimate.sets
    assert total == len(story()) if late_sets == "apply" else total <= len(story())
    together = Stage(team())
    together.hear(story())
    if late_sets == "apply":
        assert one.posterior() == together.posterior()
    rows = [sorted((r.robot, r.boot, r.sequence, r.expired) for r in s.ledger.rows()) for s in (one, other)]
    assert rows[0] == rows[1]
    one.begin()
    assert one.posterior() == other.posterior()


def test_what_any_fusion_applied_in_time_no_other_lets_expire() -> None:
    one, other = replicas("expire")
    late = [e for e in story() if e.sender == "r2" and 20.0 < e.time < 24.0]
    for entry in story():
        other.hear([entry], now=entry.time)
        if entry not in late:
            one.hear([entry], now=entry.time)
    one.hear(late, now=60.0)
    assert one.fusion.counters["expired_sets"] == len(late) > 2
    for round_ in range(4):
        exchange(100.0 + round_, one, other)
    assert one.fusion.counters["expired_sets"] == 0
    assert one.fusion.counters["revived_sets"] == len(late)
    assert one.posterior() == other.posterior()


def test_a_fusion_with_an_empty_ledger_gets_all_from_the_other_though_the_robots_are_dead() -> None:
    one, other = replicas()
    one.hear(story(), now=60.0)
    for round_ in range(8):
        exchange(100.0 + round_, one, other)
    assert other.holds() == one.holds()
    assert other.posterior() == one.posterior()


def test_fusions_that_hold_the_same_send_each_other_nothing() -> None:
    one, other = replicas()
    for stage in (one, other):
        stage.hear(story(), now=60.0)
        stage.said.clear()
    for round_ in range(3):
        exchange(100.0 + round_, one, other)
    assert one.fusion.counters["relayed"] == other.fusion.counters["relayed"] == 0


def test_damaged_relays_are_counted_by_reason_and_change_nothing() -> None:
    one, _ = replicas()
    message = RelayMessage(
        team="searchparty",
        sender="fusion-2",
        boot="b",
        sequence=0,
        time=0.0,
        entries=[
            Relayed(topic="set", sender="r1", payload=b"nonsense"),
            Relayed(topic="plan", sender="r1", payload=b""),
        ],
    )
    one.step(1.0, Heard(RELAY, message))
    assert one.fusion.counters["rejected.not_msgpack"] == 1
    assert one.fusion.counters["rejected.wrong_type"] == 1
    assert one.fusion.estimate.sets == 0


def test_only_the_first_of_several_fusions_says_what_all_of_them_know() -> None:
    one, other = replicas()
    for stage, peer in ((one, "fusion-2"), (other, "fusion")):
        stage.step(0.0, PeerChange(Peer("fusion", peer, "b"), True))
    assert one.fusion.replicas.leads
    assert not other.fusion.replicas.leads
    other.step(0.0, PeerChange(Peer("fusion", "fusion", "b"), False))
    assert other.fusion.replicas.leads


def test_the_whole_state_is_shared_as_often_as_the_mission_says() -> None:
    stage = Stage(team(share_state_s=10.0))
    for second in range(31):
        stage.step(float(second))
    assert sum(isinstance(m, StateMessage) for m in stage.said) == 4
    never = Stage(team(share_state_s=0.0))
    never.step(0.0)
    assert not any(isinstance(m, StateMessage) for m in never.said)


def test_a_set_from_the_future_is_refused_until_it_is_of_now() -> None:
    """It would make the sets of all others late."""
    stage = Stage(team())
    entry = story()[100]
    stage.hear([entry], now=entry.time - WINDOW_S - 0.5)
    assert stage.fusion.counters["rejected.from_the_future"] == 1
    stage.hear([entry], now=entry.time - WINDOW_S + 0.5)
    assert stage.fusion.estimate.sets == 1


def test_marks_are_kept_close_to_the_present_and_ever_wider_apart_before() -> None:
    counts: list[int] = []
    for k in range(1, 2000):
        counts.append(k * MARK_EVERY)
        if len(counts) > MARKS:
            del counts[_least_missed(counts)]
    ages = [counts[-1] - c for c in counts]
    assert len(counts) == MARKS
    assert ages[-2] == MARK_EVERY
    assert counts[0] == MARK_EVERY
    for age in (10_000, 50_000, 200_000, 400_000):  # back to a time, no more than twice that is redone
        assert min(a for a in ages if a >= age) <= 2.5 * age


def test_a_checkpoint_is_kept_durable_once_for_every_mark(monkeypatch: pytest.MonkeyPatch) -> None:
    every = 32
    monkeypatch.setattr("agents.fusion.estimate.MARK_EVERY", every)
    entries = story()
    stage = Stage(team())
    kept = [a for e in entries for a in stage.step(1e3, Heard(SET, e)) if isinstance(a, Keep)]
    assert len(kept) == (len(entries) - 20) // every
    assert [c.key for c in stage.ledger.checkpoints()] == [a.checkpoint.key for a in kept]
    before = stage.posterior()
    stage.begin()
    assert stage.fusion.estimate.counters["reapplied_sets"] == 0
    assert stage.posterior() == before
