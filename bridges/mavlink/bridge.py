"""One vehicle's bridge: a thread between a link and the pilot that never blocks the robot."""

from typing import Protocol

from bridges.mavlink.dialect import Message


class Errand(Protocol):
    """A protocol conversation beside flying (mission or fence upload, parameters), pure like the pilot."""

    done: bool

    def step(self, now: float, received: list[Message]) -> list[Message]:
        """What to send now; `received` are the vehicle's own messages since the last step."""


# Bridge(port, pilot, clock=time.monotonic); .start(); .want(Wanted); .report() -> Report (immutable, cheap);
# .events() -> list[Event] drained; .run(errand); .resume(); .close()
