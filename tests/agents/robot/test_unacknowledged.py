import numpy as np

from agents.robot.unacknowledged import BATCH, Unacknowledged
from agents.wire.messages import PosteriorMessage, Watermark
from tests.agents.fusion.test_watermark import measurement_set


def posterior(**watermark: Watermark) -> PosteriorMessage:
    return PosteriorMessage(
        team="t",
        sender="fusion",
        boot="f",
        sequence=0,
        time=0.0,
        watermark={name.replace("_", "/"): mark for name, mark in watermark.items()},
        applied=0,
        expected_cardinality=0.0,
        means=np.zeros((2, 0)),
        covariances=np.zeros((0, 2, 2)),
        masses=np.zeros(0),
        radii=np.zeros(0),
        velocities=np.zeros((2, 0)),
        found=np.zeros((2, 0)),
        found_covariances=np.zeros((0, 2, 2)),
        found_velocities=np.zeros((2, 0)),
        found_times=np.zeros(0),
        found_labels=np.zeros(0, np.int64),
    )


def test_what_the_watermark_covers_is_forgotten() -> None:
    waiting = Unacknowledged("b1", 2.0)
    for sequence in range(3):
        waiting.add(measurement_set(sequence))
    waiting.acknowledge("r1", posterior(r1_b1=Watermark(upto=0, beyond=[(2, 2)])))
    assert len(waiting) == 1
    waiting.acknowledge("r1", posterior(r1_b1=Watermark(upto=2)))
    assert len(waiting) == 0
    assert waiting.next_offer() == float("inf")


def test_another_boots_watermark_covers_nothing() -> None:
    waiting = Unacknowledged("b1", 2.0)
    waiting.add(measurement_set(0))
    waiting.acknowledge("r1", posterior(r1_b2=Watermark(upto=9)))
    assert len(waiting) == 1


def test_sets_without_a_watermark_are_offered_again_until_they_have_one() -> None:
    waiting = Unacknowledged("b1", 2.0)
    waiting.add(measurement_set(0))
    assert waiting.due(1.9) == []
    assert [s.sequence for s in waiting.due(2.0)] == [0]
    assert waiting.due(5.9) == []
    assert [s.sequence for s in waiting.due(6.0)] == [0]
    assert waiting.reoffered == 2


def test_offers_come_ever_more_rarely_while_nobody_answers_and_soon_again_once_someone_does() -> None:
    waiting = Unacknowledged("b1", 2.0)
    waiting.add(measurement_set(0))
    offers = [now for now in range(100) if waiting.due(float(now))]
    assert offers == [2, 6, 14, 30, 46, 62, 78, 94]
    waiting.add(measurement_set(100))
    waiting.acknowledge("r1", posterior(r1_b1=Watermark(upto=0)))
    assert waiting.next_offer() == 102.0


def test_a_long_silence_is_offered_again_in_batches() -> None:
    waiting = Unacknowledged("b1", 2.0)
    for sequence in range(500):
        waiting.add(measurement_set(sequence))
    assert len(waiting.due(600.0)) == BATCH
