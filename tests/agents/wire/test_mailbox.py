from agents.wire import codec
from agents.wire.mailbox import Mailbox
from agents.wire.topics import POSTERIOR, SET
from agents.wire.transport import Received
from tests.agents.fusion.test_watermark import measurement_set
from tests.agents.robot.test_unacknowledged import posterior


def received(*sequences: int) -> list[Received]:
    return [Received(SET, "r1", codec.encode(measurement_set(s))) for s in sequences]


def test_good_messages_come_out_in_order() -> None:
    mailbox = Mailbox("t", lambda text: None)
    heard = mailbox.open(received(0, 1))
    assert [item.message.sequence for item in heard] == [0, 1]
    assert mailbox.counters["received"] == 2
    assert mailbox.lost == 0


def test_a_bad_message_is_counted_by_reason_and_told_once_per_sender() -> None:
    told: list[str] = []
    mailbox = Mailbox("t", told.append)
    assert mailbox.open([Received(SET, "r1", b"\xff\x00")] * 3 + [Received(SET, "r2", b"")]) == []
    assert mailbox.counters["rejected"] == 4
    assert sum(v for k, v in mailbox.counters.items() if k.startswith("rejected.")) == 4
    assert len(told) == 2


def test_a_message_under_another_senders_key_is_refused() -> None:
    mailbox = Mailbox("t", lambda text: None)
    assert mailbox.open([Received(SET, "r2", codec.encode(measurement_set(0)))]) == []
    assert mailbox.counters["rejected.wrong_sender"] == 1


def test_gaps_count_as_lost_until_they_are_filled() -> None:
    mailbox = Mailbox("t", lambda text: None)
    mailbox.open(received(0, 3))
    assert mailbox.lost == 2
    mailbox.open(received(2))
    assert mailbox.lost == 1
    assert mailbox.counters["recovered"] == 1


def test_a_copy_counts_as_duplicate() -> None:
    mailbox = Mailbox("t", lambda text: None)
    mailbox.open(received(0, 1, 1, 0))
    assert mailbox.counters["duplicate"] == 2


def test_latest_only_topics_may_skip_numbers() -> None:
    mailbox = Mailbox("t", lambda text: None)
    mailbox.open([Received(POSTERIOR, "fusion", codec.encode(posterior()))])
    assert mailbox.lost == 0
