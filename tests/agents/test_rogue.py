"""A process that sends nonsense into a running team: counted by reason, never applied, never fatal."""

import re
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zenoh

from agents.mission.mission import LinkTable
from agents.wire import codec
from agents.wire.messages import MeasurementSetMessage
from bridges.zenoh.config import configuration
from tests.agents.swarm.test_swarm import launched, started, summary_of, wait_for, write_mission

pytestmark = pytest.mark.processes


def measurement_set(**changes: object) -> MeasurementSetMessage:
    good = MeasurementSetMessage(
        team="searchparty",
        sender="r1",
        boot="rogue",
        sequence=0,
        time=1.0,
        pose=np.zeros(4),
        measurements=np.zeros((1, 2)),
    )
    return msgspec.structs.replace(good, **changes)


NONSENSE = {
    "not_msgpack": b"\xc1 this is not MessagePack",
    "schema_version": codec.encode(measurement_set(version=99)),
    "not_finite": codec.encode(measurement_set(measurements=np.full((1, 2), np.nan))),
    "wrong_shape": codec.encode(measurement_set(pose=np.zeros(7))),
    "wrong_sender": codec.encode(measurement_set(sender="r2")),
    "wrong_team": codec.encode(measurement_set(team="others")),
    "measurement_size": codec.encode(measurement_set(measurements=np.zeros((1, 3)))),
}


def test_nonsense_is_counted_by_reason_and_never_applied(tmp_path: Path) -> None:
    mission, out = write_mission(tmp_path, duration=300), tmp_path / "run"
    with launched(mission, out, "--speed", "2") as swarm:
        wait_for(lambda: started(out), 60, "the start")
        (endpoint,) = set(re.findall(r"tcp/127\.0\.0\.1:\d+", (out / "fusion.log").read_text()))
        with zenoh.open(configuration(LinkTable(), "client", connect=(endpoint,))) as session:
            for payload in [*NONSENSE.values(), b"x" * 300_000]:
                session.put("searchparty/v1/set/r1", payload)
            session.put("searchparty/v1/set/nobody", codec.encode(measurement_set(sender="nobody")))
            time.sleep(0.5)
        output, _ = swarm.communicate(timeout=110)
    assert swarm.returncode == 0, output
    messages = summary_of(out)["messages"]
    assert isinstance(messages, dict)
    for reason in (*NONSENSE, "unknown_robot", "oversize"):
        assert messages[f"rejected.{reason}"] >= 1, reason
    assert messages["rejected"] >= len(NONSENSE)
    assert "refused a set message of r1: not_msgpack" in (out / "fusion.log").read_text()
    assert "Traceback" not in (out / "fusion.log").read_text()
