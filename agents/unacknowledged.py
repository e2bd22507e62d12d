"""A sender's own sets or soft observations that no watermark covers yet: kept, and offered again later."""

from typing import Generic, TypeVar

from agents.messages import LedgerEntry, PosteriorMessage
from agents.watermark import source, uncovered

BATCH = 64  # sets offered again in one go, so that a healed network is not flooded

LONGEST = 8.0  # times the mission's reoffer_after_s, between two offers


E = TypeVar("E", bound=LedgerEntry)


class Unacknowledged(Generic[E]):
    """Entries for the ledger in the order they were taken."""

    def __init__(self, boot: str, reoffer_after: float) -> None:
        self._boot = boot
        self._reoffer_after = reoffer_after
        self._sets: dict[int, E] = {}
        self._offer_at: float = float("inf")
        self._newest: float = 0.0
        self._wait = reoffer_after  # grows while nobody acknowledges: whoever is slow is not to be flooded
        self.reoffered = 0

    def __repr__(self) -> str:
        return f"Unacknowledged({len(self._sets)}, reoffered={self.reoffered})"

    def __len__(self) -> int:
        return len(self._sets)

    def add(self, message: E) -> None:
        """A set that was just sent for the first time."""
        if not self._sets:
            self._offer_at = message.time + self._reoffer_after
        self._sets[message.sequence] = message
        self._newest = max(self._newest, message.time)

    def acknowledge(self, sender: str, posterior: PosteriorMessage) -> None:
        """Forget what the posterior's watermark covers."""
        watermark = posterior.watermark.get(source(sender, self._boot))
        remaining = uncovered(watermark, self._sets)
        if len(remaining) == len(self._sets):
            return
        self._sets = {number: self._sets[number] for number in remaining}
        # Progress: the rest is given its time anew before it is offered again.
        self._wait = self._reoffer_after
        self._offer_at = self._newest + self._reoffer_after if self._sets else float("inf")

    def drop(self, sequence: int) -> None:
        """Forget one that will never be taken."""
        self._sets.pop(sequence, None)
        if not self._sets:
            self._offer_at = float("inf")

    def next_offer(self) -> float:
        """When `due` will have something."""
        return self._offer_at

    def due(self, now: float) -> list[E]:
        """Sets to be sent again now, oldest first."""
        if now < self._offer_at:
            return []
        self._wait = min(2.0 * self._wait, LONGEST * self._reoffer_after)
        self._offer_at = now + self._wait
        batch = [s for s in self._sets.values() if s.time <= now - 0.5 * self._reoffer_after][:BATCH]
        self.reoffered += len(batch)
        return batch
