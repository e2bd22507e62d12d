"""What the checker found."""

from collections import Counter
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Violation:
    """Something that must not be."""

    invariant: str  # a row of the table in docs/faults.md
    time: float  # true team time
    text: str

    def __str__(self) -> str:
        return f"{self.time:8.2f} s  {self.invariant}: {self.text}"


@dataclass
class Report:
    """Grows while invariants are checked. `counts` tell what was looked at, so that nothing holds for want
    of cases; `measured` are the worst values met."""

    violations: list[Violation] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    measured: dict[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"Report({len(self.violations)} violations, {dict(self.counts)})"

    def violate(self, invariant: str, time: float, text: str) -> None:
        """Note a violation."""
        self.violations.append(Violation(invariant, time, text))

    def most(self, name: str, value: float) -> None:
        """Keep the largest value of a name."""
        self.measured[name] = max(value, self.measured.get(name, value))

    def least(self, name: str, value: float) -> None:
        """Keep the smallest value of a name."""
        self.measured[name] = min(value, self.measured.get(name, value))

    @property
    def broken(self) -> list[str]:
        """The invariants that do not hold, each once."""
        return list(dict.fromkeys(violation.invariant for violation in self.violations))
