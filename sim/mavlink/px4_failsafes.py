"""What PX4 does by itself when setpoints, a ground station, the battery, the estimator or a fence fail it."""

import math
from typing import TYPE_CHECKING

from sim.mavlink.autopilot import CRITICAL
from sim.mavlink.fence import outside

if TYPE_CHECKING:
    from sim.mavlink.px4 import Px4

NEED_NO_POSITION = {"MANUAL", "ALTCTL", "ACRO", "STABILIZED", "LAND"}
# COM_OBL_RC_ACT. Measured: POSCTL, its default, sinks to the ground where nobody holds any sticks.
OFFBOARD_ACTIONS = {0: "POSCTL", 1: "ALTCTL", 2: "STABILIZED", 3: "RTL", 4: "LAND", 5: "HOLD"}
STICKS = {"POSCTL", "ALTCTL", "STABILIZED"}
DATA_LINK_ACTIONS = {1: "HOLD", 2: "RTL", 3: "LAND"}
FENCE_ACTIONS = {2: "HOLD", 3: "RTL", 5: "LAND"}
BATTERY_WORDS = {1: "Low", 2: "Critical", 3: "Emergency"}


class Failsafes:
    """Each strikes once, when its cause appears; ending the cause undoes nothing."""

    def __init__(self, vehicle: "Px4") -> None:
        self._vehicle = vehicle
        self._station: float | None = None  # when a ground station was heard last
        self._warned = 0
        self._followed = False  # it follows setpoints
        self._struck: set[str] = set()

    def __repr__(self) -> str:
        return f"Failsafes({sorted(self._struck)})"

    def heard_station(self) -> None:
        self._station = self._vehicle.now

    def check(self) -> None:
        """Every tick of an armed vehicle."""
        v, p = self._vehicle, self._vehicle.parameters
        if v.mode == "OFFBOARD" and v.stream_trouble():
            chosen = OFFBOARD_ACTIONS.get(int(p["COM_OBL_RC_ACT"]), "POSCTL")
            action = chosen if self._followed else "HOLD"  # measured: HOLD where it never came to follow them
            v.say(CRITICAL, "Failsafe activated: No offboard control signal")
            v.critical = True
            v.set_mode(action)
            if action in STICKS:
                v.guidance.land()
        self._followed = v.mode == "OFFBOARD"
        silence = 0.0 if self._station is None else v.now - self._station
        lost = p["NAV_DLL_ACT"] > 0 and silence > p["COM_DL_LOSS_T"]
        action_lost = DATA_LINK_ACTIONS.get(int(p["NAV_DLL_ACT"]))
        self._once("Failsafe activated: GCS connection lost", lost, action_lost)
        self._check_battery()
        blind = v.mode not in NEED_NO_POSITION and not v.has_position() and not v.body.on_ground
        self._once("Failsafe activated: Position estimate lost", blind, "LAND")
        breach = not v.body.on_ground and not self._inside_fence()
        self._once("Geofence exceeded", breach, FENCE_ACTIONS.get(int(p["GF_ACTION"])))

    def _check_battery(self) -> None:
        p, left = self._vehicle.parameters, self._vehicle.battery.left
        thresholds = (p["BAT_LOW_THR"], p["BAT_CRIT_THR"], p["BAT_EMERGEN_THR"])
        level = sum(left < threshold for threshold in thresholds)
        if level > self._warned:
            act = int(p["COM_LOW_BAT_ACT"])
            action = {2: "LAND", 3: "LAND" if level == 3 else "RTL"}.get(act) if level >= 2 else None
            self._strike(f"{BATTERY_WORDS[level]} battery level", action)
        self._warned = max(level, self._warned)

    def _inside_fence(self) -> bool:
        v, p = self._vehicle, self._vehicle.parameters
        here, home = v.body.position, v.home_local()
        far, high = p["GF_MAX_HOR_DIST"], p["GF_MAX_VER_DIST"]
        if far > 0 and math.dist(here[:2], home[:2]) > far:
            return False
        if high > 0 and home[2] - here[2] > high:
            return False
        return not outside(v.plans.items[1], v.projection, here)

    def _once(self, text: str, cause: bool, mode: str | None) -> None:
        if not cause:
            self._struck.discard(text)
        elif text not in self._struck:
            self._struck.add(text)
            self._strike(text, mode)

    def _strike(self, text: str, mode: str | None) -> None:
        v = self._vehicle
        v.say(CRITICAL, text)
        if mode is None or v.body.on_ground:
            return
        v.critical = True
        if v.set_mode(mode) is not None:
            v.set_mode("LAND")
