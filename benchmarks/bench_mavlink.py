"""How fast a MAVLink bridge is and what it costs; the vehicles are simulated in processes of their own."""

from typing import Any

import numpy as np

from benchmarks.mavlink_air import load, reconnect, setpoint_latencies, telemetry_latencies


def test_mavlink_setpoint_latency(benchmark: Any, quick: bool) -> None:
    """From the robot's wish to the setpoint's bytes, at moments that do not fit any rhythm."""
    _latency(
        benchmark, setpoint_latencies, 60 if quick else 200, "from Bridge.want until the bytes are sent, p99"
    )


def test_mavlink_telemetry_latency(benchmark: Any, quick: bool) -> None:
    """From a position's bytes to the snapshot that the robot's pose message is made from."""
    _latency(
        benchmark, telemetry_latencies, 60 if quick else 200, "from the bytes until Bridge.report has it, p99"
    )


def test_mavlink_bridge_load(benchmark: Any, quick: bool) -> None:
    """Ten vehicles in the air, 10 Hz setpoints and 10 Hz telemetry."""
    found: list[float] = []
    benchmark.pedantic(lambda: found.append(load(10, 3.0 if quick else 6.0)), rounds=1)
    benchmark.extra_info.update(
        value=found[0],
        unit="% of a core",
        asked=8.0,
        note="one of ten vehicles of the mission's kind in one process, all on a way",
    )
    assert found[0] > 0


def test_mavlink_reconnect(benchmark: Any, quick: bool) -> None:
    """From a TCP server that is there again until the vehicle is heard."""
    found: list[float] = []
    benchmark.pedantic(lambda: found.extend(reconnect(2 if quick else 5)), rounds=1)
    benchmark.extra_info.update(
        value=max(found),
        unit="s",
        asked=2.0,
        note=f"the longest of {len(found)}, after 1 to 3 s without a link",
    )
    assert found


def _latency(benchmark: Any, measure: Any, count: int, note: str) -> None:
    times: list[float] = []
    benchmark.pedantic(lambda: times.extend(measure(count)), rounds=1)
    benchmark.extra_info.update(
        value=float(np.percentile(times, 99)),
        unit="ms",
        asked=5.0,
        note=note,
        more={"median": float(np.median(times)), "longest": max(times), "count": count},
    )
    assert len(times) == count
