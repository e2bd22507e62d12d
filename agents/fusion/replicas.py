"""How several fusions come to hold the same entries: each tells what it holds, the others send what it lacks.

A robot forgets a set as soon as one fusion says that it is durable and applied; that the other fusions get
it too is their own affair, also when the robot is dead by then. Once a second each tells of a part of its
ledger (LedgerMessage). Whoever holds more of it sends those entries as their senders sent them
(RelayMessage), and the receiver takes them as if they had come from there: each once, each in its place.
So all end up with the same set of entries, and the estimate is a function of that set.

Where late sets expire, one may have come in time to one fusion and too late to another. What any of them
applied, all apply: expired is what is expired everywhere.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from agents.errors import MalformedMessage
from agents.fusion.estimate import Estimate
from agents.fusion.watermark import Applied, covered
from agents.ledger.history import History
from agents.machine import Stamp
from agents.wire import codec
from agents.wire.messages import (
    LedgerEntry,
    LedgerMessage,
    MeasurementSetMessage,
    Relayed,
    RelayMessage,
    Watermark,
)
from agents.wire.presence import Presence
from agents.wire.topics import LEDGER, RELAY, SET, SOFT_OBSERVATION
from agents.wire.transport import PeerChange

PERIOD_S = 1.0  # between two messages of what is held
PAGE = 400  # sources told of in one
BATCH = 128  # entries in one relay message
MOST = 1024  # entries sent in answer to one message
UNDERWAY_S = 1.0  # a set that is younger may still be on its way by itself

_TOPICS = {topic.name: topic for topic in (SET, SOFT_OBSERVATION)}


@dataclass(frozen=True, slots=True)
class Difference:
    """What follows from another's message."""

    relayed: Sequence[LedgerEntry]  # that it lacks
    revived: Sequence[LedgerEntry]  # that it applied and this one let expire, by growing key


class Replicas:
    """One fusion's part in it."""

    def __init__(self, name: str, names: Sequence[str]) -> None:
        self._name = name
        self._fusions = Presence("fusion")
        self._several = len(names) > 1
        self._page = 0

    def __repr__(self) -> str:
        return f"Replicas({self._name}, others={self._fusions!r})"

    @property
    def any(self) -> bool:
        """Whether there is anybody to tell."""
        return self._several or bool(self._fusions.names())

    @property
    def leads(self) -> bool:
        """Whether it is this one that tells people what all of them know."""
        mine = (len(self._name), self._name)
        return all(mine < (len(other), other) for other in self._fusions.names())

    def notice(self, change: PeerChange) -> None:
        """A fusion came or went."""
        if change.peer.id != self._name:
            self._fusions.take(change)

    def told(self, stamp: Stamp, now: float, estimate: Estimate) -> LedgerMessage:
        """The next part of what is held."""
        names = estimate.applied.names()
        begin = self._page if self._page < len(names) else 0
        end = begin + PAGE
        self._page = end
        page = names[begin:end]
        expired = {name: estimate.expired.full(name) for name in page}
        return LedgerMessage(
            **stamp.header(LEDGER, now),
            first="" if begin == 0 else names[begin],
            last="" if end >= len(names) else names[end],
            holds={name: estimate.applied.full(name) for name in page},
            expired={name: mark for name, mark in expired.items() if mark.upto >= 0 or mark.beyond},
        )

    def differences(
        self, now: float, told: LedgerMessage, estimate: Estimate, history: History
    ) -> Difference:
        """What another that told this lacks, and what it has better."""
        relayed: list[LedgerEntry] = []
        for name in estimate.applied.names():
            if name < told.first or (told.last and name >= told.last) or len(relayed) >= MOST:
                continue
            lacking = _beyond(estimate.applied.full(name), told.holds.get(name))
            found = _read(history, name, lacking, MOST - len(relayed))
            relayed += [entry for entry in found if entry.time <= now - UNDERWAY_S]
        revived: list[LedgerEntry] = []
        for name, holds in told.holds.items():
            applied = _beyond(holds, told.expired.get(name))
            mine = [number for number in _numbers(estimate.expired, name) if _within(number, applied)]
            for number in mine:
                revived += history.of(name, number, number, 1)
        revived.sort(key=lambda entry: (entry.time, entry.sender, entry.boot, entry.sequence))
        return Difference(relayed, revived)

    def relays(self, stamp: Stamp, now: float, entries: Sequence[LedgerEntry]) -> list[RelayMessage]:
        """Messages that carry entries."""
        batches = [entries[i : i + BATCH] for i in range(0, len(entries), BATCH)]
        return [
            RelayMessage(
                **stamp.header(RELAY, now),
                entries=[Relayed(topic=_topic(e), sender=e.sender, payload=codec.encode(e)) for e in batch],
            )
            for batch in batches
        ]


def opened(relay: RelayMessage) -> tuple[list[LedgerEntry], list[str]]:
    """The entries in a message, and why others in it are none."""
    entries, refused = [], []
    for item in relay.entries:
        try:
            topic = _TOPICS.get(item.topic)
            if topic is None:
                raise MalformedMessage("wrong_type", f"no topic of the ledger: {item.topic}")
            entry = codec.decode(topic, item.payload, team=relay.team, sender=item.sender)
        except MalformedMessage as error:
            refused.append(error.reason)
            continue
        assert isinstance(entry, LedgerEntry)
        entries.append(entry)
    return entries, refused


def _topic(entry: LedgerEntry) -> str:
    return SET.name if isinstance(entry, MeasurementSetMessage) else SOFT_OBSERVATION.name


def _beyond(mine: Watermark, theirs: Watermark | None) -> list[tuple[int, int]]:
    """Ranges that one watermark covers and the other does not."""
    left: list[tuple[int, int]] = []
    other = list(covered(theirs))
    for first, last in covered(mine):
        begin = first
        for low, high in other:
            if high < begin or low > last:
                continue
            if low > begin:
                left.append((begin, low - 1))
            begin = max(begin, high + 1)
        if begin <= last:
            left.append((begin, last))
    return left


def _read(history: History, name: str, ranges: Iterable[tuple[int, int]], limit: int) -> list[LedgerEntry]:
    found: list[LedgerEntry] = []
    for first, last in ranges:
        if len(found) >= limit:
            break
        found += history.of(name, first, last, limit - len(found))
    return found


def _numbers(applied: Applied, name: str) -> Iterable[int]:
    return (number for first, last in covered(applied.full(name)) for number in range(first, last + 1))


def _within(number: int, ranges: Iterable[tuple[int, int]]) -> bool:
    return any(first <= number <= last for first, last in ranges)
