"""A vehicle must stand where the mission starts it, by one reference of place and of altitude."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agents.devices import DeviceContext
from bridges.mavlink.frames import LocalFrame, Place, TeamFrame
from bridges.mavlink.kind import MavlinkConfig
from bridges.mavlink.pilot_report import PilotReport
from bridges.mavlink.placing import Placed, place
from estimator.filter import Area

ZERO = (47.397742, 8.545594, 488.0)
AREA = Area(np.array([0.0, 0.0]), np.array([100.0, 100.0]))


def standing(at: tuple[float, float, float], autopilot: str = "ArduPilot", **changes: Any) -> PilotReport:
    """A vehicle that was switched on at a place of a team frame around ZERO."""
    there = TeamFrame(ZERO).to_degrees(np.array(at))
    report = PilotReport(
        0.0, autopilot=autopilot, home=there, origin=there, where=there, position=np.zeros(3)
    )
    return replace(report, **changes)


def placed(
    report: PilotReport, start: tuple[float, ...] = (10, 20, 12, 0), origin: Place | None = ZERO, **table: Any
) -> Placed:
    config = MavlinkConfig(url="tcp:127.0.0.1:5760", **table)
    context = DeviceContext("r1", 0, AREA, None, np.array(start, float), origin=origin)  # type: ignore[arg-type]
    found = place(config, context, report)
    assert found is not None
    return found


def where(local: LocalFrame | None, ned: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    assert local is not None
    return local.to_team(np.array(ned, float))


@pytest.mark.parametrize("autopilot", ["ArduPilot", "PX4"])
def test_by_the_missions_origin_it_is_where_it_stands(autopilot: str) -> None:
    local = placed(standing((12.0, 17.0, 0.0), autopilot)).local
    assert where(local) == pytest.approx([12.0, 17.0, 0.0], abs=1e-6)
    assert where(local, (0, 0, -30)) == pytest.approx([12.0, 17.0, 30.0], abs=1e-6)


def test_without_an_origin_its_home_is_its_start() -> None:
    local = placed(standing((500.0, 700.0, 3.0)), origin=None).local
    assert where(local) == pytest.approx([10.0, 20.0, 0.0], abs=1e-6)
    assert where(local, (0, 7.0, -12.0)) == pytest.approx([17.0, 20.0, 12.0], abs=0.05)


def test_altitudes_count_from_its_home_or_from_the_origin() -> None:
    slope = standing((10.0, 20.0, 6.0))
    assert where(placed(slope).local)[2] == pytest.approx(0.0)
    assert where(placed(slope, altitude="origin").local)[2] == pytest.approx(6.0)


def test_one_that_stands_elsewhere_is_refused_with_both_places() -> None:
    wrong = placed(standing((60.0, 20.0, 0.0))).wrong
    assert "(60.0, 20.0, 0.0)" in wrong
    assert "(10, 20)" in wrong
    assert "50 m away" in wrong
    assert "47.397742" in wrong
    assert placed(standing((60.0, 20.0, 0.0)), start_within_m=60.0).wrong == ""


def test_altitudes_of_another_reference_are_refused_with_both_values() -> None:
    """The origin has no altitude, or one above the ellipsoid: the start would lie under the earth."""
    wrong = placed(standing((10.0, 20.0, 0.0)), origin=(*ZERO[:2], 0.0), altitude="origin").wrong
    assert "12 m" in wrong
    assert "488.0 m" in wrong
    deep = placed(standing((10.0, 20.0, 0.0)), origin=(*ZERO[:2], 1088.0), altitude="origin").wrong
    assert "-600.0 m" in deep
    assert placed(standing((10.0, 20.0, 0.0)), origin=(*ZERO[:2], 0.0)).wrong == ""


def test_a_copter_that_should_start_on_the_ground_is_refused() -> None:
    assert "0 m" in placed(standing((10.0, 20.0, 0.0)), start=(10, 20, 0, 0)).wrong
    assert placed(standing((10.0, 20.0, 0.0)), start=(10, 20, 0, 0), body="rover").wrong == ""


def test_an_autopilot_that_was_carried_since_it_was_switched_on_is_refused() -> None:
    elsewhere = TeamFrame(ZERO).to_degrees(np.array([10.0, 45.0, 0.0]))
    wrong = placed(standing((10.0, 20.0, 0.0), where=elsewhere)).wrong
    assert "(10.0, 20.0, 0.0)" in wrong
    assert "(10.0, 45.0, 0.0)" in wrong
    higher = (*standing((10.0, 20.0, 0.0)).where[:2], 508.0)  # type: ignore[index]
    assert "altitude reference is 20 m off" in placed(standing((10.0, 20.0, 0.0), where=higher)).wrong


def test_nothing_is_said_before_everything_is_known() -> None:
    config = MavlinkConfig(url="tcp:127.0.0.1:5760")
    context = DeviceContext("r1", 0, AREA, None, np.zeros(4))  # type: ignore[arg-type]
    assert place(config, context, replace(standing((0, 0, 0)), home=None)) is None
