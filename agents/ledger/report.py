"""What a ledger holds: by sender and boot how many, from when, what is missing, late or expired."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

from agents.fusion.watermark import counted, of_numbers
from agents.ledger.ledger import Ledger, Row
from agents.wire.topics import SET

ROLLBACK_S = 5.0  # where a ledger of an earlier version does not say what it was


@dataclass
class Source:
    """One boot of one robot or operator."""

    robot: str
    boot: str
    kind: str  # "set" or "soft_observation"
    stored: int = 0
    first_s: float = float("inf")  # capture times, team s
    last_s: float = float("-inf")
    overtaken: int = 0  # came after a newer one, within the rollback window
    late: int = 0  # came later than that
    latest_s: float = 0.0  # the most that one was behind the newest that had come before
    expired: dict[str, int] = field(default_factory=dict)  # by reason
    missing: int = 0  # numbers below the last that are not there
    gaps: list[tuple[int, int]] = field(default_factory=list)  # first and last of each


@dataclass(frozen=True, slots=True)
class Report:
    """One ledger."""

    path: Path
    facts: dict[str, str | None]  # as the fusion remembered them
    sources: tuple[Source, ...]
    digest: str  # of all entries, in whatever order they came: the same for fusions that hold the same

    @property
    def sets(self) -> int:
        return sum(source.stored for source in self.sources if source.kind == SET.name)

    @property
    def expired(self) -> dict[str, int]:
        """By reason."""
        total: Counter[str] = Counter()
        for source in self.sources:
            total.update(source.expired)
        return dict(total)

    def plain(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return {
            "path": str(self.path),
            **self.facts,
            "sets": self.sets,
            "expired": self.expired,
            "digest": self.digest,
            "sources": [asdict(source) for source in self.sources],
        }


def report(ledger: Ledger, path: Path) -> Report:
    """Read a whole ledger.

    Raises:
        StorageError: if it cannot be read.
    """
    names = ("mission", "fusion", "seed", "epoch", "speed", "rollback_s")
    facts = {name: ledger.fact(name) for name in names}
    window = float(facts["rollback_s"] or ROLLBACK_S)
    sources, digest = _sources(ledger.rows(), window)
    return Report(path, facts, tuple(sources), digest)


def _sources(rows: Iterable[Row], window: float) -> tuple[list[Source], str]:
    found: dict[tuple[str, str], Source] = {}
    numbers: dict[tuple[str, str], list[int]] = {}
    newest, digest = float("-inf"), 0
    for row in rows:
        stream = row.robot, row.boot
        source = found.setdefault(stream, Source(row.robot, row.boot, row.topic))
        numbers.setdefault(stream, []).append(row.sequence)
        source.stored += 1
        source.first_s = min(source.first_s, row.capture_time)
        source.last_s = max(source.last_s, row.capture_time)
        behind = newest - row.capture_time
        if behind > 0.0:
            source.latest_s = max(source.latest_s, behind)
            source.late += behind > window
            source.overtaken += behind <= window
        if row.expired:
            source.expired[row.expired] = source.expired.get(row.expired, 0) + 1
        newest = max(newest, row.capture_time)
        # A sum does not depend on the order; each entry's hash depends on all that it is.
        digest += int.from_bytes(sha256(row.message + row.expired.encode()).digest()[:16], "little")
    for stream, source in found.items():
        mark = of_numbers(sorted(numbers[stream]))
        begin = mark.upto + 1
        for first, last in mark.beyond:
            source.gaps.append((begin, first - 1))
            begin = last + 1
        source.missing = begin - counted(mark)
    ordered = sorted(found.values(), key=lambda source: (source.robot, source.first_s))
    return ordered, f"{digest % 2**128:032x}"
