"""What ArduPilot does by itself when a ground station, the battery, the estimator or a fence fails it."""

from typing import TYPE_CHECKING

from sim.mavlink.autopilot import CRITICAL

if TYPE_CHECKING:
    from sim.mavlink.ardupilot import ArduPilot

NEED_NO_POSITION = {"STABILIZE", "ACRO", "ALT_HOLD", "LAND", "GUIDED_NOGPS", "MANUAL", "HOLD"}
RETURNING = {"RTL", "SMART_RTL"}
BATTERY_ACTIONS = {1: "LAND", 2: "RTL", 3: "SMART_RTL", 4: "SMART_RTL"}
GCS_ACTIONS = {1: "RTL", 3: "SMART_RTL", 4: "SMART_RTL", 5: "LAND", 7: "BRAKE"}
ROVER_ACTIONS = {1: "RTL", 2: "HOLD"}
FENCE_ACTIONS = {1: "RTL", 2: "LAND"}


class Failsafes:
    """Each strikes once, when its cause appears; ending the cause undoes nothing."""

    def __init__(self, vehicle: "ArduPilot") -> None:
        self._vehicle = vehicle
        self._station: float | None = None  # when SYSID_MYGCS was heard last
        self._battery_stage = 0
        self._struck: set[str] = set()

    def __repr__(self) -> str:
        return f"Failsafes({sorted(self._struck)})"

    def heard_station(self) -> None:
        self._station = self._vehicle.now

    def check(self) -> None:
        """Every tick of an armed vehicle."""
        v, p = self._vehicle, self._vehicle.parameters
        airborne = v.body.flies and not v.body.on_ground
        silence = 0.0 if self._station is None else v.now - self._station
        if p["FS_GCS_ENABLE"]:
            action = GCS_ACTIONS.get(int(p["FS_GCS_ENABLE"]), "RTL")
            if not v.body.flies:
                action = ROVER_ACTIONS.get(int(p["FS_ACTION"]), "HOLD")
            self._once("GCS Failsafe", silence > p["FS_GCS_TIMEOUT"], action)
        self._check_battery()
        lost = not v.has_position() or v.fault("bad_estimate")
        ekf = airborne and lost and v.mode not in NEED_NO_POSITION
        self._once("EKF Failsafe", ekf, "LAND" if p["FS_EKF_ACTION"] else None)
        breach = airborne and v.mode not in RETURNING | {"LAND"} and not v.inside_fence(v.body.position)
        self._once("Fence Breached", breach, FENCE_ACTIONS.get(int(p["FENCE_ACTION"])))

    def _check_battery(self) -> None:
        v, p = self._vehicle, self._vehicle.parameters
        stage = 2 if self._below("CRT") else 1 if self._below("LOW") else 0
        if stage > self._battery_stage:
            which, word = ("CRT", "critical") if stage == 2 else ("LOW", "low")
            text = f"Battery 1 is {word} {v.battery.volts():.2f}V used 0 mAh"
            self._strike(text, BATTERY_ACTIONS.get(int(p[f"BATT_FS_{which}_ACT"])))
        self._battery_stage = max(stage, self._battery_stage)

    def _below(self, which: str) -> bool:
        v, p = self._vehicle, self._vehicle.parameters
        volts, charge = p[f"BATT_{which}_VOLT"], p[f"BATT_{which}_MAH"]
        left = v.battery.left * p["BATT_CAPACITY"]
        return bool((volts > 0 and v.battery.volts() < volts) or (charge > 0 and left < charge))

    def _once(self, text: str, cause: bool, mode: str | None) -> None:
        if not cause:
            self._struck.discard(text)
        elif text not in self._struck:
            self._struck.add(text)
            self._strike(text, mode)

    def _strike(self, text: str, mode: str | None) -> None:
        v = self._vehicle
        v.say(CRITICAL, text)
        if mode is None:
            return
        v.critical = True
        if v.body.on_ground and v.body.flies:
            v.disarm()
            return
        if v.set_mode(v.holding if mode == "BRAKE" else mode) is not None:
            v.set_mode("LAND" if v.body.flies else "HOLD")
