import random

import pytest

from agents.fusion.timeline import Arrival, Key, Timeline

Log = tuple[str, ...]


def note(state: Log, entry: str) -> Log:
    return (*state, entry)


def key(time: float, robot: str = "r1", sequence: int = 0) -> Key:
    return (time, robot, "b", sequence)


def test_entries_in_order_are_applied_once_each() -> None:
    timeline = Timeline((), note, 10.0)
    arrivals = [timeline.insert(key(t), str(t)) for t in (1.0, 2.0, 3.0)]
    assert timeline.state == ("1.0", "2.0", "3.0")
    assert arrivals == [Arrival.IN_ORDER] * 3
    assert timeline.reapplied == 0


@pytest.mark.parametrize("seed", range(20))
def test_any_order_within_the_window_gives_the_in_order_state(seed: int) -> None:
    entries = [(key(float(t), robot), f"{t}{robot}") for t in range(10) for robot in ("r1", "r2")]
    shuffled = list(entries)
    random.Random(seed).shuffle(shuffled)
    timeline = Timeline((), note, 100.0)
    for k, entry in shuffled:
        timeline.insert(k, entry)
    assert timeline.state == tuple(entry for _, entry in entries)


def test_same_capture_time_is_ordered_by_robot() -> None:
    timeline = Timeline((), note, 10.0)
    timeline.insert(key(1.0, "r2"), "r2")
    assert timeline.insert(key(1.0, "r1"), "r1") is Arrival.ROLLED_BACK
    assert timeline.state == ("r1", "r2")


def test_entry_older_than_the_window_is_not_put_in() -> None:
    timeline = Timeline((), note, 5.0)
    timeline.insert(key(10.0), "ten")
    assert timeline.insert(key(4.9), "late") is Arrival.TOO_LATE
    assert timeline.state == ("ten",)


def test_entry_before_what_was_let_go_is_too_late_even_if_the_newest_is_near() -> None:
    timeline = Timeline((), note, 5.0)
    for t in (1.0, 2.0, 7.5):
        timeline.insert(key(t), str(t))
    assert timeline.insert(key(1.5), "1.5") is Arrival.TOO_LATE
    assert timeline.insert(key(3.0), "3.0") is Arrival.ROLLED_BACK
    assert timeline.state == ("1.0", "2.0", "3.0", "7.5")


def test_appended_entry_keeps_its_place_through_later_rollbacks() -> None:
    timeline = Timeline((), note, 5.0)
    timeline.insert(key(10.0), "10")
    timeline.append("late")
    timeline.insert(key(9.0), "9")
    timeline.insert(key(11.0), "11")
    assert timeline.state == ("9", "10", "late", "11")


def test_memory_is_bounded_by_the_window() -> None:
    timeline = Timeline(0, lambda state, entry: state + entry, 5.0)
    for t in range(1000):
        timeline.insert(key(float(t)), 1)
    assert timeline.state == 1000
    assert "kept=6" in repr(timeline)


@pytest.mark.parametrize("seed", range(20))
def test_entries_put_in_together_give_the_state_of_one_by_one_with_less_done_again(seed: int) -> None:
    draw = random.Random(seed)
    entries = [(key(t / 4, draw.choice(["r1", "r2"]), t), str(t)) for t in range(60)]
    draw.shuffle(entries)
    together, single = Timeline((), note, 6.0), Timeline((), note, 6.0)
    while entries:
        batch = sorted(entries[:9])
        entries = entries[9:]
        for k, entry in batch:
            if single.insert(k, entry) is Arrival.TOO_LATE:
                single.append(entry)
        late = [entry for k, entry in batch if together.too_late(k)]
        items = [(k, entry) for k, entry in batch if not together.too_late(k)]
        for entry in late:
            together.append(entry)
        together.insert_all(items)
        assert together.state == single.state
    assert together.reapplied < single.reapplied
