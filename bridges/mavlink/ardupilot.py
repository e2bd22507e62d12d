"""ArduPilot copters and rovers: GUIDED mode.

Measured with 4.6.2: it streams nothing but heartbeats until asked; it may accept arming before its estimator
has a position, and take-off then fails; a position setpoint is flown to and held, a velocity setpoint stops
after GUID_TIMEOUT; setpoints outside GUIDED are ignored without a word.
"""

from collections.abc import Mapping

from bridges.mavlink.autopilot import CUSTOM_MODE, SET_MODE, Autopilot, Failsafe
from bridges.mavlink.commands import Command
from bridges.mavlink.dialect import mavlink
from bridges.mavlink.vehicle_state import VehicleReport

COPTER_MODES = {
    **{0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 7: "CIRCLE"},
    **{9: "LAND", 11: "DRIFT", 13: "SPORT", 14: "FLIP", 15: "AUTOTUNE", 16: "POSHOLD", 17: "BRAKE"},
    **{18: "THROW", 19: "AVOID_ADSB", 20: "GUIDED_NOGPS", 21: "SMART_RTL", 22: "FLOWHOLD", 23: "FOLLOW"},
    **{24: "ZIGZAG", 25: "SYSTEMID", 26: "AUTOROTATE", 27: "AUTO_RTL", 28: "TURTLE"},
}
ROVER_MODES = {
    **{0: "MANUAL", 1: "ACRO", 3: "STEERING", 4: "HOLD", 5: "LOITER", 6: "FOLLOW", 7: "SIMPLE", 8: "DOCK"},
    **{9: "CIRCLE", 10: "AUTO", 11: "RTL", 12: "SMART_RTL", 15: "GUIDED", 16: "INITIALISING"},
}
COPTER_GROUND_LINK = {
    **{
        0: "none",
        1: "return",
        2: "return",
        3: "return",
        4: "return or land",
        5: "land",
        6: "land",
        7: "hold or land",
    }
}
ROVER_ACTION = {0: "none", 1: "return", 2: "hold", 3: "return", 4: "return or hold", 5: "disarm"}
COPTER_BATTERY = {0: "none", 1: "land", 2: "return", 3: "return", 4: "return or land", 5: "disarm", 6: "land"}
ROVER_BATTERY = {0: "none", 1: "return", 2: "hold", 3: "return", 4: "return or hold", 5: "disarm"}
COPTER_ESTIMATOR = {0: "none", 1: "land", 2: "altitude", 3: "land"}
ROVER_ESTIMATOR = {0: "none", 1: "hold", 2: "report"}
COPTER_FENCE = {
    0: "report",
    1: "return or land",
    2: "land",
    3: "return or land",
    4: "hold or land",
    5: "return or land",
}
ROVER_FENCE = {0: "report", 1: "return or hold", 2: "hold", 3: "return or hold", 4: "return or hold"}


class ArduPilot(Autopilot):
    """An ArduPilot copter or rover."""

    name = "ArduPilot"
    guided = "GUIDED"
    lead = 0.0
    constant_is_blind = True
    climbs_by_setpoint = False

    @property
    def _modes(self) -> dict[int, str]:
        return COPTER_MODES if self.body == "copter" else ROVER_MODES

    def mode(self, report: VehicleReport) -> str:
        return self._modes.get(report.custom_mode, f"mode {report.custom_mode}")

    @property
    def modes(self) -> tuple[str, ...]:
        return tuple(self._modes.values())

    def mode_command(self, mode: str) -> Command:
        number = next(number for number, name in self._modes.items() if name == mode)
        return Command(SET_MODE, f"mode {mode}", (float(CUSTOM_MODE), float(number)))

    @property
    def land_mode(self) -> str:
        return "LAND" if self.body == "copter" else "HOLD"

    @property
    def return_mode(self) -> str:
        return "RTL"

    @property
    def mission_mode(self) -> str:
        return "AUTO"

    @property
    def hold_mode(self) -> str:
        # LOITER would obey the throttle stick, also one that nobody has connected.
        return "BRAKE" if self.body == "copter" else "HOLD"

    def take_off(self, height: float) -> Command | None:
        if self.body != "copter":
            return None
        return Command(mavlink.MAV_CMD_NAV_TAKEOFF, f"take off to {height:g} m", (0, 0, 0, 0, 0, 0, height))

    def estimator_message(self) -> int:
        return int(mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT)

    def not_ready(self, report: VehicleReport, now: float) -> list[str]:
        reasons = super().not_ready(report, now)
        if report.prearm_ok is False:
            said = [text for text in report.since(now - 35) if "arm:" in text.lower()]
            reasons.append(
                "; ".join(dict.fromkeys(said)) or "its pre-arm checks fail (it has not said which)"
            )
        return reasons

    @property
    def parameters(self) -> tuple[str, ...]:
        own = ("GUID_TIMEOUT", "FS_THR_ENABLE") if self.body == "copter" else ("FS_ACTION", "FS_TIMEOUT")
        return (
            *("SYSID_MYGCS", "FS_GCS_ENABLE", "FS_GCS_TIMEOUT", "FS_EKF_ACTION", "BATT_FS_LOW_ACT"),
            *("FENCE_ENABLE", "FENCE_ACTION", *own),
        )

    def failsafes(self, values: Mapping[str, float], us: int) -> list[Failsafe]:
        copter = self.body == "copter"
        found = [self._ground_link(values, us)]
        if "BATT_FS_LOW_ACT" in values:
            found.append(
                _named("low battery", "BATT_FS_LOW_ACT", values, COPTER_BATTERY if copter else ROVER_BATTERY)
            )
        if "FS_EKF_ACTION" in values:
            table = COPTER_ESTIMATOR if copter else ROVER_ESTIMATOR
            found.append(_named("estimator", "FS_EKF_ACTION", values, table))
        if values.get("FENCE_ENABLE"):
            found.append(_named("fence", "FENCE_ACTION", values, COPTER_FENCE if copter else ROVER_FENCE))
        else:
            found.append(Failsafe("fence", "none", "FENCE_ENABLE = 0: it has no fence of its own"))
        stops = values.get("GUID_TIMEOUT", 3.0)
        words = (
            "when our setpoints stop it goes on to the last position and holds there; "
            f"a velocity ends after {stops:g} s (GUID_TIMEOUT)"
        )
        return [*found, Failsafe("setpoints", "hold", words)]

    def _ground_link(self, values: Mapping[str, float], us: int) -> Failsafe:
        switch = int(values.get("FS_GCS_ENABLE", 0))
        after = values.get("FS_GCS_TIMEOUT", values.get("FS_TIMEOUT", 5.0))
        if self.body == "copter":
            action = COPTER_GROUND_LINK.get(switch, "other")
        else:
            action = ROVER_ACTION.get(int(values.get("FS_ACTION", 2)), "other") if switch else "none"
        words = f"FS_GCS_ENABLE = {switch}: {action}"
        if action != "none":
            station = int(values.get("SYSID_MYGCS", 255))
            ours = "ours" if station == us else "not ours"
            words += f", {after:g} s after the last heartbeat of system {station} (SYSID_MYGCS), {ours}"
        return Failsafe("ground link", action, words, after)


def _named(cause: str, name: str, values: Mapping[str, float], actions: dict[int, str]) -> Failsafe:
    number = int(values.get(name, 0))
    action = actions.get(number, "other")
    return Failsafe(cause, action, f"{name} = {number}: {action}")
