"""How often a vehicle says what, measured."""

from collections import Counter

from bridges.mavlink.dialect import Message


class RateMeter:
    """An errand that listens for some seconds and sends nothing."""

    def __init__(self, seconds: float) -> None:
        self.done = False
        self.counts: Counter[str] = Counter()
        self._seconds = seconds
        self._begin: float | None = None

    def __repr__(self) -> str:
        return f"RateMeter({dict(self.counts)})"

    def rates(self) -> dict[str, float]:
        """Hz of every message type heard, by name."""
        return {name: count / self._seconds for name, count in sorted(self.counts.items())}

    def step(self, now: float, received: list[Message]) -> list[Message]:
        """Count."""
        if self._begin is None:
            self._begin = now
        elif not self.done:
            self.counts.update(message.get_type() for message in received)
            self.done = now - self._begin >= self._seconds
        return []
