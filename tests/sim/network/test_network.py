import numpy as np
import pytest

from agents.errors import MalformedMessage
from agents.wire import codec
from agents.wire.messages import MeasurementSetMessage
from agents.wire.topics import POSE, POSTERIOR, SET
from agents.wire.transport import Peer, PeerChange
from sim.network.conditions import NetworkConditions, Weather, corrupted
from tests.sim.scheduler import Net

R0 = Peer("robot", "r0", "b")


def test_a_message_reaches_all_others_and_not_its_sender() -> None:
    net = Net(SET, 3)
    a, b, c = net.ends
    net.say(a, 7, every=1.0)
    assert net.heard(b) == [7]
    assert [item.sender for item in c.drain()] == ["r0"]
    assert net.heard(a) == []


def test_a_topic_that_nobody_wants_goes_nowhere() -> None:
    net = Net(SET)
    a, b = net.ends
    a.publish(POSE, b"x")
    net.run(1.0)
    assert b.drain() == []


@pytest.mark.parametrize("topic", [SET, POSE])
def test_a_message_is_not_there_before_its_time(topic: object) -> None:
    net = Net(topic, delay_s=0.5, jitter_s=0.0)  # type: ignore[arg-type]
    a, b = net.ends
    net.say(a, 1, every=0.4)
    assert net.heard(b) == []
    net.run(0.2)
    assert net.heard(b) == [1]


@pytest.mark.parametrize(("loss", "duplication"), [(0.3, 0.0), (0.0, 0.5), (0.6, 0.0)])
def test_datagrams_are_lost_and_doubled_as_often_as_said(loss: float, duplication: float) -> None:
    net = Net(SET, loss=loss, duplication=duplication, datagrams=True)
    a, b = net.ends
    net.say(a, *range(2000))
    net.run(5.0)
    assert len(net.heard(b)) == pytest.approx(2000 * (1 - loss + duplication), rel=0.07)


@pytest.mark.parametrize("loss", [0.1, 0.3, 0.6])
def test_bursts_are_as_long_as_said_and_lose_as_much_as_said(loss: float) -> None:
    """Of Gilbert's channel: mean run 1 / P(leave), share P(enter) / (P(enter) + P(leave))."""
    rng, weather = np.random.default_rng(1), Weather()
    conditions = NetworkConditions(loss=loss, burst=5.0)
    lost = np.array([weather.loses(conditions, rng) for _ in range(60_000)])
    starts = np.count_nonzero(lost[1:] & ~lost[:-1])
    assert lost.mean() == pytest.approx(loss, rel=0.08)
    assert lost.sum() / starts == pytest.approx(5.0, rel=0.08)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("burst", [0.0, 6.0])
@pytest.mark.parametrize("loss", [0.3, 0.6])
def test_a_reliable_topic_gets_everything_through_in_order(loss: float, burst: float, seed: int) -> None:
    net = Net(SET, seed=seed, loss=loss, burst=burst, duplication=0.2, late=0.05, late_s=3.0)
    a, b = net.ends
    heard = []
    for number in range(60):
        net.say(a, number, every=0.25)
        heard += net.heard(b)
    net.run(8.0)
    assert heard + net.heard(b) == list(range(60))
    assert b.statistics().get("missed", 0) == 0


def test_the_last_message_is_not_lost_although_none_follows() -> None:
    net = Net(SET, loss=0.999)
    a, b = net.ends
    net.say(a, 1)
    net.network.conditions = NetworkConditions()
    net.run(1.5)
    assert net.heard(b) == [1]


def test_best_effort_stays_lost() -> None:
    net = Net(POSE, loss=0.999)
    a, b = net.ends
    net.say(a, 1)
    net.network.conditions = NetworkConditions()
    net.run(5.0)
    assert net.heard(b) == []


@pytest.mark.parametrize(("topic", "kept"), [(SET, 64), (POSTERIOR, 1)])
def test_who_joins_late_is_given_what_the_topic_keeps(topic: object, kept: int) -> None:
    net = Net(topic, 1)  # type: ignore[arg-type]
    (a,) = net.ends
    net.say(a, *range(100))
    late = net.join("late")
    net.run(1.0)
    assert net.heard(late) == list(range(100 - kept, 100))
    net.say(a, 100, every=0.1)
    assert net.heard(late) == [100]


def test_a_link_keeps_its_order_and_datagrams_do_not() -> None:
    for datagrams in (False, True):
        net = Net(SET, delay_s=0.0, jitter_s=0.5, datagrams=datagrams)
        a, b = net.ends
        net.say(a, *range(50), every=0.01)
        net.run(10.0)
        heard = net.heard(b)
        assert (heard == list(range(50))) is not datagrams
        assert sorted(heard) == list(range(50))


def test_a_cut_within_the_lease_loses_nothing_and_delivers_a_burst() -> None:
    net = Net(POSE)
    a, b = net.ends
    b.drain_peer_changes()
    net.network.cut(["r0"], ["r1"])
    net.say(a, 1, every=1.5)
    assert net.heard(b) == []
    net.network.heal(["r0"], ["r1"])
    net.run(0.1)
    assert net.heard(b) == [1]
    assert b.drain_peer_changes() == []


def test_a_longer_cut_drops_the_token_and_the_cache_gives_the_rest_after_it() -> None:
    net = Net(SET, lease_s=2.0)
    a, b = net.ends
    b.drain_peer_changes()
    net.network.cut(["r0", "r1"], ["r0", "r1"])
    net.say(a, *range(100), every=0.1)
    assert b.drain_peer_changes() == [PeerChange(R0, False)]
    net.network.heal(["r0", "r1"], ["r0", "r1"])
    net.run(2.0)
    assert b.drain_peer_changes() == [PeerChange(R0, True)]
    assert net.heard(b) == list(range(36, 100))
    assert b.statistics()["missed"] == 36


def test_a_one_way_cut_stops_one_way() -> None:
    net = Net(POSE)
    a, b = net.ends
    for end in (a, b):
        end.drain_peer_changes()
    net.network.cut(["r0"], ["r1"])
    net.run(3.0)
    net.say(a, 1)
    net.say(b, 2, every=1.0)
    assert (net.heard(a), net.heard(b)) == ([2], [])
    assert (a.drain_peer_changes(), b.drain_peer_changes()) == ([], [PeerChange(R0, False)])


def test_a_question_that_got_lost_is_asked_again_when_both_ends_meet() -> None:
    net = Net(SET, lease_s=1.0)
    a, b = net.ends
    net.network.cut(["r1"], ["r0"])  # b's questions do not reach a
    net.network.conditions = NetworkConditions(loss=0.999)
    net.say(a, 1)
    net.network.conditions = NetworkConditions()
    net.say(a, 2, every=3.0)
    assert net.heard(b) == []  # waits for the one before it
    net.network.heal(["r1"], ["r0"])
    net.run(1.5)
    assert net.heard(b) == [1, 2]


def test_what_was_cut_twice_heals_twice() -> None:
    net = Net(POSE)
    a, b = net.ends
    for _ in range(2):
        net.network.cut(["r0"], ["r1"])
    net.network.heal(["r0"], ["r1"])
    net.run(5.0)
    net.say(a, 1, every=1.0)
    assert net.heard(b) == []
    net.network.heal(["r0"], ["r1"])
    net.run(2.0)
    net.say(a, 2, every=1.0)
    assert net.heard(b) == [2]


def test_a_death_is_seen_at_once_on_an_open_link_and_at_the_lease_on_a_cut_one() -> None:
    net = Net(POSE, 3)
    a, b, c = net.ends
    for end in (b, c):
        end.drain_peer_changes()
    net.network.cut(["r0"], ["r2"])
    a.close()
    net.run(0.1)
    assert (b.drain_peer_changes(), c.drain_peer_changes()) == ([PeerChange(R0, False)], [])
    net.run(2.0)
    assert c.drain_peer_changes() == [PeerChange(R0, False)]


def test_a_process_that_died_and_came_back_in_a_short_cut_is_known_by_its_new_boot() -> None:
    net = Net(POSE)
    a, b = net.ends
    b.drain_peer_changes()
    net.network.cut(["r0"], ["r1"])
    a.close()
    net.run(0.5)
    net.join("r0", "b2")
    assert b.drain_peer_changes() == []
    net.network.heal(["r0"], ["r1"])
    net.run(0.1)
    assert b.drain_peer_changes() == [PeerChange(R0, False), PeerChange(Peer("robot", "r0", "b2"), True)]


def test_a_process_stopped_beyond_the_lease_is_given_up_and_found_again() -> None:
    net = Net(SET)
    a, b = net.ends
    b.drain_peer_changes()
    net.network.silence("r0")
    net.say(b, 1, every=0.5)
    assert b.drain_peer_changes() == [PeerChange(R0, False)]
    net.network.answer("r0")
    net.run(2.0)
    assert b.drain_peer_changes() == [PeerChange(R0, True)]
    assert net.heard(a) == [1]  # from the cache


def test_a_full_queue_gives_up_its_oldest_and_counts() -> None:
    net = Net(SET)
    a, b = net.ends
    net.say(a, *range(SET.queue + 10))
    net.run(1.0)
    assert net.heard(b)[0] == 10
    assert b.statistics()["dropped.set"] == 10
    assert b.peaks["set"] == SET.queue


@pytest.mark.parametrize("seed", range(200))
def test_no_spoiled_message_is_taken_for_a_good_one(seed: int) -> None:
    message = MeasurementSetMessage(
        team="t", sender="r1", boot="b", sequence=3, time=1.0, pose=np.ones(4), measurements=np.ones((2, 2))
    )
    payload = corrupted(codec.encode(message), np.random.default_rng(seed))
    with pytest.raises(MalformedMessage):
        codec.decode(SET, payload, team="t", sender="r1")
