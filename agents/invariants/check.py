"""All invariants of one history."""

from collections.abc import Callable

from agents.invariants.connections import Truth
from agents.invariants.crashes import SAFETY, crash_safety
from agents.invariants.history import RunHistory
from agents.invariants.motion import COLLISION, no_collision
from agents.invariants.replay import DETERMINISM, replays
from agents.invariants.report import Report
from agents.invariants.resources import RESOURCES, bounded_resources
from agents.invariants.sets import ECHO, LOST, TWICE, no_echo, no_set_lost, none_twice
from agents.invariants.staleness import STALE, bounded_staleness
from agents.invariants.tasks import TASKS, conflict_free_tasks

INVARIANTS: dict[str, Callable[[RunHistory, Truth, Report], None]] = {
    LOST: no_set_lost,
    TWICE: none_twice,
    ECHO: no_echo,
    TASKS: conflict_free_tasks,
    COLLISION: no_collision,
    STALE: bounded_staleness,
    RESOURCES: bounded_resources,
    SAFETY: crash_safety,
    DETERMINISM: replays,
}


def check(history: RunHistory) -> Report:
    """What does not hold of a run. Its sets are applied again, which takes as long as it took the fusion."""
    truth, report = Truth(history), Report()
    for invariant in INVARIANTS.values():
        invariant(history, truth, report)
    report.violations.sort(key=lambda violation: violation.time)
    return report
