"""Plans on board of real autopilots, in real time; skipped where `tests.bridges.mavlink.real` finds none."""

import math
import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from agents import cli
from bridges.mavlink import visit
from bridges.mavlink.frames import LocalFrame, TeamFrame
from bridges.mavlink.geofence import fence_items
from bridges.mavlink.mission_items import Item, PlanKind
from bridges.mavlink.mission_protocol import Clear, Conversation, Download, Upload, keeps_home_first
from bridges.mavlink.wanted import Land
from bridges.mavlink.ways import way_of
from planner.ground.shapes import Shape
from tests.bridges.mavlink.real import Real, needed, stage
from tests.bridges.mavlink.test_real_autopilots import COPTERS, READY, Flown, flown

ROUTE = np.array([[0.0, 12.0, 6.0], [12.0, 12.0, 8.0], [12.0, 0.0, 6.0]])  # east, north, up


def talk(one: Flown, errand: Conversation) -> None:
    one.bridge.run(errand)
    one.until(f"{errand}", lambda: one.bridge.report() is not None and errand.done, 30.0)
    assert errand.trouble == ""


def same(found: list[Item], wanted: list[Item]) -> bool:
    return [(i.command, round(i.x * 1e7), round(i.y * 1e7)) for i in found] == [
        (i.command, round(i.x * 1e7), round(i.y * 1e7)) for i in wanted
    ]


@pytest.mark.parametrize("kind", ["ardupilot", "px4", "rover"])
def test_fences_and_missions_come_back_as_they_went_up(kind: str, tmp_path: Path) -> None:
    with flown(kind, tmp_path) as one:
        one.until("home", lambda: one.bridge.report().home is not None, READY)
        report = one.bridge.report()
        assert report.system is not None
        assert report.home is not None
        frame = TeamFrame(report.home)
        addresses = ((report.system, 1), (report.system, 191))
        first = keeps_home_first(report.autopilot)
        inside = Shape.polygon([np.array([[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]])])
        fence = fence_items(
            [inside],
            [Shape.disc(30.0, 30.0, 5.0)],
            lambda points: np.array([frame.to_degrees(np.array([x, y, 0.0]))[:2] for x, y in points]),
        ).items
        local = LocalFrame(frame, report.origin or report.home, report.autopilot)
        way = way_of(ROUTE, local, report.home).items
        for items, kind_of_plan in ((fence, PlanKind.FENCE), (way, PlanKind.MISSION)):
            talk(one, Upload(items, kind_of_plan, *addresses, home_first=first))
            reading = Download(kind_of_plan, *addresses, home_first=first)
            talk(one, reading)
            assert same(reading.items, list(items))
        talk(one, Clear(PlanKind.FENCE, *addresses))
        reading = Download(PlanKind.FENCE, *addresses)
        talk(one, reading)
        assert reading.items == []


@COPTERS
def test_a_way_is_flown_as_a_mission_with_a_link_that_is_gone_for_a_while(kind: str, tmp_path: Path) -> None:
    with flown(kind, tmp_path) as copter:
        copter.airborne()
        report = copter.bridge.report()
        assert report.home is not None
        assert report.origin is not None
        way = way_of(ROUTE, LocalFrame(TeamFrame(report.home), report.origin, report.autopilot), report.home)
        nearest = [math.inf] * len(way.route)

        def flying(phase: str) -> bool:
            for index, corner in enumerate(way.route):
                nearest[index] = min(nearest[index], copter.gap(corner))
            return copter.bridge.report().phase == phase

        copter.want(way)
        copter.until("following", lambda: flying("following"), 30.0)
        copter.until("first corner", lambda: flying("following") and nearest[0] < 1.5, 60.0)
        copter.router.cut = True
        copter.until("lost", lambda: flying("lost"), 15.0)
        copter.router.cut = False
        copter.until("back with us", lambda: flying("flying"), 90.0)
        time.sleep(3.0)
        assert copter.ours
        assert copter.gap(way.route[-1]) < 1.0
        assert max(nearest[0], nearest[2]) < 1.5, nearest  # at the second nobody may have looked
        copter.want(Land())
        copter.down()


@pytest.mark.parametrize("kind", ["ardupilot", "px4", "rover"])
def test_the_command_flies_its_square(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    needed(kind)
    system, router = stage(kind)
    with router, Real(kind, tmp_path, router, system):
        end = time.monotonic() + READY
        status = 1
        while status and time.monotonic() < end:
            status = _command(monkeypatch, router.url, "--arm-check")
        assert status == 0, capsys.readouterr()
        capsys.readouterr()
        assert _command(monkeypatch, router.url, "--fly-square", "6", "--yes") == 0, capsys.readouterr()
        told = capsys.readouterr().out
        assert [line.split()[1] for line in told.splitlines()[1:5]] == ["reached,"] * 4, told
        assert _command(monkeypatch, router.url, "--fly-square", "6") == 2
        assert "give --yes" in capsys.readouterr().err


def _command(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(visit, "LISTEN", 2.0)
    monkeypatch.setattr(sys, "argv", ["searchparty", "vehicle", *arguments])
    with open(os.devnull) as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        with pytest.raises(SystemExit) as caught:
            cli.main()
    return int(caught.value.code or 0)
