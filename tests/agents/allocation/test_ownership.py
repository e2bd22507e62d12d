"""Who held which task when, from robots' words alone."""

import numpy as np
import pytest

from agents.allocation.ownership import Ownership
from agents.wire.messages import BidMessage


def word(robot: str, *slots: str) -> BidMessage:
    return BidMessage(
        team="t",
        sender=robot,
        boot="b",
        sequence=0,
        time=0.0,
        said=0.0,
        tasks=[],
        places=np.zeros((0, 2)),
        path=list(slots),
        winning_bids=dict.fromkeys([*slots, "other"], 1.0),
        winning_agents=dict.fromkeys(slots, robot) | {"other": "somebody"},
        timestamps={},
        digests={},
    )


def heard(*words: tuple[float, str, tuple[str, ...]]) -> Ownership:
    made = Ownership(silent_s=2.0)
    for time, robot, slots in words:
        made.hear(word(robot, *slots), time)
    return made


def test_a_task_is_held_from_the_first_word_of_it_to_the_first_without() -> None:
    made = heard((1.0, "a", ("s", "t")), (2.0, "a", ("s",)), (3.5, "a", ()))
    spans = {h.slot: (h.start, h.end, h.silent) for h in made.holdings(4.0)}
    assert spans == {"t": (1.0, 2.0, False), "s": (1.0, 3.5, False)}


def test_what_two_robots_hold_at_once_is_counted_and_the_longest_spell_too() -> None:
    made = heard(
        (0.0, "a", ("s",)),
        (1.0, "b", ("s", "t")),
        (1.5, "a", ()),  # 0.5 s of s
        (2.0, "a", ("t",)),
        (2.2, "b", ("s",)),  # 0.2 s of t
        (3.0, "a", ("t",)),
        (3.0, "b", ("s",)),
    )
    summary = made.summary(3.0)
    assert summary is not None
    assert summary["double_owned_s"] == pytest.approx(0.7)
    assert summary["double_owned_max_s"] == pytest.approx(0.5)
    assert (summary["held"], summary["handed_over"], summary["taken_over"]) == (2, 2, 0)
    assert summary["takeover_max_s"] is None


def test_of_a_robot_that_falls_silent_tasks_are_taken_over_and_not_held_twice() -> None:
    alive = [(t, "b", ("s",) if t >= 5.5 else ()) for t in np.arange(0.0, 12.0, 0.5).tolist()]
    made = heard(*sorted([(4.0, "a", ("s",)), (5.0, "a", ("s",)), *alive]))
    summary = made.summary(11.5)
    assert summary is not None
    assert (summary["taken_over"], summary["handed_over"]) == (1, 0)
    assert summary["takeover_max_s"] == pytest.approx(0.5)
    assert summary["double_owned_s"] == 0.0
    # It comes back and says the same again: until b yields both hold it.
    made.hear(word("a", "s"), 12.0)
    made.hear(word("b"), 12.1)
    assert made.summary(12.1)["double_owned_s"] == pytest.approx(0.1)  # type: ignore[index]


def test_where_nobody_bids_there_is_no_summary() -> None:
    assert Ownership().summary(10.0) is None
