"""What the estimate may read of its ledger: entries that left its memory, in the order in which they apply.

`agents.ledger.ledger.Ledger` is it. What is read here was stored before: an agent's `Store` actions are
carried out before its next step.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from agents.wire.messages import LedgerEntry, Watermark

Identity = tuple[str, str, int]  # sender, boot, sequence
Key = tuple[float, str, str, int]  # capture time, sender, boot, sequence: the order in which entries apply


def identity(entry: LedgerEntry) -> Identity:
    """What no two entries share."""
    return entry.sender, entry.boot, entry.sequence


def key(entry: LedgerEntry) -> Key:
    """Where an entry stands in the order."""
    return entry.time, entry.sender, entry.boot, entry.sequence


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """The state after all entries up to a key, and after no other."""

    key: Key
    entries: int  # that the state holds
    payload: bytes  # see agents.ledger.snapshot


@dataclass(frozen=True, slots=True)
class Contents:
    """What a ledger holds."""

    watermarks: Mapping[str, Watermark]  # by source, all its ranges; the expired ones too
    expired: Mapping[str, Watermark]  # by source
    sets: int  # applied
    statements: int  # applied soft observations
    newest: float | None  # capture time of the newest applied entry


class History(Protocol):
    """Entries that were stored. Expired ones are none of `between`."""

    def contents(self) -> Contents:
        """All that is known of it without reading the entries."""

    def checkpoints(self) -> list[Checkpoint]:
        """Those that still hold, the oldest first."""

    def between(self, after: Key | None, upto: Key | None, limit: int) -> Sequence[LedgerEntry]:
        """The first `limit` entries with after < key <= upto, by key; None is no bound."""

    def of(self, source: str, first: int, last: int, limit: int) -> Sequence[LedgerEntry]:
        """The first `limit` entries of a source with these numbers, the expired ones too."""
