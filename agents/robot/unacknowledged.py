"""A sender's own sets or soft observations that no watermark covers yet: kept, and offered again later."""

from collections.abc import Iterable
from typing import Generic, TypeVar

from agents.fusion.watermark import covers, source
from agents.wire.messages import LedgerEntry, PosteriorMessage

BATCH = 64  # sets offered again in one go, so that a healed network is not flooded

LONGEST = 8.0  # times the mission's reoffer_after_s, between two offers


E = TypeVar("E", bound=LedgerEntry)
Place = tuple[str, int]  # boot, sequence


class Unacknowledged(Generic[E]):
    """Entries for the ledger in the order they were taken, of this boot and of those before it.

    What any fusion has made durable and applied is forgotten: fusions send each other what they lack.
    """

    def __init__(self, boot: str, reoffer_after: float, left: Iterable[E] = ()) -> None:
        """`left` is what earlier boots left; it is offered at once."""
        self._boot = boot
        self._reoffer_after = reoffer_after
        self._sets: dict[Place, E] = {(one.boot, one.sequence): one for one in left}
        self._offer_at: float = 0.0 if self._sets else float("inf")
        self._newest: float = 0.0
        self._wait = reoffer_after  # grows while nobody acknowledges: whoever is slow is not to be flooded
        self._offered: set[Place] = set()  # in the last offer
        self.reoffered = 0

    def __repr__(self) -> str:
        return f"Unacknowledged({len(self._sets)}, reoffered={self.reoffered})"

    def __len__(self) -> int:
        return len(self._sets)

    def add(self, message: E) -> None:
        """A set that was just sent for the first time."""
        if not self._sets:
            self._offer_at = message.time + self._reoffer_after
        self._sets[message.boot, message.sequence] = message
        self._newest = max(self._newest, message.time)

    def acknowledge(self, sender: str, posterior: PosteriorMessage) -> list[Place]:
        """Forget what the posterior's watermark covers; what that was."""
        marks = {boot: posterior.watermark.get(source(sender, boot)) for boot, _ in self._sets}
        gone = [place for place in self._sets if covers(marks[place[0]], place[1])]
        if not gone:
            return gone
        for place in gone:
            del self._sets[place]
        self._wait = self._reoffer_after
        self._offered -= set(gone)
        if not self._sets:
            self._offer_at = float("inf")
        elif self._offered or next(iter(self._sets.values())).time > self._newest - self._reoffer_after:
            # Progress: the rest is given its time anew before it is offered again.
            self._offer_at = self._newest + self._reoffer_after
        else:  # all that was offered is there: go on with the next
            self._offer_at = 0.0
        return gone

    def drop(self, sequence: int) -> None:
        """Forget one of this boot that will never be taken."""
        self._sets.pop((self._boot, sequence), None)
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
        batch = [
            one
            for one in self._sets.values()
            if one.boot != self._boot or one.time <= now - 0.5 * self._reoffer_after
        ][:BATCH]
        self._offered = {(one.boot, one.sequence) for one in batch}
        self.reoffered += len(batch)
        return batch
