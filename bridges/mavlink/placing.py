"""Where a vehicle stands in the team's frame, and why a mission must not begin from there."""

from dataclasses import dataclass
from math import hypot

import numpy as np

from agents.devices import DeviceContext
from bridges.mavlink.frames import LocalFrame, Place, TeamFrame
from bridges.mavlink.kind import MavlinkConfig
from bridges.mavlink.pilot_report import PilotReport

AGREE_M = 5.0  # between the two ways in which an autopilot says where it is
HIGHEST_M = 500.0  # that a start may lie above its vehicle's home


@dataclass(frozen=True, slots=True)
class Placed:
    """A vehicle's frame, or what speaks against it."""

    local: LocalFrame | None
    wrong: str = ""


def team_frame(config: MavlinkConfig, context: DeviceContext, home: Place) -> TeamFrame:
    """The mission's own frame; where it has no origin, the one in which the home is the robot's start."""
    if context.origin is None:
        return TeamFrame(home, (float(context.start[0]), float(context.start[1]), 0.0))
    latitude, longitude, altitude = context.origin
    return TeamFrame((latitude, longitude, home[2] if config.altitude == "home" else altitude))


def place(config: MavlinkConfig, context: DeviceContext, report: PilotReport) -> Placed | None:
    """Where it stands; None while it has not said so."""
    home, origin, where, position = report.home, report.origin, report.where, report.position
    if home is None or origin is None or where is None or position is None:
        return None
    local = LocalFrame(team_frame(config, context, home), origin, report.autopilot)
    here, there = local.to_team(position), local.team.from_degrees(where)
    for name, gap in (
        ("place", hypot(*(here - there)[:2])),
        ("altitude", abs(float(here[2] - there[2]))),
    ):
        if gap > AGREE_M:
            return Placed(
                None,
                f"its local position says that it is at {_point(here)}, its global one {_point(there)}: its "
                f"{name} reference is {gap:.0f} m off; restart the autopilot where it stands now",
            )
    wrong = _start(config, context, here, home) or _height(config, context, local, home)
    return Placed(None, wrong) if wrong else Placed(local)


def _start(config: MavlinkConfig, context: DeviceContext, here: np.ndarray, home: Place) -> str:
    gap = hypot(*(here - context.start[:3])[:2])
    if gap <= config.start_within_m or config.take_flying:
        return ""
    start = f"({context.start[0]:g}, {context.start[1]:g})"
    away = f"{gap:.0f} m away, more than start_within_m = {config.start_within_m:g}"
    if context.origin is None:
        return f"it is at {_point(here)}, but the mission starts it at {start} where its home is: {away}"
    latitude, longitude, _ = context.origin
    return (
        f"it is at {_point(here)} from the mission's origin {latitude:.6f}, {longitude:.6f} (its home is "
        f"{home[0]:.6f}, {home[1]:.6f}), but the mission starts it at {start}: {away}"
    )


def _height(config: MavlinkConfig, context: DeviceContext, local: LocalFrame, home: Place) -> str:
    """A start under the ground, or absurdly high above it, comes of altitudes counted from elsewhere."""
    if config.body != "copter":
        return ""
    ground, start = float(local.team.from_degrees(home)[2]), float(context.start[2])
    least = ground + min(1.0, config.take_off_m)
    if least <= start <= ground + HIGHEST_M:
        return ""
    zero = local.team.zero[2]
    return (
        f"the mission starts it at an altitude of {start:g} m, but its home is at {ground:.1f} m there "
        f"({home[2]:.1f} m above sea level, where the mission's zero is at {zero - local.team.at[2]:.1f} m); "
        "give robots.start a z above that, or correct origin.altitude or vehicle.altitude"
    )


def _point(place: np.ndarray) -> str:
    return f"({place[0]:.1f}, {place[1]:.1f}, {place[2]:.1f})"
