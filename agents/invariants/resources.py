"""Bounded resources: queues keep their bounds, and nothing grows for as long as a run lasts."""

from collections import defaultdict

import numpy as np

from agents.invariants.connections import Truth
from agents.invariants.history import RunHistory
from agents.invariants.report import Report
from agents.wire.messages import HealthMessage

RESOURCES = "bounded resources"
WARM_S = 30.0  # memory is looked at from then on
LONG_S = 60.0  # and only over at least so long
GROWTH = 0.05  # share of its mean that memory may grow by over what was looked at


def bounded_resources(history: RunHistory, truth: Truth, report: Report) -> None:
    """No queue is longer than its bound, and memory does not grow."""
    for size in history.sizes:
        report.counts["sizes looked at"] += 1
        if size.bound and size.value > size.bound:
            report.violate(
                RESOURCES,
                size.at,
                f"{size.who} keeps {size.value:g} of {size.what}, and may keep {size.bound:g}",
            )
    memory: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    for at, message in history.by(HealthMessage):
        if "memory_mb" in message.gauges:
            memory[message.sender, message.boot].append((at, message.gauges["memory_mb"]))
    for (who, _), samples in memory.items():
        times, values = np.array([s for s in samples if s[0] >= samples[0][0] + WARM_S]).reshape(-1, 2).T
        if len(times) < 10 or times[-1] - times[0] < LONG_S:
            continue
        slope = float(np.polyfit(times - times[0], values, 1)[0])
        report.most("memory_mb_per_minute", 60.0 * slope)
        if slope * (times[-1] - times[0]) > GROWTH * float(values.mean()):
            report.violate(RESOURCES, float(times[-1]), f"{who} grows by {60.0 * slope:.1f} MB a minute")
