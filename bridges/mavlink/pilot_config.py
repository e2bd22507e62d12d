"""What a pilot is told before it begins."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from bridges.mavlink.wanted import Permit

Action = Literal["continue", "hold", "land", "return"]


@dataclass(frozen=True, slots=True)
class Fallbacks:
    """What is done when something is lost. Graver ones win: land before return before hold."""

    low_battery: float = 0.2  # fraction that remains
    on_low_battery: Action = "return"
    pose_stale_s: float = 1.5
    on_pose_stale: Action = "hold"
    team_lost_s: float = math.inf
    on_team_lost: Action = "hold"
    robot_silent_s: float = 3.0  # since the robot's loop last asked for the vehicle's state
    on_robot_silent: Action = "return"
    on_outside: Action = "return"  # when it is outside of what `breach` allows


@dataclass(frozen=True, slots=True)
class PilotConfig:
    """Whom to fly, as whom, and how careful to be."""

    system: int | None = 1  # of the vehicle; None: the only one there
    source_system: int | None = None  # ours; None: the vehicle's, as a companion computer has
    source_component: int = 191  # onboard computer
    autopilot: Literal["auto", "ardupilot", "px4"] = "auto"
    body: Literal["copter", "rover"] | None = None  # that the mission expects
    take_off_height: float = 5.0  # m above where it stands
    rate: float = 10.0  # Hz, of setpoints and of the pose
    take_flying: bool = False  # take control of a vehicle that already flies when it is found
    fly: bool = True  # False: only look
    fallbacks: Fallbacks = Fallbacks()
    failsafes: Mapping[str, str] = field(default_factory=dict)  # cause -> action that the mission relies on
    permit: Permit | None = None  # fence and heights, asked before every setpoint
    breach: Permit | None = None  # asked of the position flown, more generous
    url: str = "the link"  # for messages to people
