"""The numbers beside the picture."""

import msgspec
import numpy as np

from agents.health.histogram import Histogram
from agents.wire.messages import HealthMessage
from bridges.rerun.blueprint import POSTERIOR_PLOT, TROUBLE_PLOT
from bridges.rerun.plots import PERIOD_S, Latencies, Troubles


def health(boot: str, *milliseconds: float) -> HealthMessage:
    histogram = Histogram()
    for value in milliseconds:
        histogram.add(value)
    return HealthMessage(
        team="t",
        sender="fusion",
        boot=boot,
        sequence=0,
        time=0.0,
        role="fusion",
        state="running",
        counters={},
        gauges={},
        histograms={"capture_to_posterior_ms": histogram.counts},
    )


def test_a_point_covers_only_what_came_since_the_last() -> None:
    latencies = Latencies()
    latencies.hear(health("b1", 1.0, 1.0))
    ((path, first),) = latencies.due(0.0)
    latencies.hear(health("b1", 1.0, 1.0, 100.0))

    assert list(latencies.due(PERIOD_S / 2)) == []
    ((_, second),) = latencies.due(PERIOD_S)

    assert path == POSTERIOR_PLOT
    np.testing.assert_allclose(first, [1.0, 1.0], rtol=0.05)
    np.testing.assert_allclose(second, [100.0, 100.0], rtol=0.05)


def test_restarted_process_does_not_count_backwards() -> None:
    latencies = Latencies()
    latencies.hear(health("b1", 1.0, 1.0, 1.0))
    list(latencies.due(0.0))
    latencies.hear(health("b2", 10.0))

    ((_, point),) = latencies.due(PERIOD_S)

    np.testing.assert_allclose(point, [10.0, 10.0], rtol=0.05)


def test_nothing_new_draws_nothing() -> None:
    assert list(Latencies().due(0.0)) == []


def test_troubles_are_what_came_since_the_last_point_of_all_processes() -> None:
    troubles = Troubles()
    assert list(troubles.due(0.0)) == []
    sick = msgspec.structs.replace(
        health("b1"),
        counters={
            "rejected": 4,
            "rejected.not_finite": 4,
            "link.dropped.set": 2,
            "link.dropped.pose": 1,
            "lost": 3,
        },
        gauges={"silent.pose": 2.0},
    )
    troubles.hear(sick)
    troubles.hear(msgspec.structs.replace(sick, sender="r1", counters={"rejected": 1}, gauges={}))
    assert list(troubles.due(0.0)) == [(TROUBLE_PLOT, [5.0, 3.0, 3.0, 2.0])]
    troubles.hear(sick)
    assert list(troubles.due(PERIOD_S / 2)) == []
    assert list(troubles.due(PERIOD_S)) == [(TROUBLE_PLOT, [0.0, 0.0, 0.0, 2.0])]
