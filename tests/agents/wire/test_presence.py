"""Who is there when tokens of several boots come and go in any order."""

import itertools

import pytest

from agents.wire.presence import Presence
from agents.wire.transport import Peer, PeerChange


def change(boot: str, alive: bool, name: str = "r1", role: str = "robot") -> PeerChange:
    return PeerChange(Peer(role, name, boot), alive)


def test_the_late_end_of_an_old_boot_takes_nobody_away() -> None:
    there = Presence("robot")
    told = [there.take(change("b0", True)), there.take(change("b1", True)), there.take(change("b0", False))]
    assert told == [True, None, None]
    assert "r1" in there
    assert there.take(change("b1", False)) is False
    assert there.names() == set()


def test_who_starts_again_after_its_end_was_told_went_and_came() -> None:
    there = Presence("robot")
    story = (change("b0", True), change("b0", False), change("b1", True))
    assert [there.take(one) for one in story] == [True, False, True]


def test_the_end_of_somebody_whose_begin_was_never_told_is_an_end() -> None:
    assert Presence("robot").take(change("b0", False)) is False


def test_other_roles_are_not_its_concern() -> None:
    there = Presence("fusion")
    assert there.take(change("b0", True)) is None
    assert there.take(change("b0", True, "fusion", "fusion")) is True
    assert there.names() == {"fusion"}


@pytest.mark.parametrize("order", list(itertools.permutations(range(4))))
def test_however_the_tokens_of_two_boots_are_told_the_last_word_of_each_counts(
    order: tuple[int, ...],
) -> None:
    changes = [change("b0", True), change("b0", False), change("b1", True), change("b1", False)]
    there, standing = Presence("robot"), set[str]()
    for i in order:
        there.take(changes[i])
        (standing.add if changes[i].alive else standing.discard)(changes[i].peer.boot)
    assert ("r1" in there) == bool(standing)
