"""Round trip of a measurement set between two processes through the router of a local swarm.

The interesting part is not the wire (tens of microseconds) but how quickly idle processes wake up, so the
pauses between messages are those of a slow sensor and of a fast one.
"""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from agents.mission.mission import LinkTable
from agents.wire import codec
from agents.wire.messages import MeasurementSetMessage
from agents.wire.topics import SET
from agents.wire.transport import Peer, Transport
from bridges.zenoh.local_router import Router
from bridges.zenoh.transport import ZenohTransport
from tests.bridges.zenoh_child import TEAM

DEADLINE_S = 5.0


def measurement_set(sequence: int) -> bytes:
    """Twelve range-bearing-elevation measurements, a busy instant."""
    message = MeasurementSetMessage(
        team=TEAM,
        sender="a",
        boot="b",
        sequence=sequence,
        time=0.0,
        pose=np.zeros(4),
        measurements=np.ones((12, 3)),
    )
    return codec.encode(message)


@pytest.fixture
def link() -> Iterator[tuple[Transport, threading.Event]]:
    """This process's end of the network, with an echo in another process."""
    arrived = threading.Event()
    with Router(LinkTable()) as router, ZenohTransport(LinkTable(), TEAM, endpoints=router.endpoints) as here:
        here.open(Peer("robot", "here", "1"), arrived.set)
        here.subscribe(SET)
        command = [sys.executable, "-m", "tests.bridges.zenoh_child", router.endpoint, "there", "echo"]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as echo:
            try:
                assert echo.stdout is not None
                echo.stdout.readline()
                yield here, arrived
            finally:
                echo.kill()


@pytest.mark.parametrize(("pause_s", "rounds"), [(0.2, 20), (0.025, 120)], ids=["slow", "40hz"])
def test_link_round_trip(
    link: tuple[Transport, threading.Event], benchmark: Any, pause_s: float, rounds: int
) -> None:
    transport, arrived = link
    times: list[float] = []
    payload = measurement_set(0)

    def rest() -> None:
        time.sleep(pause_s)
        arrived.clear()
        transport.drain()

    def there_and_back() -> None:
        began = time.perf_counter()
        transport.publish(SET, payload)
        while not any(item.payload == payload for item in transport.drain()):
            assert arrived.wait(DEADLINE_S), "no answer"
            arrived.clear()
        times.append((time.perf_counter() - began) * 1e3)

    benchmark.pedantic(there_and_back, setup=rest, rounds=rounds, warmup_rounds=3)
    measured = times[-rounds:]
    p99 = round(float(np.percentile(measured, 99)), 3)
    benchmark.extra_info.update(unit="ms", more={"p99": p99, "payload_bytes": len(payload)})
    assert transport.statistics()["missed"] == 0
