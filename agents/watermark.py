"""Which sets or soft observations of a sender's boot are durable and applied, in few numbers."""

from collections.abc import Iterable

from agents.messages import LedgerEntry, Watermark


def source(sender: str, boot: str) -> str:
    """The name under which a posterior's watermark lists one boot of one robot or operator."""
    return f"{sender}/{boot}"


class Applied:
    """Grows as entries of the ledger are applied; `watermarks()` is what the posterior carries."""

    def __init__(self) -> None:
        self._upto: dict[str, int] = {}
        self._beyond: dict[str, set[int]] = {}

    def __repr__(self) -> str:
        return f"Applied({self.watermarks()})"

    def __contains__(self, message: LedgerEntry) -> bool:
        name = source(message.sender, message.boot)
        return message.sequence <= self._upto.get(name, -1) or message.sequence in self._beyond.get(name, ())

    def add(self, message: LedgerEntry) -> None:
        """Count an entry as applied."""
        name = source(message.sender, message.boot)
        beyond = self._beyond.setdefault(name, set())
        beyond.add(message.sequence)
        upto = self._upto.get(name, -1)
        while upto + 1 in beyond:
            upto += 1
            beyond.remove(upto)
        self._upto[name] = upto

    def watermarks(self) -> dict[str, Watermark]:
        """By sender and boot."""
        return {
            name: Watermark(upto=upto, beyond=sorted(self._beyond[name])) for name, upto in self._upto.items()
        }


def uncovered(watermark: Watermark | None, sequences: Iterable[int]) -> list[int]:
    """Those of a boot's sequence numbers that the watermark does not cover."""
    if watermark is None:
        return list(sequences)
    beyond = set(watermark.beyond)
    return [number for number in sequences if number > watermark.upto and number not in beyond]
