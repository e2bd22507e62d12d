"""PX4 copters: OFFBOARD mode.

Measured with 1.16.1: a mode change to OFFBOARD is acknowledged, but it goes to hold unless setpoints have
been streamed for 1.5 s before; it leaves OFFBOARD 1.0 s after the last setpoint. So setpoints never stop
while it is ours, and only a heartbeat says what mode it is in. It takes off by following them.
"""

from collections.abc import Mapping

from bridges.mavlink.autopilot import CUSTOM_MODE, SET_MODE, Autopilot, Failsafe
from bridges.mavlink.commands import Command
from bridges.mavlink.dialect import mavlink
from bridges.mavlink.vehicle_state import VehicleReport

MODES = {  # main, sub
    **{(1, 0): "MANUAL", (2, 0): "ALTCTL", (3, 0): "POSCTL", (5, 0): "ACRO", (6, 0): "OFFBOARD"},
    **{(7, 0): "STABILIZED", (10, 0): "TERMINATION", (4, 1): "READY", (4, 2): "TAKEOFF", (4, 3): "HOLD"},
    **{(4, 4): "MISSION", (4, 5): "RTL", (4, 6): "LAND", (4, 8): "FOLLOW", (4, 9): "PRECLAND"},
}
LINK_ACTION = {0: "none", 1: "hold", 2: "return", 3: "land", 5: "terminate", 6: "disarm"}
OFFBOARD_ACTION = {
    **{
        0: "position",
        1: "altitude",
        2: "manual",
        3: "return",
        4: "land",
        5: "hold",
        6: "terminate",
        7: "disarm",
    }
}
STICKS = {"position", "altitude", "manual"}
BATTERY_ACTION = {0: "report", 1: "return", 2: "land", 3: "return, land when critical"}
FENCE_ACTION = {0: "none", 1: "report", 2: "hold", 3: "return", 4: "terminate", 5: "land"}


class Px4(Autopilot):
    """A PX4 copter."""

    name = "PX4"
    guided = "OFFBOARD"
    lead = 1.6
    constant_is_blind = False  # set whenever it stands still, also with a position
    climbs_by_setpoint = True

    def mode(self, report: VehicleReport) -> str:
        main, sub = report.custom_mode >> 16 & 0xFF, report.custom_mode >> 24 & 0xFF
        name = MODES.get((main, sub)) or MODES.get((main, 0))
        return name or f"mode {main}.{sub}"

    @property
    def modes(self) -> tuple[str, ...]:
        return tuple(MODES.values())

    def mode_command(self, mode: str) -> Command:
        main, sub = next(numbers for numbers, name in MODES.items() if name == mode)
        return Command(SET_MODE, f"mode {mode}", (float(CUSTOM_MODE), float(main), float(sub)))

    @property
    def land_mode(self) -> str:
        return "LAND"

    @property
    def return_mode(self) -> str:
        return "RTL"

    @property
    def mission_mode(self) -> str:
        return "MISSION"

    @property
    def hold_mode(self) -> str:
        return "HOLD"

    def take_off(self, height: float) -> Command | None:
        return None

    def estimator_message(self) -> int:
        return int(mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS)

    @property
    def parameters(self) -> tuple[str, ...]:
        return (
            *("COM_OF_LOSS_T", "COM_OBL_RC_ACT", "NAV_DLL_ACT", "COM_DL_LOSS_T", "COM_OBC_LOSS_T"),
            *("NAV_RCL_ACT", "COM_LOW_BAT_ACT", "GF_ACTION"),
        )

    def failsafes(self, values: Mapping[str, float], us: int) -> list[Failsafe]:
        found = []
        for cause, name, actions, after in (
            ("setpoints", "COM_OBL_RC_ACT", OFFBOARD_ACTION, "COM_OF_LOSS_T"),
            ("ground link", "NAV_DLL_ACT", LINK_ACTION, "COM_DL_LOSS_T"),
            ("radio control", "NAV_RCL_ACT", LINK_ACTION, ""),
            ("low battery", "COM_LOW_BAT_ACT", BATTERY_ACTION, ""),
            ("fence", "GF_ACTION", FENCE_ACTION, ""),
        ):
            if name not in values:
                continue
            number = int(values[name])
            action = actions.get(number, "other")
            words, wait = f"{name} = {number}: {action}", values.get(after)
            if cause == "setpoints" and action in STICKS:
                words += " (without a remote control it sinks to the ground)"
            if wait is not None:
                words += f", {wait:g} s after the last ({after})"
            found.append(Failsafe(cause, action, words, wait))
        return found
