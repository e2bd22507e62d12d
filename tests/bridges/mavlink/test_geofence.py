"""A mission's area becomes the fence on board, where pyproj says that it lies; MAVSDK reads the same back."""

import importlib
import json
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod

from agents import cli
from bridges.mavlink import visit
from bridges.mavlink.bridge import Bridge
from bridges.mavlink.frames import TeamFrame
from bridges.mavlink.geofence import (
    CIRCLE_IN,
    CIRCLE_OUT,
    POLYGON_IN,
    POLYGON_OUT,
    fence_items,
    rings_of,
    way_items,
)
from bridges.mavlink.mission_items import Item, PlanKind, waypoint
from bridges.mavlink.mission_protocol import Conversation, Download, Upload, keeps_home_first
from bridges.mavlink.pilot_config import PilotConfig
from estimator.arrays import FloatArray
from planner.ground.shapes import Shape
from sim.mavlink.serve import Served
from sim.mavlink.settings import Settings

FRAME = TeamFrame((47.3973, 8.5450, 488.0))
MISSION = """
name = "field"
area = { min = [0, 0], max = [80, 80] }
origin = { latitude = 47.3973, longitude = 8.5450, altitude = 488.0 }
world = { kind = "uniform", targets = 3 }
filter = { kind = "smc_phd", expected_targets = 4.0 }
planner = { kind = "maasi" }
[ground]
altitude_m = [0, 40]
keep_out = [{ circle = [30, 60, 8] }, { polygon = [[5, 60], [10, 60], [10, 70]], altitude = [0, 5] }]
%s
[[robots]]
id = "r1"
start = [10, 10, 12]
vehicle = { kind = "mavlink", url = "tcp:127.0.0.1:5760", system_id = 3, margin_m = 5 }
sensor = { kind = "range_bearing", period_s = 1.0, gain = 0.98, range_sigma_m = 1.0, bearing_sigma_deg = 0.5 }
"""


def degrees(points: FloatArray) -> FloatArray:
    return np.array([FRAME.to_degrees(np.array([x, y, 0.0]))[:2] for x, y in points])


def metres(item: Item) -> tuple[float, float]:
    """East and north of the frame's zero by pyproj's geodesics."""
    azimuth, _, far = Geod(ellps="WGS84").inv(8.5450, 47.3973, item.y, item.x)
    far *= 1 + 488.0 / 6.378e6  # geodesics are at sea level, the frame's zero is not
    return far * np.sin(np.radians(azimuth)), far * np.cos(np.radians(azimuth))


def test_rings_and_circles_lie_where_they_are_in_the_team_s_frame() -> None:
    outer = np.array([[0.0, 0.0], [300.0, 0.0], [300.0, 200.0], [0.0, 200.0]])
    hole = np.array([[50.0, 50.0], [60.0, 50.0], [60.0, 80.0]])
    area = Shape.polygon([outer, hole])
    assert [ring.tolist() for ring in rings_of(area)] == [outer.tolist(), hole.tolist()]
    fence = fence_items(
        [area], [Shape.disc(100.0, 120.0, 9.0), Shape.disc(1.0, 1.0, 1.0, (0.0, 5.0))], degrees
    )
    commands = [item.command for item in fence.items]
    assert commands == [POLYGON_IN] * 4 + [POLYGON_OUT] * 3 + [CIRCLE_OUT]
    assert [item.params[0] for item in fence.items] == [4.0] * 4 + [3.0] * 3 + [9.0]
    for item, place in zip(fence.items, [*outer, *hole, (100.0, 120.0)], strict=True):
        assert metres(item) == pytest.approx(tuple(place), abs=0.002)
    (left,) = fence.left_out
    assert "from 0 to 5 m only" in left
    assert fence_items([Shape.disc(0.0, 0.0, 50.0)], [], degrees).items[0].command == CIRCLE_IN


def test_a_planned_way_becomes_waypoints_above_home() -> None:
    route = np.array([[10.0, 20.0, 15.0], [-30.0, 40.0, 12.5]])
    items = way_items(route, degrees, home_height=2.0)
    assert [item.z for item in items] == [13.0, 10.5]
    for item, place in zip(items, route, strict=True):
        assert metres(item) == pytest.approx(tuple(place[:2]), abs=0.002)
        assert item.command == 16


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr(visit, "LISTEN", 0.5)
    monkeypatch.setattr(sys, "argv", ["searchparty", "vehicle", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_mission_s_fence_goes_on_board_with_its_ceiling(
    autopilot: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    mission = tmp_path / "field.toml"
    mission.write_text(
        MISSION % "geofence = [{ polygon = [[-20, -20], [100, -20], [100, 100], [-20, 100]] }]"
    )
    with Served(Settings(autopilot=autopilot, system_id=3, ready_after=0.2)) as vehicle:  # type: ignore[arg-type]
        assert run(monkeypatch, vehicle.url, "--fence", mission, "--yes") == 0
        told = capsys.readouterr().out
        assert "left out: zone 2" in told
        ceiling = {"ardupilot": "FENCE_ALT_MAX", "px4": "GF_MAX_VER_DIST"}[autopilot]
        assert f"{ceiling}: " in told
        assert "becomes 45.0 m above home" in told
        assert ("FENCE_ENABLE = 0" in told) == (autopilot == "ardupilot")
        assert vehicle.ask(lambda pilot: pilot.parameters[ceiling]) == 45.0  # 40 m and the margin
        items = vehicle.ask(lambda pilot: list(pilot.plans.items[1]))
        assert [item.command for item in items] == [POLYGON_IN] * 4 + [CIRCLE_OUT]
        assert run(monkeypatch, vehicle.url, "--download", "--json") == 0
        found = json.loads(capsys.readouterr().out)
        assert [one["command"] for one in found["fence"]] == [POLYGON_IN] * 4 + [CIRCLE_OUT]
        assert found["mission"] == []


def test_without_a_geofence_the_area_and_twice_the_margin_is_the_fence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    mission = tmp_path / "field.toml"
    mission.write_text(MISSION % "")
    with Served(Settings(system_id=3, ready_after=0.2)) as vehicle:
        assert run(monkeypatch, vehicle.url, "--fence", mission, "--yes") == 0
        corners = vehicle.ask(lambda pilot: list(pilot.plans.items[1]))[:4]
    places = [metres(Item(item.command, item.x, item.y)) for item in corners]
    wanted = [(-10.0, -10.0), (90.0, -10.0), (90.0, 90.0), (-10.0, 90.0)]
    assert np.array(places) == pytest.approx(np.array(wanted), abs=0.05)


def test_a_mission_without_that_vehicle_changes_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    mission = tmp_path / "field.toml"
    mission.write_text(MISSION % "")
    with Served(Settings(system_id=1, ready_after=0.2)) as vehicle:
        assert run(monkeypatch, vehicle.url, "--fence", mission, "--yes") == 2
        assert "no robot with system_id 1, only 3" in capsys.readouterr().err
        assert vehicle.ask(lambda pilot: list(pilot.plans.items[1])) == []


# MAVSDK, which knows nothing of us, at the same vehicle

mavsdk = pytest.importorskip("mavsdk", "4.0", reason="mavsdk 4 is not installed: pip install mavsdk")


def talk(bridge: Bridge, errand: Conversation) -> None:
    bridge.run(errand)
    end = time.monotonic() + 20.0
    while not errand.done and time.monotonic() < end:
        bridge.report()
        time.sleep(0.01)
    assert errand.done
    assert errand.trouble == ""


@pytest.mark.processes
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_mavsdk_reads_what_we_put_on_board_and_we_read_what_it_did(autopilot: str) -> None:
    raw = importlib.import_module("mavsdk.plugins.mission_raw")
    with Served(
        Settings(autopilot=autopilot, ready_after=0.2),  # type: ignore[arg-type]
        "tcpin:127.0.0.1:0",
        "tcpin:127.0.0.1:0",
    ) as vehicle:
        ground = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
        sdk = mavsdk.Mavsdk(ground)
        sdk.add_any_connection(vehicle.urls[1].replace("tcp:", "tcpout://"))
        system = sdk.first_autopilot(20.0)
        assert system is not None
        theirs = raw.MissionRaw(system)
        with Bridge(vehicle.url, PilotConfig(fly=False)) as bridge:
            end = time.monotonic() + 20.0
            while bridge.report().phase != "ready" and time.monotonic() < end:
                time.sleep(0.01)
            first = keeps_home_first(bridge.report().autopilot)
            addresses = ((1, 1), (1, 191))
            way = [waypoint(47.398 + 1e-5 * i, 8.546, 10.0 + i) for i in range(5)]
            fence = list(fence_items([Shape.disc(0.0, 0.0, 90.0)], [_triangle()], degrees).items)
            talk(bridge, Upload(way, PlanKind.MISSION, *addresses, home_first=first))
            talk(bridge, Upload(fence, PlanKind.FENCE, *addresses))
            assert seen(theirs.download_mission()[int(first) :]) == ours(way)
            assert seen(theirs.download_geofence()) == ours(fence)
            back = [*theirs.download_mission()[:-1]]
            back[0].current = 1
            theirs.upload_mission(back)
            reading = Download(PlanKind.MISSION, *addresses, home_first=first)
            talk(bridge, reading)
            assert ours(reading.items) == ours(way[:-1])
        del theirs, system
        sdk.destroy()


def _triangle() -> Shape:
    return Shape.polygon([np.array([[5.0, 60.0], [10.0, 60.0], [10.0, 70.0]])])


def seen(items: list) -> list[tuple[float, ...]]:  # type: ignore[type-arg]
    return [(item.command, item.frame, item.x, item.y, round(item.z, 3)) for item in items]


def ours(items: list[Item]) -> list[tuple[float, ...]]:
    return [
        (item.command, item.frame, round(item.x * 1e7), round(item.y * 1e7), round(item.z, 3))
        for item in items
    ]
