"""What a process says of its own health, gathered from its parts."""

from collections.abc import Mapping

from agents.health.histogram import Histogram
from agents.machine import Stamp
from agents.wire.mailbox import Mailbox
from agents.wire.messages import HealthMessage
from agents.wire.topics import HEALTH


def health_message(
    stamp: Stamp,
    time: float,
    role: str,
    state: str,
    mailbox: Mailbox,
    link: Mapping[str, int],
    counters: Mapping[str, int],
    gauges: Mapping[str, float],
    histograms: Mapping[str, Histogram],
    vehicle: str = "",
) -> HealthMessage:
    """One health message; counters of the link carry the prefix `link.`."""
    counts = dict(mailbox.counters)
    counts["lost"] = mailbox.lost
    counts["published"] = link.get("published", 0)
    for name, value in link.items():
        if name not in ("published", "received"):
            counts[f"link.{name}"] = value
    if link.get("oversize"):
        counts["rejected.oversize"] = counts.get("rejected.oversize", 0) + link["oversize"]
        counts["rejected"] = counts.get("rejected", 0) + link["oversize"]
    for name, value in counters.items():
        counts[name] = counts.get(name, 0) + value
        if name.startswith("rejected."):
            counts["rejected"] = counts.get("rejected", 0) + value
    return HealthMessage(
        **stamp.header(HEALTH, time),
        role=role,
        state=state,
        counters=counts,
        gauges=dict(gauges),
        histograms={name: histogram.counts for name, histogram in histograms.items()},
        vehicle=vehicle,
    )
