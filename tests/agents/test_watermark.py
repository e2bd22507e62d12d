import numpy as np

from agents.messages import MeasurementSetMessage, Watermark
from agents.watermark import Applied, uncovered


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
    assert applied.watermarks() == {"r1/b1": Watermark(upto=1, beyond=[3, 4])}
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
    assert uncovered(Watermark(upto=1, beyond=[3]), range(5)) == [2, 4]
    assert uncovered(None, [0, 1]) == [0, 1]
