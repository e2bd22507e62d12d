import numpy as np

from agents.fusion.watermark import OLD_BOOTS, RANGES, Applied, counted, covered, covers, uncovered
from agents.wire.messages import MeasurementSetMessage, Watermark


def measurement_set(sequence: int, robot: str = "r1", boot: str = "b1") -> MeasurementSetMessage:
    return MeasurementSetMessage(
        team="t",
        sender=robot,
        boot=boot,
        sequence=sequence,
        time=float(sequence),
        pose=np.zeros(4),
        measurements=np.zeros((0, 2)),
    )


def test_sets_in_a_row_move_the_mark_and_a_gap_keeps_what_is_beyond_it() -> None:
    applied = Applied()
    for sequence in (0, 1, 4, 3):
        applied.add(measurement_set(sequence))
    assert applied.watermarks() == {"r1/b1": Watermark(upto=1, beyond=[(3, 4)])}
    applied.add(measurement_set(2))
    assert applied.watermarks() == {"r1/b1": Watermark(upto=4, beyond=[])}


def test_membership_tells_boots_and_robots_apart() -> None:
    applied = Applied()
    applied.add(measurement_set(0))
    assert measurement_set(0) in applied
    assert measurement_set(1) not in applied
    assert measurement_set(0, boot="b2") not in applied
    assert measurement_set(0, robot="r2") not in applied


def test_uncovered_are_those_above_the_mark_and_not_beyond() -> None:
    assert uncovered(Watermark(upto=1, beyond=[(3, 3)]), range(5)) == [2, 4]
    assert uncovered(None, [0, 1]) == [0, 1]


def test_a_sender_that_starts_again_a_thousand_times_makes_no_message_longer() -> None:
    applied = Applied()
    for boot in range(1000):
        applied.add(measurement_set(0, boot=f"b{boot}"))
    told = applied.watermarks()
    assert len(told) <= 1 + OLD_BOOTS
    assert told["r1/b999"] == Watermark(upto=0)
    assert len(applied.all()) == 1000


def test_an_old_boot_is_told_of_again_as_soon_as_somebody_offers_sets_of_it() -> None:
    applied = Applied()
    for boot in range(1000):
        applied.add(measurement_set(0, boot=f"b{boot}"))
    assert "r1/b3" not in applied.watermarks()
    applied.asked("r1/b3")
    assert applied.watermarks()["r1/b3"] == Watermark(upto=0)


def test_a_gap_that_never_closes_makes_no_message_longer() -> None:
    applied = Applied()
    for sequence in range(1, 5000):
        applied.add(measurement_set(sequence))
    assert applied.watermarks() == {"r1/b1": Watermark(upto=-1, beyond=[(1, 4999)])}
    for sequence in range(6000, 9000, 2):
        applied.add(measurement_set(sequence))
    mark = applied.watermarks()["r1/b1"]
    assert len(mark.beyond) == RANGES
    assert covers(mark, 6000)
    assert not covers(mark, 8998)  # untold: it is offered again, and counted as a duplicate
    assert measurement_set(8998) in applied


def test_what_is_told_in_full_gives_the_same_again() -> None:
    applied = Applied()
    for sequence in (0, 1, 5, 6, 9):
        applied.add(measurement_set(sequence))
    again = Applied(applied.all())
    assert again.all() == applied.all() == {"r1/b1": Watermark(upto=1, beyond=[(5, 6), (9, 9)])}
    assert counted(again.mark("r1/b1")) == 5
    assert list(covered(again.mark("r1/b1"))) == [(0, 1), (5, 6), (9, 9)]
