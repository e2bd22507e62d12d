"""Separation between real processes: three drones that all have to do with the same few metres."""

from pathlib import Path

import pytest

from tests.agents.swarm.test_swarm import launched, summary_of, write_mission

pytestmark = pytest.mark.processes


def test_processes_that_search_one_place_keep_apart(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, duration=16)
    text = mission.read_text().replace("separation_m = 3.0", "separation_m = 8.0")
    text = text.replace(
        "low = [15, 15], high = [105, 105], points = [4, 4]",
        "low = [54, 54], high = [66, 66], points = [2, 2]",
    )
    for height in (10, 15):  # all at one altitude: there is no passing above each other
        text = text.replace(f", {height}]\nvehicle", ", 5]\nvehicle")
    mission.write_text(text)
    with launched(mission, tmp_path / "run", "--speed", "2") as process:
        process.wait(90)
    summary = summary_of(tmp_path / "run")
    assert float(str(summary["min_separation_m"])) >= 8.0
    # They did meet: from 110 m apart they came to search within 12 m of each other.
    assert float(str(summary["min_separation_m"])) < 25.0
