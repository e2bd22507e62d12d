"""Which sets or soft observations of a sender's boot are durable and applied, in few numbers.

What a posterior carries of it is bounded whatever happens: a boot's numbers stand as ranges, of which at
most RANGES are told, and boots that ended are told of only while somebody still offers sets of theirs.
"""

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping

from agents.wire.messages import LedgerEntry, Watermark

RANGES = 64  # beyond a gap, in one watermark: what is not told of is offered again, and is then a duplicate
OLD_BOOTS = 64  # of boots that are not their sender's newest, in one posterior


def source(sender: str, boot: str) -> str:
    """The name under which a posterior's watermark lists one boot of one robot or operator."""
    return f"{sender}/{boot}"


def covers(watermark: Watermark | None, sequence: int) -> bool:
    """Whether a watermark says that a number is durable and applied."""
    if watermark is None:
        return False
    return sequence <= watermark.upto or any(a <= sequence <= b for a, b in watermark.beyond)


def counted(watermark: Watermark) -> int:
    """How many numbers a watermark covers."""
    return watermark.upto + 1 + sum(b - a + 1 for a, b in watermark.beyond)


def covered(watermark: Watermark | None) -> Iterator[tuple[int, int]]:
    """The ranges of numbers, first and last, that a watermark covers."""
    if watermark is not None:
        if watermark.upto >= 0:
            yield 0, watermark.upto
        yield from watermark.beyond


def uncovered(watermark: Watermark | None, sequences: Iterable[int]) -> list[int]:
    """Those of a boot's sequence numbers that the watermark does not cover."""
    return [number for number in sequences if not covers(watermark, number)]


def of_numbers(numbers: Iterable[int]) -> Watermark:
    """What covers these growing numbers and no other."""
    found: list[tuple[int, int]] = []
    for number in numbers:
        if found and number == found[-1][1] + 1:
            found[-1] = found[-1][0], number
        else:
            found.append((number, number))
    upto = found.pop(0)[1] if found and found[0][0] == 0 else -1
    return Watermark(upto=upto, beyond=found)


class Applied:
    """Grows as entries of the ledger are applied; `watermarks()` is what the posterior carries."""

    def __init__(self, watermarks: Mapping[str, Watermark] | None = None) -> None:
        """Nothing, or what `all` gave."""
        self._upto: dict[str, int] = {}
        self._beyond: dict[str, set[int]] = {}
        self._marks: dict[str, Watermark] = {}  # as last told; absent where something was added since
        self._newest: dict[str, str] = {}  # sender -> its source that was added to last
        self._asked: OrderedDict[str, None] = OrderedDict()  # sources of late, the latest last
        for name, mark in (watermarks or {}).items():
            self._upto[name] = mark.upto
            self._beyond[name] = {number for a, b in mark.beyond for number in range(a, b + 1)}
            self._newest[name.partition("/")[0]] = name

    def __repr__(self) -> str:
        return f"Applied({self.watermarks()})"

    def __contains__(self, message: LedgerEntry) -> bool:
        name = source(message.sender, message.boot)
        return message.sequence <= self._upto.get(name, -1) or message.sequence in self._beyond.get(name, ())

    def add(self, message: LedgerEntry) -> None:
        """Count an entry as applied."""
        name = source(message.sender, message.boot)
        self.add_number(name, message.sequence)
        self._newest[message.sender] = name

    def add_number(self, name: str, sequence: int) -> None:
        """Count a number of a source as applied."""
        upto = self._upto.get(name, -1)
        if sequence <= upto:
            return
        if sequence == upto + 1 and not self._beyond.get(name):
            upto += 1
        else:
            beyond = self._beyond.setdefault(name, set())
            beyond.add(sequence)
            while upto + 1 in beyond:
                upto += 1
                beyond.remove(upto)
        self._upto[name] = upto
        self._marks.pop(name, None)
        self.asked(name)

    def remove(self, message: LedgerEntry) -> None:
        """Count an entry no longer."""
        name, sequence = source(message.sender, message.boot), message.sequence
        upto, beyond = self._upto.get(name, -1), self._beyond.setdefault(name, set())
        if sequence <= upto:
            beyond.update(range(sequence, upto + 1))
            self._upto[name] = sequence - 1
        beyond.discard(sequence)
        self._marks.pop(name, None)

    def asked(self, name: str) -> None:
        """Somebody offers what a source sent: its watermark is of interest."""
        self._asked[name] = None
        self._asked.move_to_end(name)
        if len(self._asked) > OLD_BOOTS:
            self._asked.popitem(last=False)

    def watermarks(self) -> dict[str, Watermark]:
        """By sender and boot: of every sender the newest boot, and boots that were offered of late."""
        names = dict.fromkeys((*self._newest.values(), *(n for n in self._asked if n in self._upto)))
        return {name: self.mark(name) for name in names}

    def all(self) -> dict[str, Watermark]:
        """Of every boot there ever was, with all its ranges."""
        return {name: self.full(name) for name in self._upto}

    def names(self) -> list[str]:
        """All sources, in order."""
        return sorted(self._upto)

    def mark(self, name: str) -> Watermark:
        """A source's watermark as it is told; with nothing of it, -1."""
        mark = self._marks.get(name)
        if mark is None:
            mark = self._mark(name, RANGES)
            if name in self._upto:
                self._marks[name] = mark
        return mark

    def full(self, name: str) -> Watermark:
        """A source's watermark with all its ranges."""
        return self._mark(name, None)

    def _mark(self, name: str, most: int | None) -> Watermark:
        upto, beyond = self._upto.get(name, -1), self._beyond.get(name)
        ranges = of_numbers(sorted(beyond)).beyond if beyond else []
        return Watermark(upto=upto, beyond=ranges if most is None else ranges[:most])
