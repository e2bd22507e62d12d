"""By how much plans overrun their deadlines: every planner, in the open and in a depot, 1 to 50 robots."""

import time
from typing import Any

from benchmarks.deadlines import CROWDS, PLACES, TEAMS, lateness, planners, together


def test_deadline_overrun(benchmark: Any, quick: bool) -> None:
    """The latest of all plans with 1 to 100 ms, by the processor's clock: others' work does not count."""
    crowds = (1, 50) if quick else CROWDS
    worst: dict[str, float] = {}
    count = 0

    def measure() -> None:
        nonlocal count
        for kind in planners():
            rows = [row for place in PLACES for robots in crowds for row in lateness(kind, place, robots)]
            rows += [row for place in PLACES for robots in TEAMS for row in together(kind, place, robots)]
            worst[kind] = max(row.over_ms for row in rows)
            count += len(rows)

    began = time.perf_counter()
    benchmark.pedantic(measure, rounds=1)
    latest = max(worst, key=lambda kind: worst[kind])
    benchmark.extra_info.update(
        value=worst[latest],
        asked=2.0,
        unit="ms",
        peers={},
        note=f"the latest of {count} plans, of {latest}; a time below 0 is before the deadline; "
        f"measured in {time.perf_counter() - began:.0f} s",
        more={kind: round(late, 2) for kind, late in sorted(worst.items())},
    )
