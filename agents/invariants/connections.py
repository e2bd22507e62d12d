"""Who was connected with whom, and when: what the facts of a history say of two processes."""

from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from agents.invariants.history import Fact, RunHistory

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Life:
    """One boot of a process."""

    who: str
    role: str
    boot: str
    begin: float
    end: float  # of the process, or of the run


class Truth:
    """The facts of a history, asked in several ways."""

    def __init__(self, history: RunHistory) -> None:
        self.end = history.end
        self.facts = history.facts
        self.lives = _lives(history.facts, self.end)
        self.names = sorted({life.who for life in self.lives})
        self._bad: dict[str, list[Interval]] = _spells(history.facts, self.end)
        self._cuts: dict[tuple[str, str], list[Interval]] = _cuts(history.facts, self.end)

    def of(self, role: str) -> list[Life]:
        """The lives of all processes of a role."""
        return [life for life in self.lives if life.role == role]

    def life(self, who: str, boot: str) -> Life | None:
        """One boot, if it is known."""
        return next((life for life in self.lives if life.who == who and life.boot == boot), None)

    def stopped(self, who: str) -> list[Interval]:
        """When a process could not look although it lived."""
        return self._bad.get(f"stopped {who}", []) + self._bad.get(f"slow {who}", [])

    def together(self, one: Life, other: Life) -> list[Interval]:
        """When two processes lived, could look, store and hear each other, and nothing was lost underway."""
        begin, end = max(one.begin, other.begin), min(one.end, other.end)
        if begin >= end:
            return []
        bad = [*self._bad.get("lossy", [])]
        for who in (one.who, other.who):
            bad += self.stopped(who) + self._bad.get(f"full {who}", [])
        bad += self.cut(one.who, other.who)
        return without((begin, end), bad)

    def cut(self, one: str, other: str) -> list[Interval]:
        """When one of two could not hear the other."""
        return self._cuts.get((one, other), []) + self._cuts.get((other, one), [])

    def components(self, names: Sequence[str], at: float) -> list[set[str]]:
        """Groups of processes that lived and heard each other, both ways, at a time."""
        alive = [
            n
            for n in names
            if any(life.who == n and life.begin <= at < life.end for life in self.lives)
            and not _inside(self.stopped(n), at)
        ]
        groups: list[set[str]] = []
        for name in alive:
            linked = [g for g in groups if any(self._linked(name, other, at) for other in g)]
            merged = {name}.union(*linked)
            groups = [g for g in groups if g not in linked] + [merged]
        return groups

    def disturbed(self) -> list[Interval]:
        """When anything at all was not as it should be."""
        spells = [interval for some in self._bad.values() for interval in some]
        return spells + [interval for some in self._cuts.values() for interval in some]

    def _linked(self, a: str, b: str, at: float) -> bool:
        return not _inside(self._cuts.get((a, b), []), at) and not _inside(self._cuts.get((b, a), []), at)


def without(whole: Interval, bad: Sequence[Interval]) -> list[Interval]:
    """What is left of an interval without others."""
    left, begin = [], whole[0]
    for low, high in sorted(bad):
        if low > begin:
            left.append((begin, min(low, whole[1])))
        begin = max(begin, high)
        if begin >= whole[1]:
            break
    if begin < whole[1]:
        left.append((begin, whole[1]))
    return [(a, b) for a, b in left if b > a]


def overlap(interval: Interval, others: Sequence[Interval]) -> bool:
    """Whether an interval meets any of others."""
    return any(low < interval[1] and interval[0] < high for low, high in others)


def _inside(spells: Sequence[Interval], at: float) -> bool:
    return any(low <= at < high for low, high in spells)


def _lives(facts: Sequence[Fact], end: float) -> list[Life]:
    lives, running = [], dict[str, Fact]()
    for fact in facts:
        if fact.what == "up":
            running[fact.who] = fact
        elif fact.what == "down" and fact.who in running:
            up = running.pop(fact.who)
            lives.append(Life(up.who, up.role, up.boot, up.at, fact.at))
    lives += [Life(up.who, up.role, up.boot, up.at, end) for up in running.values()]
    return sorted(lives, key=lambda life: (life.begin, life.who))


def _spells(facts: Sequence[Fact], end: float) -> dict[str, list[Interval]]:
    """Intervals between a fact and the one that ends it, by what (and who)."""
    begins = {"stopped": "stopped", "slow": "slow", "full": "full", "lossy": "lossy"}
    ends = {"going": "stopped", "quick": "slow", "free": "full", "calm": "lossy", "down": "stopped"}
    found: dict[str, list[Interval]] = defaultdict(list)
    begun: dict[str, float] = {}
    for fact in facts:
        suffix = f" {fact.who}" if fact.who else ""
        if fact.what in begins:
            begun.setdefault(begins[fact.what] + suffix, fact.at)
        elif fact.what in ends:
            name = ends[fact.what] + suffix
            if name in begun:
                found[name].append((begun.pop(name), fact.at))
    for name, at in begun.items():
        found[name].append((at, end))
    return found


def _cuts(facts: Sequence[Fact], end: float) -> dict[tuple[str, str], list[Interval]]:
    found: dict[tuple[str, str], list[Interval]] = defaultdict(list)
    depth: Counter[tuple[str, str]] = Counter()
    begun: dict[tuple[str, str], float] = {}
    for fact in facts:
        ends = (fact.who, fact.other)
        if fact.what == "cut":
            depth[ends] += 1
            begun.setdefault(ends, fact.at)
        elif fact.what == "healed":
            depth[ends] -= 1
            if depth[ends] == 0:
                found[ends].append((begun.pop(ends), fact.at))
    for ends, at in begun.items():
        found[ends].append((at, end))
    return found


def newest_before(times: Sequence[float], at: float) -> int:
    """The index of the last time not after `at`; -1: there is none."""
    return bisect_right(times, at) - 1
