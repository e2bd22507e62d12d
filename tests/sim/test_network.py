import heapq
from collections.abc import Callable
from itertools import count

import numpy as np
import pytest

from agents.topics import POSE, SET
from agents.transport import Peer, PeerChange
from sim.network import NetworkConditions, SimulatedNetwork, SimulatedTransport


class Later:
    """Does things in the order of their time."""

    def __init__(self) -> None:
        self.heap: list[tuple[float, int, Callable[[], None]]] = []
        self.order = count()

    def __call__(self, delay: float, action: Callable[[], None]) -> None:
        heapq.heappush(self.heap, (delay, next(self.order), action))

    def run(self) -> None:
        while self.heap:
            heapq.heappop(self.heap)[2]()


def connected(conditions: NetworkConditions, members: int = 2) -> tuple[Later, list[SimulatedTransport]]:
    later = Later()
    network = SimulatedNetwork(conditions, np.random.default_rng(0), later)
    transports = [SimulatedTransport(network) for _ in range(members)]
    for i, transport in enumerate(transports):
        transport.open(Peer("robot", f"r{i}", "b"), lambda: None)
        transport.subscribe(SET)
    return later, transports


def test_a_message_reaches_all_others_and_not_its_sender() -> None:
    later, (a, b, c) = connected(NetworkConditions(), 3)
    a.publish(SET, b"x")
    later.run()
    assert [item.payload for item in b.drain()] == [b"x"]
    assert [item.sender for item in c.drain()] == ["r0"]
    assert a.drain() == []


def test_a_topic_that_nobody_wants_goes_nowhere() -> None:
    later, (a, b) = connected(NetworkConditions())
    a.publish(POSE, b"x")
    later.run()
    assert b.drain() == []


@pytest.mark.parametrize(("loss", "duplication"), [(0.3, 0.0), (0.0, 0.5)])
def test_loss_and_duplication_are_as_often_as_said(loss: float, duplication: float) -> None:
    later, (a, b) = connected(NetworkConditions(loss=loss, duplication=duplication))
    for _ in range(2000):
        a.publish(SET, b"x")
    later.run()
    assert len(b.drain()) == pytest.approx(2000 * (1 - loss + duplication), rel=0.05)


def test_whoever_leaves_is_missed_by_the_others() -> None:
    _, (a, b) = connected(NetworkConditions())
    assert b.drain_peer_changes() == [PeerChange(Peer("robot", "r0", "b"), True)]
    a.close()
    assert b.drain_peer_changes() == [PeerChange(Peer("robot", "r0", "b"), False)]
