"""A process at the other end of the network, for tests and benchmarks: ENDPOINT ID BEHAVIOUR."""

import os
import signal
import sys
import threading

from agents.mission.mission import LinkTable
from agents.wire.topics import POSE, SET
from agents.wire.transport import Peer
from bridges.zenoh.transport import ZenohTransport

TEAM = "test"


class Defect(Exception):
    """What the behaviour "raise" dies of."""


def main(endpoint: str, name: str, behaviour: str) -> None:
    arrived = threading.Event()
    with ZenohTransport(LinkTable(), TEAM, endpoints=(endpoint,)) as transport:
        transport.open(Peer("robot", name, f"{name}-{os.getpid()}"), arrived.set)
        transport.subscribe(SET)
        transport.subscribe(POSE)
        transport.publish(SET, b"hello")
        if behaviour == "exit on signal":
            # The rudest correct end: close in the handler, with messages coming in.
            signal.signal(signal.SIGTERM, lambda *_: (transport.close(), sys.exit(7)))
        print("ready", flush=True)
        if behaviour == "raise":
            raise Defect
        while True:
            arrived.wait()
            arrived.clear()
            for item in transport.drain():
                if behaviour == "echo" and item.topic is SET:
                    transport.publish(SET, item.payload)


if __name__ == "__main__":
    main(*sys.argv[1:])
