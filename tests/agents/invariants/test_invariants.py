"""Each invariant is broken once, in a history made by hand, and each time only that is found."""

import msgspec
import numpy as np
import pytest

from agents.invariants.crashes import SAFETY, crash_safety
from agents.invariants.history import Size, Used
from agents.invariants.motion import COLLISION, no_collision
from agents.invariants.replay import DETERMINISM, replays
from agents.invariants.resources import RESOURCES, bounded_resources
from agents.invariants.sets import ECHO, LOST, TWICE, no_echo, no_set_lost, none_twice, recovery_limit_s
from agents.invariants.staleness import STALE, _clocks, bounded_staleness
from agents.invariants.tasks import TASKS, agreement_limit_s, conflict_free_tasks
from agents.wire.messages import BeliefMessage, EstimateMessage, HealthMessage
from tests.agents.invariants.stories import (
    END,
    Story,
    bid_of,
    header,
    mission,
    pose_of,
    posterior_of,
    set_of,
    told,
)

LIMIT = recovery_limit_s(mission())


def with_set(arrives: float | None) -> Story:
    """Robot r1 takes a set at 1 s; the fusion tells of it at some time, if at all."""
    story = Story()
    one = set_of("r1", 0, 1.0)
    story.say(1.0, "set", one)
    story.history.ledgers["fusion"] = [] if arrives is None else [one]
    if arrives is not None:
        story.say(arrives, "posterior", told([one], 0))
    return story


# No set lost


def test_a_set_that_came_is_not_lost() -> None:
    report = with_set(1.1).check(no_set_lost)
    assert not report.violations
    assert report.counts["sets in time"] == 1
    assert report.measured["set_to_fusion_s"] == pytest.approx(0.1)


@pytest.mark.parametrize("arrives", [None, 1.0 + LIMIT + 0.5])
def test_a_set_of_a_connected_robot_that_does_not_come_in_time_is_lost(arrives: float | None) -> None:
    assert with_set(arrives).check(no_set_lost).broken == [LOST]


def test_after_a_heal_a_set_has_the_limit_from_there() -> None:
    for arrives, lost in ((10.0 + LIMIT - 0.5, []), (10.0 + LIMIT + 0.5, [LOST])):
        story = with_set(arrives)
        story.history.tell(0.5, "cut", "r1", other="fusion")
        story.history.tell(10.0, "healed", "r1", other="fusion")
        assert story.check(no_set_lost).broken == lost


@pytest.mark.parametrize(
    ("what", "reason"),
    [
        ("down", "its robot died and did not come back"),
        ("cut", "its robot was cut off to the end"),
        ("fusion", "the fusion is dead"),
    ],
)
def test_a_set_that_could_not_come_is_counted_by_reason(what: str, reason: str) -> None:
    story = with_set(None)
    if what == "cut":
        story.history.tell(1.0, "cut", "fusion", other="r1")  # one way is enough: nobody acknowledges
    else:
        story.history.tell(1.0, "down", "fusion" if what == "fusion" else "r1")
    report = story.check(no_set_lost)
    assert not report.violations
    assert report.counts[f"sets not applied: {reason}"] == 1


def test_a_robot_that_comes_back_brings_what_it_left() -> None:
    story = with_set(None)
    story.history.tell(1.5, "down", "r1")
    story.history.tell(3.0, "up", "r1", role="robot", boot="b1")
    assert story.check(no_set_lost).broken == [LOST]


# None twice


def test_a_set_that_is_twice_in_a_ledger_is_found() -> None:
    story = with_set(1.1)
    story.history.ledgers["fusion"] = [set_of("r1", 0, 1.0)] * 2
    assert story.check(none_twice).broken == [TWICE]


def test_a_posterior_of_more_sets_than_there_are_is_found() -> None:
    story = with_set(None)
    story.say(2.0, "posterior", told([set_of("r1", 0, 1.0)], 0, applied=2))
    assert story.check(none_twice).broken == [TWICE]


def out_of_order() -> tuple[Story, list]:  # type: ignore[type-arg]
    sets = [set_of("r1", i, 1.0 + i) for i in range(3)] + [set_of("r2", i, 1.5 + i) for i in range(3)]
    story = Story()
    story.history.ledgers["fusion"] = sets
    return story, sets


def test_a_robots_belief_of_more_sets_than_there_are_is_found() -> None:
    for applied, broken in ((1, []), (2, [TWICE])):
        story = with_set(1.1)
        posterior = told([set_of("r1", 0, 1.0)], 0)
        fields = {name: getattr(posterior, name) for name in EstimateMessage.__struct_fields__}
        own = BeliefMessage(**fields | header("r2", 0, 1.0) | {"applied": applied})
        story.say(1.2, "belief", own)
        report = story.check(none_twice)
        assert report.broken == broken
        assert report.counts["beliefs of robots"] == 1


def test_sets_out_of_order_must_give_the_posterior_of_their_order() -> None:
    story, sets = out_of_order()
    story.say(6.0, "posterior", posterior_of(sets, 0))
    report = story.check(replays)
    assert not report.violations
    assert report.counts["posteriors of sets out of order"] == 1


def test_a_posterior_off_by_one_bit_is_found() -> None:
    story, sets = out_of_order()
    good = posterior_of(sets, 0)
    wrong = msgspec.structs.replace(good, expected_cardinality=np.nextafter(good.expected_cardinality, 0.0))
    story.say(6.0, "posterior", wrong)
    assert story.check(replays).broken == [TWICE]


def test_a_recorded_run_that_replays_to_another_posterior_is_found() -> None:
    story, sets = out_of_order()
    sets.sort(key=lambda s: s.time)
    good = posterior_of(sets, 0)
    story.say(
        6.0, "posterior", msgspec.structs.replace(good, expected_cardinality=0.5 * good.expected_cardinality)
    )
    assert story.check(replays).broken == [DETERMINISM]


# No echo


def test_what_another_said_again_is_an_echo() -> None:
    """Around a cycle of robots: r2 sends on, as its own, what r1 measured."""
    story = Story()
    one = set_of("r1", 0, 1.0)
    echo = msgspec.structs.replace(one, sender="r2")
    story.say(1.0, "set", one)
    story.say(1.2, "set", echo)
    story.history.ledgers["fusion"] = [one, echo]
    assert story.check(no_echo).broken == [ECHO]


def test_a_ledger_that_holds_something_else_than_was_said_is_found() -> None:
    story = with_set(1.1)
    story.history.ledgers["fusion"] = [set_of("r1", 0, 1.0001)]
    assert story.check(no_echo).broken == [ECHO]


def test_a_posterior_that_is_surer_than_its_sets_is_an_echo() -> None:
    story, sets = out_of_order()
    good = posterior_of(sets, 0)
    story.say(
        6.0, "posterior", msgspec.structs.replace(good, expected_cardinality=good.expected_cardinality + 1.0)
    )
    assert ECHO in story.check(replays).broken


# Conflict-free tasks


@pytest.mark.parametrize(("seconds", "broken"), [(0.5, []), (agreement_limit_s(mission()) + 1.0, [TASKS])])
def test_two_owners_for_long_are_a_conflict(seconds: float, broken: list[str]) -> None:
    story = Story()
    for i, robot in enumerate(("r1", "r2")):
        story.say(2.0 + 0.1 * i, "bid", bid_of(robot, 0, 2.0, {"t": robot}))
    story.say(2.1 + seconds, "bid", bid_of("r2", 1, 2.1 + seconds, {"t": "r1"}))
    report = story.check(conflict_free_tasks)
    assert report.broken == broken
    assert report.measured["double_ownership_s"] == pytest.approx(seconds)


def test_two_owners_that_cannot_hear_each_other_are_none() -> None:
    story = Story()
    story.history.tell(1.0, "cut", "r1", other="r2")
    for robot in ("r1", "r2"):
        story.say(2.0, "bid", bid_of(robot, 0, 2.0, {"t": robot}))
    assert not story.check(conflict_free_tasks).violations


def test_a_task_that_waits_for_the_dead_is_an_orphan() -> None:
    story = Story()
    story.history.tell(5.0, "down", "r2")
    for i in range(int(END)):
        story.say(i, "bid", bid_of("r1", i, i, {"t": "r2"}))
    assert story.check(conflict_free_tasks).broken == [TASKS]


# No collision


@pytest.mark.parametrize(("gap", "broken"), [(3.01, []), (2.9, [COLLISION])])
def test_robots_nearer_than_their_separation_are_found(gap: float, broken: list[str]) -> None:
    assert mission().settings.separation_m == 3.0
    story = Story()
    story.places(1.0, r1=(0.0, 0.0, 5.0), r2=(10.0, 0.0, 5.0))
    story.places(2.0, r1=(0.0, 0.0, 5.0), r2=(gap, 0.0, 5.0))
    report = story.check(no_collision)
    assert report.broken == broken
    assert report.measured["separation_m"] == pytest.approx(gap)


# Bounded staleness


def test_deciding_by_what_is_too_old_is_found() -> None:
    for age, broken in ((1.9, []), (2.5, [STALE])):
        story = Story(robots=())
        story.history.used.append(Used(5.0, "r1", "pose", "r2", age))
        assert story.check(bounded_staleness).broken == broken


@pytest.mark.parametrize(("off", "broken"), [(0.04, []), (-0.04, []), (0.2, [STALE]), (-3.0, [STALE])])
def test_a_set_whose_time_is_not_the_teams_is_found(off: float, broken: list[str]) -> None:
    story = Story()
    story.say(5.0, "set", set_of("r1", 0, 5.0 + off))
    report = story.check(_clocks)
    assert report.broken == broken
    assert report.measured["capture_time_error_s"] == pytest.approx(abs(off))


def test_a_set_that_a_later_boot_brings_may_be_old() -> None:
    story = Story()
    story.history.tell(6.0, "down", "r1")
    story.history.tell(7.0, "up", "r1", role="robot", boot="b1")
    story.say(7.1, "set", set_of("r1", 0, 5.0))
    assert not story.check(_clocks).violations


def test_a_robot_that_stands_still_because_others_are_silent_is_found() -> None:
    for silent, broken in ((False, []), (True, [STALE])):
        story = Story(robots=("r1",))
        for i in range(121):
            if not (silent and 40 <= i < 48):
                story.say(0.25 * i, "pose", pose_of("r1", i, 0.25 * i))
        for i in range(31):
            story.say(float(i), "set", set_of("r1", i, float(i)))
        assert story.check(bounded_staleness).broken == broken


# Bounded resources


def test_a_queue_beyond_its_bound_is_found() -> None:
    for waiting, broken in ((256.0, []), (257.0, [RESOURCES])):
        story = Story()
        story.history.sizes.append(Size(1.0, "r1", "b0", "queue of pose", waiting, 256.0))
        assert story.check(bounded_resources).broken == broken


@pytest.mark.parametrize(("per_minute", "broken"), [(0.0, []), (20.0, [RESOURCES])])
def test_memory_that_grows_is_found(per_minute: float, broken: list[str]) -> None:
    story = Story()
    for i in range(300):
        gauges = {"memory_mb": 150.0 + per_minute * i / 60.0 + 2.0 * (i % 2)}
        story.say(
            float(i),
            "health",
            HealthMessage(
                **header("r1", i, float(i)),
                role="robot",
                state="x",
                counters={},
                gauges=gauges,
                histograms={},
            ),
        )
    assert story.check(bounded_resources).broken == broken


# Crash safety


def test_a_boot_id_used_again_is_found() -> None:
    for boot, broken in (("b1", []), ("b0", [SAFETY])):
        story = Story()
        story.history.tell(5.0, "down", "r1")
        story.history.tell(6.0, "up", "r1", role="robot", boot=boot)
        assert story.check(crash_safety).broken == broken


def test_a_number_used_for_two_messages_is_found() -> None:
    story = Story()
    story.say(1.0, "set", set_of("r1", 0, 1.0))
    story.say(2.0, "set", set_of("r1", 0, 1.0))  # offered again: the same
    assert not story.check(crash_safety).violations
    story.say(3.0, "set", set_of("r1", 0, 3.0))
    assert story.check(crash_safety).broken == [SAFETY]


def test_what_was_acknowledged_and_is_not_in_the_ledger_is_found() -> None:
    story = with_set(1.1)
    story.history.ledgers["fusion"] = []
    assert story.check(crash_safety).broken == [SAFETY]


def test_a_fusion_that_forgot_by_a_restart_is_found() -> None:
    story = with_set(1.1)
    story.history.tell(2.0, "down", "fusion")
    story.history.tell(3.0, "up", "fusion", role="fusion", boot="b1")
    mark = told([set_of("r1", 0, 1.0)], 0).watermark["r1/b0"]
    empty = {"r1/b0": msgspec.structs.replace(mark, upto=-1)}
    story.say(3.1, "posterior", msgspec.structs.replace(told([], 0, "b1"), watermark=empty))
    assert story.check(crash_safety).broken == [SAFETY]
