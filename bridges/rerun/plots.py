"""The view's numbers: latencies of the last seconds, and the text beside the map."""

from collections.abc import Iterator

import numpy as np

from agents.health.histogram import Histogram
from agents.mission.mission import Mission
from agents.wire.messages import EstimateMessage, HealthMessage
from bridges.rerun.blueprint import LATENESS_PLOT, POSTERIOR_PLOT, TROUBLE_PLOT
from estimator.arrays import IntArray

PERIOD_S = 5.0  # team seconds that one point of a latency plot covers
PLOTTED = {"capture_to_posterior_ms": POSTERIOR_PLOT, "measure_clock_lateness_ms": LATENESS_PLOT}


class Latencies:
    """Turns counts that only grow, of every process, into percentiles of what came since the last point."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, str, str], IntArray] = {}  # name, sender, boot
        self._fresh = {name: Histogram() for name in PLOTTED}
        self._due = -np.inf

    def hear(self, message: HealthMessage) -> None:
        """Take in one process's histograms."""
        for name in PLOTTED:
            counts = message.histograms.get(name)
            if counts is None:
                continue
            stream = (name, message.sender, message.boot)
            grown = np.maximum(counts - self._last.get(stream, np.zeros_like(counts)), 0)
            self._last[stream] = counts
            self._fresh[name] = self._fresh[name].merge(Histogram.of(grown))

    def due(self, now: float) -> Iterator[tuple[str, list[float]]]:
        """The plots that have a new point, with p50 and p99 in milliseconds."""
        if now < self._due:
            return
        self._due = now + PERIOD_S
        for name, path in PLOTTED.items():
            p50, p99 = self._fresh[name].percentile(50.0), self._fresh[name].percentile(99.0)
            if p50 is not None and p99 is not None:
                self._fresh[name] = Histogram()
                yield path, [p50, p99]


class Troubles:
    """The whole team's messages that did not go well since the last point, of all processes together."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, str], tuple[int, int, int]] = {}  # by sender and boot
        self._fresh = [0, 0, 0]
        self._silent: dict[str, float] = {}
        self._due = -np.inf

    def hear(self, message: HealthMessage) -> None:
        """Take in one process's counters."""
        counters = message.counters
        dropped = sum(n for name, n in counters.items() if name.startswith("link.dropped."))
        counts = (counters.get("rejected", 0), dropped, counters.get("lost", 0))
        before = self._last.get((message.sender, message.boot), (0, 0, 0))
        self._fresh = [f + max(0, now - old) for f, now, old in zip(self._fresh, counts, before, strict=True)]
        self._last[message.sender, message.boot] = counts
        self._silent[message.sender] = sum(n for k, n in message.gauges.items() if k.startswith("silent."))

    def due(self, now: float) -> Iterator[tuple[str, list[float]]]:
        """The plot's new point, if it is time for one: refused, dropped, lost, streams that are silent."""
        if now < self._due or not self._last:
            return
        self._due = now + PERIOD_S
        values = [float(count) for count in self._fresh]
        self._fresh = [0, 0, 0]
        yield TROUBLE_PLOT, [*values, sum(self._silent.values())]


def summary_text(mission: Mission, posterior: EstimateMessage, total: int | None, now: float) -> str:
    """The found targets as Markdown, the newest first."""
    count = posterior.found.shape[1]
    of = "" if total is None else f" of {total}"
    lines = [
        f"**{count}{of} found** after {now:.0f} s, expected {posterior.expected_cardinality:.1f}, "
        f"{posterior.applied} measurement sets",
        "",
    ]
    if count:
        lines += ["| # | found at | position (m) |", "| ---: | ---: | :--- |"]
        for index in range(count - 1, -1, -1):
            place = ", ".join(f"{value:.1f}" for value in posterior.found[:, index])
            lines.append(f"| {index + 1} | {posterior.found_times[index]:.0f} s | {place} |")
    return "\n".join(lines)
