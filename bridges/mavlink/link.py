"""A link in a thread of its own, for those who have no loop (tools, the simulated vehicle).

A robot's bridge needs no second thread: `bridge.Bridge` polls its port itself.
"""

import threading
from collections import Counter, deque
from collections.abc import Callable
from types import TracebackType

from bridges.mavlink.dialect import Message
from bridges.mavlink.port import LinkState, Port
from bridges.mavlink.signing import Keys

QUEUE = 2000


class Link:
    """Bounded queues on both sides: neither `send` nor `drain` ever waits; what does not fit is counted."""

    def __init__(
        self,
        url: str,
        source: tuple[int, int] = (1, 191),
        keys: Keys | None = None,
        heed: Callable[[int, int, int], bool] | None = None,
    ) -> None:
        self._port = Port(url, source, keys, heed)
        self._out: deque[Message] = deque()
        self._in: deque[Message] = deque(maxlen=QUEUE)
        self._arrived = threading.Event()
        self._ending = False
        self._thread = threading.Thread(target=self._run, name=f"mavlink {url}", daemon=True)

    def __repr__(self) -> str:
        return f"Link({self._port!r})"

    def __enter__(self) -> "Link":
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def counters(self) -> Counter[str]:
        return self._port.counters

    def start(self) -> None:
        """Begin to open the line, and to send and receive."""
        self._thread.start()

    def send(self, message: Message) -> bool:
        """Queue a message; False: the queue is full and the message dropped."""
        if len(self._out) >= QUEUE:
            self.counters["overflows.out"] += 1
            return False
        self._out.append(message)
        self._port.wake()
        return True

    def drain(self) -> list[Message]:
        """All messages since the last time, in order."""
        self._arrived.clear()
        found: list[Message] = []
        while self._in:
            found.append(self._in.popleft())
        return found

    def wait(self, timeout: float) -> bool:
        """Whether something has arrived within `timeout` seconds."""
        return self._arrived.wait(timeout)

    def state(self) -> LinkState:
        """Whether the line is open, and what it noticed."""
        return self._port.state()

    def close(self) -> None:
        """End the thread and let go of the line."""
        self._ending = True
        self._port.wake()
        if self._thread.is_alive():
            self._thread.join(3.0)

    def _run(self) -> None:
        try:
            while not self._ending:
                found = self._port.poll(0.2)
                if len(self._in) + len(found) > QUEUE:
                    self.counters["overflows.in"] += len(self._in) + len(found) - QUEUE
                self._in.extend(found)
                if found:
                    self._arrived.set()
                while self._out:
                    self._port.send([self._out.popleft()])
        finally:
            self._port.close()
