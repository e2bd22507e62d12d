"""Virtual time for tests of the network alone."""

import heapq
from collections.abc import Callable
from itertools import count

import numpy as np

from agents.wire.topics import Topic
from agents.wire.transport import Peer
from sim.network.network import NetworkConditions, SimulatedNetwork, SimulatedTransport


class Scheduler:
    """Does things in the order of their time."""

    def __init__(self) -> None:
        self.time = 0.0
        self._heap: list[tuple[float, int, Callable[[], None]]] = []
        self._order = count()

    def post(self, delay: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._heap, (self.time + delay, next(self._order), action))

    def now(self) -> float:
        return self.time

    def run_until(self, time: float) -> None:
        while self._heap and self._heap[0][0] <= time:
            self.time, _, action = heapq.heappop(self._heap)
            action()
        self.time = time


class Net:
    """A network of a few processes, each named r0, r1, ..."""

    def __init__(self, topic: Topic, members: int = 2, seed: int = 0, **conditions: object) -> None:
        self.time = Scheduler()
        self.topic = topic
        self.network = SimulatedNetwork(
            NetworkConditions(**conditions),  # type: ignore[arg-type]
            np.random.default_rng(seed),
            self.time.post,
            self.time.now,
        )
        self.ends = [self.join(f"r{i}") for i in range(members)]

    def join(self, name: str, boot: str = "b") -> SimulatedTransport:
        transport = SimulatedTransport(self.network)
        transport.subscribe(self.topic)
        transport.open(Peer("robot", name, boot), lambda: None)
        return transport

    def run(self, seconds: float) -> None:
        self.time.run_until(self.time.time + seconds)

    def say(self, sender: SimulatedTransport, *payloads: int, every: float = 0.0) -> None:
        for payload in payloads:
            sender.publish(self.topic, payload.to_bytes(4, "big"))
            self.run(every)

    def heard(self, receiver: SimulatedTransport) -> list[int]:
        return [int.from_bytes(item.payload, "big") for item in receiver.drain()]
