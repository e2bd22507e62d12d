"""What was not taken, counted by reason, and told to people once for each."""

from collections import Counter


class Tally:
    """Counts what comes in at one place, and why things were refused."""

    def __init__(self, where: str) -> None:
        self.counts: Counter[str] = Counter()
        self._where = where
        self._told: set[str] = set()
        self._news: list[tuple[str, str]] = []

    def __repr__(self) -> str:
        return f"Tally({self._where}, {dict(self.counts)})"

    def refuse(self, word: str, sentence: str) -> None:
        """One more; the first of its kind is news."""
        self.counts[f"refused.{word}"] += 1
        if word not in self._told:
            self._told.add(word)
            text = f"what came at {self._where} was not taken: {sentence}; more of the kind is only counted"
            self._news.append(("warning", text))

    def news(self) -> list[tuple[str, str]]:
        """What was not told yet."""
        found, self._news = self._news, []
        return found

    def counters(self) -> dict[str, int]:
        """For a health message."""
        return {f"detections.{name}": count for name, count in sorted(self.counts.items())}
