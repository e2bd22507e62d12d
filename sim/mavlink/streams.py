"""Which messages are due: only those that somebody asked for, at the rate that was asked for."""

NEVER = -1


class Streams:
    """Intervals by message id, in s."""

    def __init__(self) -> None:
        self._due: dict[int, tuple[float, float]] = {}  # interval, when next

    def __repr__(self) -> str:
        return f"Streams({ {key: interval for key, (interval, _) in self._due.items()} })"

    def set(self, message_id: int, interval: float, now: float) -> None:
        """Send it every `interval` seconds from now on; 0 or less: no more."""
        if interval <= 0.0:
            self._due.pop(message_id, None)
        else:
            self._due[message_id] = (interval, now + interval)

    def interval_us(self, message_id: int) -> int:
        """As MESSAGE_INTERVAL tells it: -1 for one that is not sent."""
        return round(self._due[message_id][0] * 1e6) if message_id in self._due else NEVER

    def due(self, now: float) -> list[int]:
        """The ids that are to be sent now."""
        ready = [key for key, (_, when) in self._due.items() if when <= now + 1e-9]
        for key in ready:
            interval, when = self._due[key]
            self._due[key] = (interval, max(when + interval, now))  # never a burst to catch up
        return ready
